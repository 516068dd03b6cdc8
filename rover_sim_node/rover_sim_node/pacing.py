# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Deadlines on an absolute grid of the steady clock: no drift, and what is late is caught up with."""

import time


class Pace:
    """The times at which steps are due; ``done`` counts those that are over."""

    def __init__(self, period_s: float) -> None:
        """The first step is due one ``period_s`` from now, the others at whole multiples of it."""
        self._period_s = period_s
        self._start_ns = time.monotonic_ns()
        self.done = 0

    def remaining_s(self) -> float:
        """Time until the next step is due [s]; negative when it is late."""
        due = self._start_ns + round((self.done + 1) * self._period_s * 1e9)
        return (due - time.monotonic_ns()) * 1e-9

    def advance(self) -> None:
        """The step that was due is done."""
        self.done += 1
