# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model of a rover whose wheels are estimated one by one: its physics, without a net."""

import math
from collections.abc import Sequence

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics import Physics, RoverBody
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terrain_estimator.model.row_names import row_names_by_wheel
from terramechanics.terrain.soil import WONG_REECE, Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_balances import geometry_by_wheel
from terramechanics.vehicle.wheel_places import WheelPlaces

BODY_PARAMETERS = ("centre_of_mass_y", "roll_bias")
"""[m], [rad] Names of the parameters that stand where other models have learnt weights."""
ROLL_BIAS_SD = math.radians(0.5)
"""[rad] Deviation of the constant error of the roll: how well an imu is aligned to the body."""


def build_model_by_wheel(
    rover: Rover, places: WheelPlaces, soils: Sequence[Soil], prior: Prior = DEFAULT_PRIOR
) -> PAlpaca:
    """Return the model of a rover that may turn, on these soils.

    Raises ConfigError where a soil has another contact law than Wong and Reece's.
    """
    for soil in soils:
        if soil.law != WONG_REECE:
            raise ConfigError(
                f"soil {soil.name}: a model by wheel knows law {WONG_REECE} alone, not {soil.law}"
            )
    geometry, side = geometry_by_wheel(rover, places.track_width)
    rows = row_names_by_wheel(len(rover.wheels), len(rover.suspension))
    body = RoverBody(
        rows,
        len(rover.wheels),
        1,
        rover.mass,
        rover.gravity,
        rover.wheel_radius,
        rover.wheel_width,
        geometry,
    )
    constants = torch.stack([soil.constants() for soil in soils])
    physics = PhysicsByWheel(Physics(body, constants, prior.constants_sd), side, places.yaw_inertia)
    model = PAlpaca(physics, body_columns(rover, rows), prior)
    always = torch.tensor([0.0, 1.0], dtype=torch.float64)
    model.hypotheses.net_log_weight.copy_(always.log())
    deviations = torch.tensor([prior.centre_of_mass_sd, ROLL_BIAS_SD], dtype=torch.float64)
    model.hypotheses.net_precision.copy_(deviations**-2)
    return model


def body_columns(rover: Rover, rows: Sequence[str]) -> NetFeatures:
    """Return the columns [R, 2] of BODY_PARAMETERS, in the place of a net.

    A planar rover has neither, so that the parameters that are the rover's own lack them. The net
    is constant: what a centre of mass further to the left changes in the roll moment, and what a
    roll that is read too large changes in the target of the lateral velocity.
    """
    distinct = [row for row in rows if row != "acceleration"]
    changes = {
        "roll_moment": -1.0 / (rover.axle_x[0] - rover.axle_x[-1]),
        "lateral_velocity": rover.gravity,
    }
    scale = torch.tensor([changes.get(row, 0.0) for row in distinct], dtype=torch.float64)
    columns = NetFeatures(len(rover.wheels), len(changes), 1, 1.0, scale)
    for parameter in columns.parameters():
        parameter.requires_grad = False
        parameter.zero_()
    bias = columns.state_dict()["layers.4.bias"].view(len(distinct), -1)  # shares its memory
    for column, row in enumerate(changes):
        bias[distinct.index(row), column] = 1.0
    return columns
