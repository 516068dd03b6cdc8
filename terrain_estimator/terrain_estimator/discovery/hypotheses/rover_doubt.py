# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Constants of the rover file that are known within a stated deviation.

They are unknowns of every hypothesis, "nothing is missing" among them, and all runs share them. The
value of one is its difference from the file in stated deviations: mean 0, deviation 1, within
WITHIN. The rows are those of a rover that has the constants, so that no physics is written for
them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any

from rover_parameters.records import ConfigError, nearest
from terramechanics.vehicle.rover import Rover

DOUBTABLE = (
    "mass",
    "wheel_radius",
    "wheel_width",
    "centre_of_mass_x",
    "centre_of_mass_height",
)
"""Keys of the rover file whose deviation can be stated."""
WITHIN = 3.0
"""[1] Stated deviations up to which a constant is a matter of its tolerance.

Beyond it is missing from the model: an effect may be named.
"""
NOTABLE = 2.0
"""[1] Stated deviations of a constant's change from which it is pointed at."""
ORDINARY = {"mass": 0.01, "wheel_radius": 0.003}
"""[1] Standard deviations over the constant, taken where nobody states any.

Masses that are summed part by part, a wheel that is measured with a rule.
"""
ORDINARY_CENTRE = 0.01
"""[1] The same of the centre of mass along the body, over the wheelbase."""
STEP = 0.01
"""[1] Of differences, in stated deviations."""
STANDS_FOR = {"payload": "mass", "odometry_scale": "wheel_radius"}
"""Effects that stand for a constant of the rover file which is wrong beyond its deviation.

Beside such an effect the constant is held as told, so that the size is the whole of what is wrong.
"""
HELD = 0.01
"""[1] Share of its stated deviation within which a constant is held."""


@dataclass(frozen=True, slots=True)
class RoverConstant:
    """A constant of the rover file and its stated deviation, in the unit of the file."""

    name: str
    told: float
    sd: float

    @property
    def unit(self) -> str:
        """Unit of both."""
        return str(next(each for each in fields(Rover) if each.name == self.name).metadata["unit"])

    def at(self, value: float) -> float:
        """Return the constant where it is off by ``value`` stated deviations."""
        return self.told + value * self.sd


RoverDoubt = tuple[RoverConstant, ...]
CERTAIN: RoverDoubt = ()
"""The rover file is exact."""


def rover_doubt(rover: Rover, deviations: Mapping[str, float]) -> RoverDoubt:
    """Return the constants of a rover with these stated deviations, in the order of DOUBTABLE.

    A deviation of 0 is that of an exact constant.

    Raises:
        ConfigError: a key cannot be in doubt, a deviation is no number from 0 on, or constants that
            are off by WITHIN deviations are those of no rover.
    """
    for name, sd in deviations.items():
        if name not in DOUBTABLE:
            raise ConfigError(f"{name!r} has no deviation here: {nearest(name, DOUBTABLE)}")
        if not math.isfinite(sd) or sd < 0.0:
            raise ConfigError(
                f"{name}={sd:g} is no deviation: give a number from 0 on, in the unit of"
                " the rover file"
            )
    found = tuple(
        RoverConstant(name, getattr(rover, name), deviations[name])
        for name in DOUBTABLE
        if deviations.get(name, 0.0) > 0.0
    )
    for ends in product((-WITHIN, WITHIN), repeat=len(found)):
        try:
            changed = rover_with(rover, found, ends)
        except ConfigError as error:
            raise ConfigError(_too_large(found, str(error))) from error
        for each in found:
            if each.name in _POSITIVE and getattr(changed, each.name) <= 0.0:
                raise ConfigError(_too_large((each,), f"{each.name} would not be positive"))
    return found


_POSITIVE = ("mass", "wheel_radius", "wheel_width", "centre_of_mass_height")


def ordinary_doubt(rover: Rover) -> RoverDoubt:
    """Return the doubt of a rover file whose deviations nobody stated.

    The centre of mass is left out where it lies so near to an end that no rover has its limits.
    """
    stated = {name: share * getattr(rover, name) for name, share in ORDINARY.items()}
    centre = ORDINARY_CENTRE * (rover.axle_x[0] - rover.axle_x[-1])
    try:
        return rover_doubt(rover, stated | {"centre_of_mass_x": centre})
    except ConfigError:
        return rover_doubt(rover, stated)


def is_within(doubt: RoverDoubt, sizes: Iterable[tuple[str, float]]) -> bool:
    """Return whether one of these effects is no more than its constant may be off by.

    ``sizes`` are names and sizes of effects. One that stands for no constant in doubt is not.
    """
    constants = {each.name: each for each in doubt}
    for name, size in sizes:
        there = constants.get(STANDS_FOR.get(name, ""))
        if there and abs(standing_for(there, size) - there.told) < WITHIN * there.sd:
            return True
    return False


def _too_large(found: RoverDoubt, why: str) -> str:
    stated = ", ".join(f"{each.name}={each.sd:g}" for each in found)
    return (
        f"{stated}: constants that are off by {WITHIN:g} deviations are those of no rover"
        f" ({why}): give smaller deviations, in the unit of the rover file"
    )


def rover_with(rover: Rover, doubt: RoverDoubt, values: Sequence[float]) -> Rover:
    """Return a rover whose constants are off by ``values`` stated deviations, the same for none."""
    if not doubt:
        return rover
    off = zip(doubt, values, strict=True)
    changes: dict[str, Any] = {each.name: each.at(value) for each, value in off}
    return replace(rover, **changes)


def held(doubt: RoverDoubt, effects: Iterable[str]) -> RoverDoubt:
    """Return the constants in doubt where those that named effects stand for are held as told."""
    exact = {STANDS_FOR.get(name) for name in effects}
    return tuple(replace(each, sd=HELD * each.sd) if each.name in exact else each for each in doubt)


def standing_for(constant: RoverConstant, size: float) -> float:
    """Return the constant of the rover for which an effect of this ``size`` stands."""
    if constant.name == STANDS_FOR["odometry_scale"]:
        return constant.told / (1.0 + size)
    return constant.told + size


def doubts_radius(doubt: RoverDoubt) -> bool:
    """Return whether the wheels' radius, by which slip is computed, is in doubt."""
    return any(each.name == "wheel_radius" for each in doubt)


def radius_error(told: Rover, true: Rover) -> float:
    """Return the share by which a radius as told is too large, as ``odometry_scale`` has it."""
    return told.wheel_radius / true.wheel_radius - 1.0
