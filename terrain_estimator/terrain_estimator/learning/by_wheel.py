# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model of a rover whose wheels are estimated one by one: its physics, without a net."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.model.body_columns import BodyColumns
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics import Physics, RoverBody
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terrain_estimator.model.row_names import ROLL_MOMENT, row_names_by_wheel
from terramechanics.terrain.soil import WONG_REECE, Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_balances import geometry_by_wheel
from terramechanics.vehicle.wheel_places import WheelPlaces, wheel_order

if TYPE_CHECKING:
    from terrain_estimator.model.net import NetFeatures

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
    nominal = Physics(body, constants, prior.constants_sd)
    axles = [rover.wheels[k].axle for k in wheel_order(rover)]
    physics = PhysicsByWheel(nominal, side, places.yaw_inertia, rows, axles)
    columns = cast("NetFeatures", body_columns(rover, rows))  # has the methods that are called
    model = PAlpaca(physics, columns, prior)
    always = torch.tensor([0.0, 1.0], dtype=torch.float64)
    model.hypotheses.net_log_weight.copy_(always.log())
    deviations = torch.tensor([prior.centre_of_mass_sd, ROLL_BIAS_SD], dtype=torch.float64)
    model.hypotheses.net_precision.copy_(deviations**-2)
    return model


def body_columns(rover: Rover, rows: Sequence[str]) -> BodyColumns:
    """Return the columns of BODY_PARAMETERS, in the place of a net.

    A planar rover has neither, so that the parameters that are the rover's own lack them. A centre
    of mass further to the left changes the roll moment, a roll that is read too large the target of
    the lateral velocity.
    """
    table = torch.zeros(len(rows), len(BODY_PARAMETERS), dtype=torch.float64)
    table[rows.index(ROLL_MOMENT), 0] = -1.0 / (rover.axle_x[0] - rover.axle_x[-1])
    table[rows.index("lateral_velocity"), 1] = rover.gravity
    return BodyColumns(table)
