# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model of a rover whose wheels are estimated one by one: its physics, without a net."""

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

CENTRE_OF_MASS_Y = "centre_of_mass_y"
"""Name of the parameter that stands where other models have a learnt weight."""


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
    model = PAlpaca(physics, centre_of_mass_column(rover, rows), prior)
    always = torch.tensor([0.0, 1.0], dtype=torch.float64)
    model.hypotheses.net_log_weight.copy_(always.log())
    model.hypotheses.net_precision.fill_(prior.centre_of_mass_sd**-2)
    return model


def centre_of_mass_column(rover: Rover, rows: Sequence[str]) -> NetFeatures:
    """Return the column [R] of the centre of mass [m] to the left, in the place of a net.

    A planar rover has none, so that the parameters that are the rover's own lack it. The net is one
    constant: what a shift of the centre changes in the roll moment.
    """
    distinct = [row for row in rows if row != "acceleration"]
    place = distinct.index("roll_moment")
    scale = torch.zeros(len(distinct), dtype=torch.float64)
    scale[place] = -1.0 / (rover.axle_x[0] - rover.axle_x[-1])
    column = NetFeatures(len(rover.wheels), 1, 1, 1.0, scale)
    for parameter in column.parameters():
        parameter.requires_grad = False
        parameter.zero_()
    column.state_dict()["layers.4.bias"][place] = 1.0  # shares its memory
    return column
