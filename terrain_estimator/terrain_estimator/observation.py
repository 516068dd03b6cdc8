# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measurements of the rover at one instant."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Observation:
    """One synchronous set of measurements, reduced to one value per axle (a planar rover).

    Arrays have shape ``[axles]``, front to rear. Every ``*_sd`` is one standard deviation of the
    value before it. NaN means "not measured". Velocity and pitch are required, and slip and
    contact angle of every axle; so is sinkage, unless every torque and the bogie's angle are there.
    Torque, acceleration and the bogie's angle are optional. Roll, lateral velocity and yaw rate
    tell a model by axle whether the rover is planar at all, and nothing else. A model by wheel
    needs them; its arrays have shape ``[wheels]``, front to rear, left before right. Models know
    sinkage from undisturbed ground: ``estimator/wheel_tracks.py`` makes it of a local one.
    """

    stamp_ns: int
    slip: Floats  # [1] i = 1 - v / (r w)
    slip_sd: Floats  # [1]
    sinkage: Floats  # [m]
    sinkage_sd: Floats  # [m]
    contact_angle: Floats  # [rad] ground relative to the body, positive where it climbs
    contact_angle_sd: Floats  # [rad]
    wheel_rate: Floats  # [rad/s]
    torque: Floats  # [N m] drive torque of ONE wheel of the axle
    torque_sd: Floats  # [N m]
    velocity: float  # [m/s] along body x
    velocity_sd: float  # [m/s]
    pitch: float  # [rad] nose up (the negative of REP-103 pitch)
    pitch_sd: float  # [rad]
    acceleration: float  # [m/s^2] specific force along body x: dv/dt + g sin(pitch)
    acceleration_sd: float  # [m/s^2]
    bogie_angle: float = math.nan  # [rad] of the bogie relative to the body, nose up
    roll: float = math.nan  # [rad] of body y above the horizon, left side up
    roll_sd: float = math.nan  # [rad]
    lateral_velocity: float = math.nan  # [m/s] along body y, to the left
    lateral_velocity_sd: float = math.nan  # [m/s]
    yaw_rate: float = math.nan  # [rad/s] to the left
    yaw_rate_sd: float = math.nan  # [rad/s]
    steering: Floats | None = None  # [rad] to the left, of each wheel; None: nothing steers them
    local: bool = False  # whether sinkage is from the ground right before each wheel


AXLE_FIELDS = tuple(field.name for field in fields(Observation) if field.type is Floats)
"""Names of the arrays, in order."""

SCALAR_FIELDS = tuple(field.name for field in fields(Observation) if field.type is float)
"""Names of the measured scalars, in order. The fields are the stamp, the arrays, the scalars."""

OFF_PLANE = (
    "roll", "roll_sd", "lateral_velocity", "lateral_velocity_sd", "yaw_rate", "yaw_rate_sd",
    "steering",
)  # fmt: skip
"""Names of what makes a motion other than planar: no other observation depends on them."""

NOT_SAVED = (*OFF_PLANE, "local")
"""Names of what the next observation does not depend on."""
