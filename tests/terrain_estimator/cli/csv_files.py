# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A CSV file of a small rover, its mapping, and the command that converts it."""

from pathlib import Path
from typing import Any

import yaml

from terrain_estimator.bags import BagReader
from terrain_estimator.cli.csv_to_bag import main

HEADER = "t,v,p,a,s1,s2,z1,z2,w1,w2,q1,q2"


ROVER = {
    "name": "tricycle",
    "mass": 3.0,
    "gravity": 9.81,
    "wheel_radius": 0.017,
    "wheel_width": 0.02,
    "wheel_inertia": 0.0,
    "axle_x": [0.2, 0.0, -0.2],
    "centre_of_mass_x": 0.0,
    "centre_of_mass_height": 0.1,
    "bogie_pivot_x": -0.1,
    "bogie_pivot_height": 0.1,
    "cruise_speed": [0.05, 0.15],
    "sinkage_noise_floor": 0.0005,
    "wheels": [
        {"name": name, "axle": axle, "side": "left"}
        for axle, name in enumerate(("front", "middle", "rear"))
    ],
}
"""The middle wheel is not measured: the mapping leaves it out."""


ROWS = ["0.5,100,2,0.1,10,-20,12,11,60,60,5,6", "0.6,101,2,0.1,20,30,,10,60,30,7,8"]


def mapping(**changes: Any) -> dict[str, Any]:
    """Return a mapping of two wheels; a change to None removes a key."""
    whole: dict[str, Any] = {
        "time": {"column": "t"},
        "slip_definition": "max_normalised",
        "wheels": [
            {"name": "front", "slip": "s1", "sinkage": "z1", "wheel_rate": "w1", "torque": "q1"},
            {"name": "rear", "slip": "s2", "sinkage": "z2", "wheel_rate": "w2", "torque": "q2"},
        ],
        "slip": {"unit": "%", "noise": {"relative": 0.05, "absolute": 1.0}},
        "sinkage": {"unit": "mm", "noise": {"relative": 0.1, "absolute": 0.5}},
        "constant_contact_angle": {"value": 1.0, "unit": "deg", "noise": {"absolute": 0.5}},
        "wheel_rate": {"unit": "rpm"},
        "torque": {"unit": "N cm", "noise": {"relative": 0.03, "absolute": 10.0}},
        "velocity": {"column": "v", "unit": "mm/s", "noise": {"absolute": 2.0}},
        "pitch": {
            "column": "p",
            "unit": "deg",
            "positive": "nose_down",
            "noise": {"absolute": 0.5},
        },
        "acceleration": {"column": "a", "unit": "g", "noise": {"absolute": 0.01}},
    }
    return {key: value for key, value in {**whole, **changes}.items() if value is not None}


def run(
    folder: Path, content: dict[str, Any], lines: list[str] | None = None, rover: str = ""
) -> int:
    """Run csv_to_bag on files in a folder; the bag is folder/bag."""
    (folder / "rover.yaml").write_text(yaml.safe_dump(ROVER), encoding="utf-8")
    (folder / "map.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    (folder / "data.csv").write_text(
        "\n".join([HEADER, *ROWS] if lines is None else lines), encoding="utf-8"
    )
    return main(
        [
            str(folder / "data.csv"),
            "--mapping",
            str(folder / "map.yaml"),
            "--out",
            str(folder / "bag"),
            "--rover",
            rover or str(folder / "rover.yaml"),
        ]
    )


def messages(folder: Path, topic: str) -> list[Any]:
    with BagReader(folder) as reader:
        return [reader.decode(message) for message in reader.messages([topic])]
