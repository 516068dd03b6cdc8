# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Ground under the front wheels from their torque, before the rest of the rover gets there.

For a ground of given (c, tan phi) the normal stress is scaled so that the wheel carries its load at
the measured sinkage and slip; so a wrong stiffness does no harm. Its torque is then M = r (c INT E
+ s tan phi INT sigma E), which is compared with the measured one.
"""

import math
from dataclasses import dataclass

import numpy as np

from terrain_estimator.observation import Floats
from terrain_estimator.planning.belief import Samples
from terrain_estimator.planning.table import TractionTable

STIFFNESS_DEVIATION = 0.25
"""[1] Deviation of the logarithm of the normal stress.

5 % in the exponent alone make 20 % at a sinkage of two centimetres.
"""


@dataclass(frozen=True, slots=True)
class FrontReading:
    """Measurements of the rover, averaged over a short time; [axles] front to rear."""

    slip: Floats  # [1]
    sinkage: Floats  # [m]
    torque: Floats  # [N m] of one wheel
    contact_angle: Floats  # [rad] ground relative to the body
    pitch: float  # [rad] nose up
    rim_speed: float  # [m/s] mean of r w
    turning: bool = False  # most of the time, by the yaw rate
    turn: float = 0.0  # [1] share of the outer wheels' speed that turns the rover
    sideways: bool = False  # so that it turns, slides to a side or crabs

    @property
    def moving(self) -> bool:
        """Return whether wheels turned, so that slip is defined."""
        return bool(np.isfinite(self.slip).any())

    @property
    def front_lacks(self) -> str:
        """What is missing to judge the front wheels' ground; empty where nothing is."""
        if self.sideways:
            return "straight motion"
        needed = {
            "wheel torque": self.torque,
            "slip of the front wheels": self.slip[:1],
            "sinkage of the front wheels": self.sinkage[:1],
        }
        return " and no ".join(
            name for name, values in needed.items() if not np.isfinite(values).all()
        )


def front_load(table: TractionTable, reading: FrontReading) -> float:
    """Return the normal force [N] of one front wheel; all wheels share in holding the slope."""
    rover = table.rover
    share = rover.weight * math.sin(reading.pitch) / len(rover.wheels)
    angle = np.nan_to_num(reading.contact_angle)
    return float(table.loads(reading.pitch, angle, share, reading.torque)[0])


TORQUE_DEVIATION = 0.08
"""[1] Relative deviation of the torque.

It covers measured slip and sinkage, shear modulus, and the position of the largest stress.
"""


def log_likelihood(
    table: TractionTable, soil: int, samples: Floats, reading: FrontReading, load: float
) -> Floats:
    """Return the log-likelihood [n] of the front wheels' torque for each sample [n, 2] of ``soil``.

    ``load`` comes from :func:`front_load`.
    """
    rover = table.rover
    forces = table.wheel(soil, float(reading.slip[0]), float(reading.sinkage[0]))
    if forces is None:
        return np.zeros(samples.shape[0])
    normal, moment = forces
    cohesion, tan_phi = samples[:, 0], samples[:, 1]
    carried = load - cohesion * normal[0]
    stress = np.clip(carried / (tan_phi * normal[1] + normal[2]), 1e-3, 1e3)
    torque = cohesion * moment[0] + stress * tan_phi * moment[1]
    miss = (reading.torque[0] - torque) / (
        TORQUE_DEVIATION * abs(reading.torque[0]) + 1e-3 * rover.wheel_radius * rover.weight
    )
    return -0.5 * (miss**2 + (np.log(stress) / STIFFNESS_DEVIATION) ** 2)


def front_samples(table: TractionTable, prior: Samples, reading: FrontReading) -> Samples:
    """Return the belief about the ground of the front wheels, given their torque."""
    load = front_load(table, reading)
    return prior.reweighted(
        tuple(
            log_likelihood(table, soil, strength, reading, load)
            for soil, strength in enumerate(prior.strength)
        )
    )
