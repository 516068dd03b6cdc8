# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a configuration makes of an observation: sensors switched off, contact angles supposed."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.observation import Floats, Observation
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import wheel_order

STEEPEST_BOGIE = 1.2
"""[rad] No bogie turns further: an encoder in degrees, or without its zero."""


def as_configured(observation: Observation, rover: Rover, config: CoreConfig) -> Observation:
    """Return the observation with the sensors that ``config`` uses.

    Those that it switches off are NaN, and missing contact angles are what it supposes.
    """
    changes: dict[str, Floats | float] = {}
    if config.contact_angle_sd and np.isnan(observation.contact_angle).any():
        changes |= _supposed_angles(observation, rover, config.contact_angle_sd)
    if not config.use_sinkage:
        changes["sinkage"] = np.full_like(observation.sinkage, np.nan)
    if not config.use_torque:
        changes["torque"] = np.full_like(observation.torque, np.nan)
    if not config.use_imu:
        changes["acceleration"] = math.nan
    if not config.use_moments:
        changes["bogie_angle"] = math.nan
    if not changes:
        return observation
    return dataclasses.replace(observation, **changes)  # type: ignore[arg-type]


def _supposed_angles(observation: Observation, rover: Rover, deviation: float) -> dict[str, Floats]:
    """Return contact angles in which missing ones are along the body, or along the wheel's bogie.

    A bogie whose angle is not known leaves those of its wheels missing.
    """
    plane, bogie = np.zeros_like(observation.contact_angle), possible_bogie(observation)
    axles: Sequence[int] = range(rover.axles)
    if len(plane) > rover.axles:  # of a model by wheel
        axles = [rover.wheels[k].axle for k in wheel_order(rover)]
    for joint in rover.suspension:
        plane[[axle in joint.axles for axle in axles]] = bogie
    missing = np.isnan(observation.contact_angle)
    return {
        "contact_angle": np.where(missing, plane, observation.contact_angle),
        "contact_angle_sd": np.where(missing, deviation, observation.contact_angle_sd),
    }


def possible_bogie(observation: Observation) -> float:
    """Return the angle [rad] of the bogie, NaN where no bogie has such a one."""
    return observation.bogie_angle if abs(observation.bogie_angle) < STEEPEST_BOGIE else math.nan
