# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rovers whose constants are not those of the rover file that the workflow is told.

Mass, centre of mass and wheel radius are drawn, each with a stated deviation. What the rover
reports is computed with the radius of its file: slip from velocity and wheel rate, sinkage from the
angle at which a camera sees the edge of the soil on the rim.
"""

import dataclasses
import math
import random
from collections.abc import Mapping

from terramechanics.simulation.sample import Measurement
from terramechanics.vehicle.rover import Rover

Constants = tuple[tuple[str, float], ...]
"""Names of the rover file's keys, each with a number in its unit."""

SIZES = {
    "mass": lambda rover: rover.mass,
    "wheel_radius": lambda rover: rover.wheel_radius,
    "centre_of_mass_x": lambda rover: rover.axle_x[0] - rover.axle_x[-1],
}
"""Lengths and masses in which the stated deviations are drawn."""
STATED = {
    "mass": (0.005, 0.02),
    "wheel_radius": (0.002, 0.006),
    "centre_of_mass_x": (0.004, 0.014),
}
"""[1] Stated deviations lie log-uniformly between these, in SIZES."""
TOLERANCE = 2.5
"""[1] Stated deviations within which a constant's error is what was stated: Gaussian, cut off."""
BEYOND = (3.0, 5.0)
"""[1] Stated deviations of an error that was not stated, either way."""
NAMES = {"mass": "payload", "wheel_radius": "odometry_scale"}
"""Names that are right where a constant is BEYOND."""


def draw_constants(
    rover: Rover, drawn: random.Random, beyond: str = ""
) -> tuple[Constants, Constants]:
    """Draw stated deviations and errors (true less told); one constant may be ``beyond``."""
    stated, off = [], []
    for name, (least, most) in STATED.items():
        share = math.exp(drawn.uniform(math.log(least), math.log(most)))
        stated.append((name, share * SIZES[name](rover)))
        error = drawn.gauss(0.0, 1.0)
        while abs(error) > TOLERANCE:
            error = drawn.gauss(0.0, 1.0)
        if name == beyond:
            error = drawn.choice((-1.0, 1.0)) * drawn.uniform(*BEYOND)
        off.append((name, error * stated[-1][1]))
    return tuple(stated), tuple(off)


def beyond(stated: Constants, off: Constants) -> str:
    """Return the constant whose error was not stated; empty where every one was."""
    errors = dict(off)
    return "".join(name for name, sd in stated if abs(errors[name]) > TOLERANCE * sd)


def with_errors(told: Rover, off: Constants) -> Rover:
    """Return the true rover."""
    return dataclasses.replace(told, **{name: getattr(told, name) + by for name, by in off})


def missing_size(told: Rover, off: Mapping[str, float], name: str) -> float:
    """Return the size of the effect that stands for the error of a constant, as NAMES has it."""
    if name == "mass":
        return off[name]
    return told.wheel_radius / (told.wheel_radius + off[name]) - 1.0


def is_covered(name: str, size: float, told: Rover, stated: Mapping[str, float]) -> bool:
    """Return whether a stated deviation covers an effect of this name and size."""
    within = {
        "payload": TOLERANCE * stated.get("mass", 0.0),
        "odometry_scale": TOLERANCE * stated.get("wheel_radius", 0.0) / told.wheel_radius,
    }
    return abs(size) <= within.get(name, 0.0)


def by_radius(measured: Measurement, told: float, true: float) -> Measurement:
    """Return readings of wheels of the ``true`` radius [m] as computed with the one ``told``."""
    ratio = true / told
    return dataclasses.replace(
        measured,
        slip=1.0 - (1.0 - measured.slip) * ratio,
        slip_sd=measured.slip_sd * ratio,
        sinkage=measured.sinkage / ratio,
        sinkage_sd=measured.sinkage_sd / ratio,
    )
