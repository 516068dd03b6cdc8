# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The forecast that the velocity stays, with a spread learnt from its changes in one step.

It takes the model's place where the model does not fit. A change from one measurement to the next
holds the noise of both, so its mean square is the variance of the measurement to come.
"""

import math
from typing import NamedTuple

MEMORY = 0.02
"""[1] Share of the newest change in the mean square: five seconds at 10 Hz."""
FEWEST = 10
"""[1] Changes before which the spread is not known."""
_KNOWN = 1.0 - (1.0 - MEMORY) ** (FEWEST - 0.5)  # between the weights of one fewer and of as many


class Persistence(NamedTuple):
    """The last measured velocity of a rover that drives, and the mean square of its changes."""

    stamp_ns: int | None = None  # None: none was measured
    velocity: float = 0.0  # [m/s]
    square: float = 0.0  # [m^2/s^2] weighted sum of the squared changes
    weight: float = 0.0  # [1] sum of their weights

    def is_one_step(self, stamp_ns: int, step_s: float) -> bool:
        """Return whether a stamp is about ``step_s`` after that of the last velocity."""
        if self.stamp_ns is None:
            return False
        return round((stamp_ns - self.stamp_ns) * 1e-9 / step_s) == 1

    def observed(self, stamp_ns: int, velocity: float, *, one_step: bool) -> "Persistence":
        """Return the forecast after another measured ``velocity`` [m/s], ``one_step`` later."""
        if not one_step:
            return self._replace(stamp_ns=stamp_ns, velocity=velocity)
        change = velocity - self.velocity
        square = self.square + MEMORY * (change * change - self.square)
        return Persistence(stamp_ns, velocity, square, self.weight + MEMORY * (1.0 - self.weight))

    def forecast(self) -> tuple[float, float]:
        """Return mean [m/s] and variance of the measurement to come.

        Both are NaN until enough changes were seen.
        """
        if self.weight > _KNOWN and self.square > 0.0:
            return self.velocity, self.square / self.weight
        return math.nan, math.nan
