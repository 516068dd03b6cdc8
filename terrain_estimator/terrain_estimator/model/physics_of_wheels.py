# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The physics by wheel of a rover file, for exported models and for the search alike."""

from torch import Tensor, nn

from terrain_estimator.model.physics import Physics, RoverBody
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.row_names import row_names_by_wheel
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_balances import geometry_by_wheel
from terramechanics.vehicle.wheel_places import WheelPlaces, wheel_order


def physics_by_wheel(
    rover: Rover,
    places: WheelPlaces,
    constants: Tensor,
    constants_sd: float,
    forces: nn.Module | None = None,
    ground_variation: float = 0.0,
) -> PhysicsByWheel:
    """Return the physics on soils of ``constants`` [K, 6], known to ``constants_sd`` [1].

    ``forces`` and ``ground_variation`` as of :class:`PhysicsByWheel`.
    """
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
    axles = [rover.wheels[k].axle for k in wheel_order(rover)]
    nominal = Physics(body, constants, constants_sd)
    return PhysicsByWheel(nominal, side, places.yaw_inertia, rows, axles, forces, ground_variation)
