# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Deadlines on an absolute grid of the steady clock, without drift; a late step is caught up."""

import time


class Pace:
    """The deadlines of steps; ``done`` counts the past ones."""

    def __init__(self, period_s: float) -> None:
        """Set the deadlines to whole multiples of ``period_s`` from now."""
        self._period_s = period_s
        self._start_ns = time.monotonic_ns()
        self.done = 0

    def remaining_s(self) -> float:
        """Return the time [s] until the next deadline; negative when it is past."""
        due = self._start_ns + round((self.done + 1) * self._period_s * 1e9)
        return (due - time.monotonic_ns()) * 1e-9

    def advance(self) -> None:
        """Go to the next deadline."""
        self.done += 1
