# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model of a rover whose wheels are estimated one by one: its physics, without a net."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.model.constant_columns import ConstantColumns
from terrain_estimator.model.metadata import TORQUE_GAIN
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terrain_estimator.model.row_names import ROLL_MOMENT, row_names_by_wheel
from terramechanics.terrain.soil import WONG_REECE, Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

if TYPE_CHECKING:
    from terrain_estimator.model.net import NetFeatures

BODY_PARAMETERS = ("centre_of_mass_y", "roll_bias", TORQUE_GAIN, "torque_friction")
"""[m], [rad], [1], [N m] Names of the parameters that stand where other models have learnt weights.

The torque of a wheel is the measured one times 1 - torque_gain, less the friction against its rate.
"""
ROLL_BIAS_SD = math.radians(0.5)
"""[rad] Deviation of the constant error of the roll: how well an imu is aligned to the body."""


def build_model_by_wheel(
    rover: Rover,
    places: WheelPlaces,
    soils: Sequence[Soil],
    prior: Prior = DEFAULT_PRIOR,
    torque_sd: tuple[float, ...] = (),
) -> PAlpaca:
    """Return the model of a rover that may turn, on these soils.

    ``torque_sd`` are the deviations of the gain [1] and of the friction [N m] that all torques
    share, where these are not known.

    Raises ConfigError where a soil has another contact law than Wong and Reece's.
    """
    for soil in soils:
        if soil.law != WONG_REECE:
            raise ConfigError(
                f"soil {soil.name}: a model by wheel knows law {WONG_REECE} alone, not {soil.law}"
            )
    constants = torch.stack([soil.constants() for soil in soils])
    physics = physics_by_wheel(
        rover, places, constants, prior.constants_sd, ground_variation=prior.ground_variation
    )
    rows = row_names_by_wheel(len(rover.wheels), len(rover.suspension))
    body_sd = (prior.centre_of_mass_sd, ROLL_BIAS_SD, *torque_sd)
    # has the methods that are called
    columns = cast("NetFeatures", body_columns(rover, rows, len(body_sd)))
    model = PAlpaca(physics, columns, prior)
    always = torch.tensor([0.0, 1.0], dtype=torch.float64)
    model.hypotheses.net_log_weight.copy_(always.log())
    model.hypotheses.net_precision.copy_(torch.tensor(body_sd, dtype=torch.float64) ** -2)
    return model


def body_columns(rover: Rover, rows: Sequence[str], count: int) -> ConstantColumns:
    """Return the columns of the first ``count`` of BODY_PARAMETERS, in the place of a net.

    A planar rover has neither, so that the parameters that are the rover's own lack them. A centre
    of mass further to the left changes the roll moment, a roll that is read too large the target of
    the lateral velocity. Those of the torques depend on the observation: the physics adds them.
    """
    table = torch.zeros(len(rows), count, dtype=torch.float64)
    table[rows.index(ROLL_MOMENT), 0] = -1.0 / (rover.axle_x[0] - rover.axle_x[-1])
    table[rows.index("lateral_velocity"), 1] = rover.gravity
    return ConstantColumns(table)
