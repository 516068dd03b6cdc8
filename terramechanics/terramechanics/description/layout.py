# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Where the wheels of a planar rover are drawn in three dimensions.

Frame of the body (REP 103): x forward, y left, z up, origin on the ground line. The rover file has
no distance between left and right, which the planar rover does not need: ``track_width`` gives it.
"""

import math

from terramechanics.vehicle.rover import Rover

ROCKER, BOGIE = "rocker", "bogie"
"""Joints of the suspension, in joint_states and in the URDF."""
STEERING_SUFFIX = "_steering"
"""What the joint that steers a wheel adds to the wheel's name."""
_TRACK = 0.75
"""[wheelbases] Track where none is given: that of the Mars Exploration Rovers."""
_PITCH = 1.2
"""[wheel widths] From one wheel to the next one on the same side of an axle."""

Point = tuple[float, float, float]


def suspension_joints(rover: Rover) -> tuple[str, ...]:
    """Return the names of the suspension's joints, from the body outwards; a rigid one has none."""
    if not rover.suspension:
        return ()
    return (ROCKER, BOGIE) if rover.differential else (BOGIE,)


def track_width_of(rover: Rover, track_width: float = 0.0) -> float:
    """Return ``track_width`` [m], or where it is 0 that of a rover of this length."""
    return track_width or _TRACK * (rover.axle_x[0] - rover.axle_x[-1])


def wheel_sides(rover: Rover, track_width: float) -> list[float]:
    """Return y [m] of every wheel; those that share a side of an axle stand further in."""
    places = []
    for index, wheel in enumerate(rover.wheels):
        place = (wheel.axle, wheel.side)
        beside = sum((each.axle, each.side) == place for each in rover.wheels[:index])
        aside = 0.5 * track_width - _PITCH * rover.wheel_width * beside
        places.append(aside if wheel.side == "left" else -aside)
    return places


def wheel_centres(rover: Rover, track_width: float, bogie_angle: float = 0.0) -> list[Point]:
    """Return the centre [m] of every wheel, with the bogie turned nose-up by its angle [rad]."""
    centres = []
    for wheel, y in zip(rover.wheels, wheel_sides(rover, track_width), strict=True):
        x, z = rover.axle_x[wheel.axle], rover.wheel_radius
        for joint in (each for each in rover.suspension if wheel.axle in each.axles):
            ahead, above = x - joint.x, z - joint.height
            cos, sin = math.cos(bogie_angle), math.sin(bogie_angle)
            x, z = joint.x + ahead * cos - above * sin, joint.height + ahead * sin + above * cos
        centres.append((x, y, z))
    return centres
