# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Limited number and length of the web server's log lines."""

import logging
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LINES = 5
PERIOD_S = 60.0
LENGTH = 400  # characters
LOGGERS = ("tornado", "asyncio", "terrain_estimator.dashboard")


class LimitedLog(logging.Handler):
    """Handler that passes on ``LINES`` different lines in a ``PERIOD_S``, then counts the others.

    Every connection can cause lines: without a limit they would fill the disk of the rover.
    """

    def __init__(
        self, write: Callable[[str], object], clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        """Pass lines on to ``write``; take the time from a steady clock."""
        super().__init__(logging.WARNING)
        self._write, self._clock_s = write, clock_s
        self._begin_s, self._left_out = -math.inf, 0
        self._written: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        """Write the record as one line, or count it."""
        self.report()
        line = _line(record)
        if line in self._written or len(self._written) >= LINES:
            self._left_out += 1
            return
        self._written.add(line)
        self._write(line)

    def report(self) -> None:
        """Begin a new period where the last one is over, with the number of lines left out."""
        now_s = self._clock_s()
        if now_s - self._begin_s < PERIOD_S:
            return
        if self._left_out:
            self._write(
                f"web server: {self._left_out} more lines were left out in the last"
                f" {now_s - self._begin_s:.0f} s"
            )
        self._begin_s, self._left_out = now_s, 0
        self._written.clear()


def _line(record: logging.LogRecord) -> str:
    """Return a record as one line of printable characters, with its exception and where it was."""
    text = record.getMessage()
    error = record.exc_info[1] if record.exc_info else None
    if error is not None:
        last = error.__traceback__
        while last is not None and last.tb_next is not None:
            last = last.tb_next
        place = f" in {last.tb_frame.f_code.co_qualname}:{last.tb_lineno}" if last else ""
        text = f"{type(error).__name__}{place}: {error}: {text}"
    text = "".join(each if each.isprintable() else " " for each in text)
    return f"web server: {text}"[:LENGTH]


@contextmanager
def limited_log(write: Callable[[str], object]) -> Iterator[LimitedLog]:
    """Write the lines of the web server and of its event loop within limits."""
    handler = LimitedLog(write)
    loggers = [logging.getLogger(name) for name in LOGGERS]
    for each in loggers:
        each.addHandler(handler)
        each.propagate = False
    try:
        yield handler
    finally:
        for each in loggers:
            each.removeHandler(handler)
            each.propagate = True
