# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a simulated drive gives after each step: measurements of one rover, and the truth."""

import dataclasses
import math
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.simulation.sample import SLOWEST, Measurement
from terramechanics.vehicle.rover import Rover

FIXED = 1e-12
"""Variance of motions that a rover cannot make; zero would mean unknown."""
FIXED_SD = 1e-6
"""Its standard deviation."""


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """The ground below the middle axle of the rover, of two axles below the rear one."""

    soil: str
    position: float  # [m] along the track, from which it holds
    constants: tuple[float, ...]  # in the order of CONSTANTS
    strength: tuple[float, float]  # c [Pa], tan(phi)


@dataclass(frozen=True, slots=True)
class SidewaysMotion:
    """Measured motion that a planar rover does not make, with standard deviations."""

    lateral_velocity: float = 0.0  # [m/s] of the body's origin, to the left
    lateral_velocity_sd: float = FIXED_SD
    yaw_rate: float = 0.0  # [rad/s] about the body's z
    yaw_rate_sd: float = FIXED_SD
    roll: float = 0.0  # [rad] left side up
    roll_sd: float = FIXED_SD
    yaw: float = 0.0  # [rad] to the left since the start, by dead reckoning
    yaw_sd: float = FIXED_SD


STRAIGHT = SidewaysMotion()
"""That of a planar rover: none, and known to be none."""


@dataclass(frozen=True, slots=True)
class MotionAcross:
    """True motion of the hubs across the wheels' headings [wheels], NaN where a wheel stands."""

    lateral_slip: Tensor  # [1] v_y / (r |w|), to the left
    slip_angle: Tensor  # [rad] atan2(v_y, v_x), to the left

    @classmethod
    def of(cls, rim: Tensor, along: Tensor, across: Tensor) -> "MotionAcross":
        """Return it of rim speeds r w and of the hubs' velocities [wheels] [m/s]."""
        turns = rim.abs() > SLOWEST
        return cls(
            torch.where(turns, across / rim.abs(), math.nan),
            torch.where(turns, torch.atan2(across, along), math.nan),
        )


@dataclass(frozen=True, slots=True)
class SimulatedReading:
    """Measurements and truth after one step of one rover; tensors are [wheels] and []."""

    time: float  # [s] since the start
    rover: Rover
    measured: Measurement  # per wheel
    wheel_angle: Tensor  # [wheels] [rad] turned since the start
    across: MotionAcross
    bogie_angle: float  # [rad] nose-up
    bogie_rate: float  # [rad/s]
    # [wheels, 4] true N, T [N], contact angle [rad] and side force to the left [N] of each wheel
    ground_force: Tensor
    odometry: tuple[float, float, float]  # [m] x, y and z, by dead reckoning
    odometry_variance: tuple[float, float, float]  # [m^2]
    truth: GroundTruth
    position: float  # [m] true way along the track
    stuck: bool
    specific_force: tuple[float, float]  # [m/s^2] along the body's y and z
    sideways: SidewaysMotion = STRAIGHT
    steering: Tensor | None = None  # [wheels] [rad] to the left; None: no wheel is steered


def single(measured: Measurement) -> Measurement:
    """Return the measurement of the rover in a batch of one; scalars stay tensors []."""
    return Measurement(
        *(getattr(measured, field.name)[0] for field in dataclasses.fields(Measurement))
    )
