# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of a long job on stderr.

On a terminal it is a bar with percentage and time left, elsewhere an occasional line.
"""

import sys
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from rover_parameters.printable import printable_line, unguarded

LINE_PERIOD_S = 5.0
"""[s] Time between two lines where stderr is no terminal; a shorter job writes none."""


class ProgressReport:
    """Progress of one job; use as a context manager and call :meth:`at`, which is cheap."""

    def __init__(self, title: str, *, silent: bool = False) -> None:
        """Set the title, which stands before the percentage; a ``silent`` job shows nothing."""
        self._title, self._silent = title, silent
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("time left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
        )
        # the bar moves the cursor; its texts are made printable here
        self._bar = (
            Progress(*columns, console=Console(file=unguarded(sys.stderr)), transient=True)
            if sys.stderr.isatty() and not silent
            else None
        )
        self._task = (
            self._bar.add_task(printable_line(title), total=1.0, note="") if self._bar else None
        )
        self._started_s = self._shown_s = time.monotonic()

    def at(self, share: float, note: str = "") -> None:
        """Show the share of the job that is done, 0 to 1, followed by ``note``."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=share, note=printable_line(note))
        elif time.monotonic() - self._shown_s > LINE_PERIOD_S and share > 0.0 and not self._silent:
            self._shown_s = time.monotonic()
            left_s = (self._shown_s - self._started_s) * (1.0 - share) / share
            sys.stderr.write(
                f"{self._title}: {share:.0%}, {left_s:.0f} s left {note}".rstrip() + "\n"
            )

    def say(self, line: str) -> None:
        """Write a line above the bar."""
        if self._bar:
            self._bar.console.print(
                printable_line(line), highlight=False, markup=False, soft_wrap=True
            )
        else:
            sys.stderr.write(f"{line}\n")

    def __enter__(self) -> Self:
        """Show the bar."""
        if self._bar:
            self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove the bar."""
        if self._bar:
            self._bar.stop()
