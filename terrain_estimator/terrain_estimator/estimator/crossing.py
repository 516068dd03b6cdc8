# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The way of a rover across a border of the ground, from the first sign of a change.

Once one axle is on other ground, the others follow within one wheelbase of travel. Until then no
ground fits all axles, and no misfit tells anything against the model. Ground that has just changed
may go on changing: what is known of it is published as less certain until the rover has found it
the same for some way.
"""

import math

from terramechanics.vehicle.rover import Rover

CHANGING = 0.5
"""[1] Probability of a change above which it is accepted."""
ACROSS = 1.0
"""[wheelbases] From the first sign of a change until the last axle has crossed."""
SETTLED = 2.0
"""[wheelbases] Until then a change that is accepted again is the same one, at another axle."""
KNOWN = 3.0
"""[wheelbases] From the last sign of a change until the ground counts as the same everywhere."""
LONGEST = 30
"""[seconds of driving] A crossing ends by then at the latest.

A rover that slips in its place travels no way. Crossings of the rovers that ship took 21 s at most
(420 drives).
"""
REST = 45
"""[seconds of driving] From one change to the next; an earlier one explains no misfit."""


class Crossing:
    """Time and way since the last change of the ground that explains a misfit."""

    def __init__(
        self, since_change: int = REST, way: float = SETTLED, same_way: float = KNOWN
    ) -> None:
        """Go on ``since_change`` [seconds of driving] and ``way`` [wheelbases] after a change.

        ``same_way`` [wheelbases] is that since the last second that was taken
        with a sign of one.
        """
        self.since_change, self.way, self.same_way = since_change, way, same_way

    def explains(self, changed: float, way: float) -> bool:
        """Take a second; return whether a change explains its misfit, and that of those before.

        ``changed`` [1] is the probability of a change around it, ``way`` [wheelbases] the travel
        in it.
        """
        accepted = changed > CHANGING
        self.since_change = min(self.since_change + 1, REST)
        self.way = min(self.way + way, SETTLED)
        if accepted and self.since_change == REST:
            self.since_change, self.way = 0, 0.0
        crosses = self.way < ACROSS or (accepted and self.way < SETTLED)
        return crosses and self.since_change < LONGEST

    def go(self, changed: float, way: float) -> None:
        """Take a second that entered the posterior; one that is left out finds nothing the same."""
        self.same_way = 0.0 if changed > CHANGING else min(self.same_way + way, KNOWN)

    @property
    def unknown(self) -> float:
        """Share [1] of the prior's spread that is published beside the posterior's.

        All of it until the last axle has crossed, none from KNOWN on.
        """
        return min(1.0, (KNOWN - self.same_way) / (KNOWN - ACROSS))


def wheelbases(rover: Rover, velocity: float, yaw_rate: float, seconds: float) -> float:
    """Return the way of the first axle at a ``velocity`` [m/s] and ``yaw_rate`` [rad/s].

    The rate may be NaN: not measured. A rover of one axle is across at once.
    """
    wheelbase = rover.axle_x[0] - rover.axle_x[-1]
    turned = 0.0 if math.isnan(yaw_rate) else 0.5 * abs(yaw_rate) * seconds
    return abs(velocity) * seconds / wheelbase + turned if wheelbase > 0.0 else KNOWN
