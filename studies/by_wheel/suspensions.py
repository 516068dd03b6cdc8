# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rovers whose wheel loads balances do not determine, on the motions and the ground of the tables.

Their files are those of docs/examples. Drives last a minute, and seeds are those of ``motions``.
"""

from pathlib import Path

from studies.by_wheel.motions import Motion
from studies.off_plane import BUMPS, STEEP, Kind
from terramechanics.presets import load_rover
from terramechanics.vehicle.steering import skid_command, steered_command

SAMPLES = 600
LEAN = 10.0
"""[deg] of the slope across which they drive."""
_FILES = Path(__file__).parents[2] / "docs" / "examples"

SUSPENSIONS = (
    Kind(str(_FILES / "six_wheel_rover.yaml"), 0.57, 8.0, skid_command, 0.25, (0.4,)),
    Kind(str(_FILES / "eight_wheel_rover.yaml"), 0.57, 15.0, skid_command, 0.25, (0.4,)),
    Kind(str(_FILES / "fixed_rocker_rover.yaml"), 1.0, 20.0, steered_command, 0.08, (0.05,)),
)


def motions_of(kind: Kind) -> list[Motion]:
    """Return the motions of a rover's table."""
    (rate,) = kind.yaw_rates
    turn = Motion(f"{rate:g} rad/s commanded", yaw_rate=rate)
    straight, slope = Motion("straight, level"), Motion(f"across {LEAN:g}°", lean=LEAN)
    bumpy = turn.but(f"bumps of {STEEP:g}°", uneven=STEEP, lengths=BUMPS)
    return [
        straight,
        turn,
        slope,
        turn.but(f"hills of {STEEP:g}°", uneven=STEEP),
        bumpy,
        bumpy.but("no contact angles", angles=False),
        *(
            each.but("no sinkages", sinkages=False)
            for each in (turn, slope, bumpy)
            if load_rover(kind.rover).is_determined  # else every sinkage is needed
        ),
    ]
