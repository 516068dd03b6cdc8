# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rovers of every kind: by axles and joints, and with front and rear exchanged."""

import dataclasses
import json
from pathlib import Path

import yaml

from terramechanics.presets import load_rover
from terramechanics.vehicle.rover import Joint, Rover


def mirrored(rover: Rover) -> Rover:
    """Return the rover with front and rear exchanged, as if it drove backwards."""
    last = rover.axles - 1
    return dataclasses.replace(
        rover,
        name=f"{rover.name}_mirrored",
        axle_x=tuple(-x for x in reversed(rover.axle_x)),
        centre_of_mass_x=-rover.centre_of_mass_x,
        bogie_pivot_x=None,
        bogie_pivot_height=None,
        joints=tuple(
            Joint((last - joint.axles[1], last - joint.axles[0]), -joint.x, joint.height)
            for joint in reversed(rover.suspension)
        ),
        wheels=tuple(
            dataclasses.replace(wheel, axle=last - wheel.axle) for wheel in reversed(rover.wheels)
        ),
    )


def rover_file(rover: Rover, path: Path) -> str:
    """Write the file of a rover; return its path, as parameters have it."""
    content = json.loads(json.dumps(rover.content()))  # YAML has lists alone
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return str(path)


MARS, PAPER = load_rover("mars_rover"), load_rover("paper_rover")
FOUR_WHEELS = load_rover("four_wheel_rover")
BOGIE_IN_FRONT = mirrored(dataclasses.replace(MARS, centre_of_mass_x=0.06))
UNEVEN = dataclasses.replace(FOUR_WHEELS, name="uneven", centre_of_mass_x=-0.05)
KINDS = (MARS, PAPER, FOUR_WHEELS, BOGIE_IN_FRONT, UNEVEN)
"""A bogie behind (twice), four wheels without a joint (twice), and a bogie in front."""
_EXAMPLES = Path(__file__).parents[1] / "docs" / "examples"
SIX_WHEELS = load_rover(_EXAMPLES / "six_wheel_rover.yaml")
EIGHT_WHEELS = load_rover(_EXAMPLES / "eight_wheel_rover.yaml")
FIXED_ROCKERS = load_rover(_EXAMPLES / "fixed_rocker_rover.yaml")
BY_WHEEL_ALONE = (SIX_WHEELS, EIGHT_WHEELS)
"""Whose loads balances do not determine, so that they are never planar."""
