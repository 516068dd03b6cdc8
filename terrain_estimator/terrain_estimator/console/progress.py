# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Progress of a long job on stderr: a bar with percentage and time left on a terminal, else a line now and then."""

import sys
import time
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

LINE_PERIOD_S = 5.0
"""[s] between two lines where stderr is no terminal; a job that ends sooner writes none."""


class ProgressReport:
    """Use as a context manager and call :meth:`at` with the share that is done; calls are cheap."""

    def __init__(self, title: str) -> None:
        """``title`` stands before the percentage."""
        self._title = title
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TaskProgressColumn(),
            TextColumn("time left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
        )
        self._bar = (
            Progress(*columns, console=Console(stderr=True), transient=True)
            if sys.stderr.isatty()
            else None
        )
        self._task = self._bar.add_task(title, total=1.0, note="") if self._bar else None
        self._started_s = self._said_s = time.monotonic()

    def at(self, share: float, note: str = "") -> None:
        """The job is done to this share, 0 to 1; ``note`` stands behind it."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=share, note=note)
        elif time.monotonic() - self._said_s > LINE_PERIOD_S and share > 0.0:
            self._said_s = time.monotonic()
            left_s = (self._said_s - self._started_s) * (1.0 - share) / share
            sys.stderr.write(
                f"{self._title}: {share:.0%}, {left_s:.0f} s left {note}".rstrip() + "\n"
            )

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
        """Take the bar away."""
        if self._bar:
            self._bar.stop()
