# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What single wheels need beside a rover file: their places across, and what steers them.

The planar rover lets one wheel stand for those of an axle. Here every wheel is one of its own.
"""

from dataclasses import dataclass
from itertools import pairwise

from rover_parameters.records import ConfigError, entry, number
from terramechanics.description.layout import wheel_sides
from terramechanics.vehicle.rover import Rover

STEEPEST_STEERING = 1.0
"""[rad] The motion across of a wheel steered further is badly known."""
UNDECIDED = 0.04
"""[1] Share of the other speeds below which a hub's velocity does not decide which edge leads.

It is below 1 - MAX_SLIP, so that Wong and Reece's range has one leading edge.
"""
WIDEST_SLIP = 3.0
"""[1] Slip, either way, up to which a single wheel is used: in a turn inner wheels turn back."""


@dataclass(frozen=True, slots=True)
class WheelPlaces:
    """What single wheels need beside the rover file."""

    track_width: float = number("distance of left and right wheels", "m", 0.0, exclusive=True)
    yaw_inertia: float = number(
        "moment of inertia of the rover about the vertical", "kg m^2", 0.0, exclusive=True
    )
    steered: tuple[str, ...] = entry("names of the wheels that a joint NAME_steering turns", ())

    @classmethod
    def of(cls, rover: Rover, track_width: float, steered: tuple[str, ...] = ()) -> "WheelPlaces":
        """Return the places of a rover whose mass is that of a box over its wheels.

        Raises ConfigError where a name is no wheel of the rover, or the wheels have no room.
        """
        places = cls(track_width, box_inertia(rover, track_width), steered)
        places.check(rover)
        return places

    def wheels(self, rover: Rover) -> tuple[str, ...]:
        """Return the names of the wheels, front to rear, and left before right."""
        return tuple(rover.wheel_names[k] for k in wheel_order(rover))

    def steers(self, rover: Rover) -> tuple[bool, ...]:
        """Return whether a joint turns each of the ``wheels``."""
        return tuple(name in self.steered for name in self.wheels(rover))

    def check(self, rover: Rover) -> None:
        """Raise ConfigError where these are not the places of that rover's wheels."""
        if unknown := [name for name in self.steered if name not in rover.wheel_names]:
            raise ConfigError(
                f"steered: {', '.join(unknown)}: {rover.name} has the wheels"
                f" {', '.join(rover.wheel_names)}"
            )
        for axle in range(rover.axles):
            sides = [wheel.side for wheel in rover.wheels if wheel.axle == axle]
            if sides.count("left") != sides.count("right"):
                raise ConfigError(
                    f"wheels: axle {axle} of {rover.name} has the sides {', '.join(sides)}: give"
                    " each wheel its side, as many left as right"
                )
        places = sorted(set(wheel_sides(rover, self.track_width)))
        if any(right + rover.wheel_width > left for right, left in pairwise(places)):
            raise ConfigError(
                f"track_width {self.track_width:g} m has no room for wheels of"
                f" {rover.wheel_width:g} m: give the distance between the middles of left and right"
            )


def wheel_order(rover: Rover) -> tuple[int, ...]:
    """Return the wheels' numbers in the rover file, front to rear, and left before right."""
    wheels = rover.wheels
    return tuple(
        sorted(range(len(wheels)), key=lambda k: (wheels[k].axle, wheels[k].side != "left", k))
    )


def chassis_places(rover: Rover) -> list[int]:
    """Return where each wheel of the rover file stands in the order of a Chassis.

    That has the left wheels first, the outermost before those further in, each of these rows from
    front to rear.
    """
    places = []
    for index, wheel in enumerate(rover.wheels):
        alike = (wheel.axle, wheel.side)
        row = sum((each.axle, each.side) == alike for each in rover.wheels[:index])
        row += 0 if wheel.side == "left" else rover.wheels_per_axle // 2
        places.append(row * rover.axles + wheel.axle)
    return places


def box_inertia(rover: Rover, track_width: float) -> float:
    """Return the yaw inertia [kg m^2] of the mass spread evenly between the wheels."""
    length = rover.axle_x[0] - rover.axle_x[-1]
    return rover.mass * (length**2 + track_width**2) / 12.0
