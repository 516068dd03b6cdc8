# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The logs in ``bags/foreign``: their columns, their truth, and a noisy copy for csv_to_bag.

A log is clean. Here it gets the noise of docs/simulator.md, and the mapping says so, as for a run
that a user measured.
"""

import csv
import gzip
import math
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from docs.provenance import ROOT
from terramechanics.presets import load_rover
from terramechanics.simulation.sensors import Noise
from terramechanics.vehicle.rover import Rover

FOLDER = ROOT / "bags" / "foreign" / "logs"
ENDING = ".csv.gz"
TRUTH = {"A": (800.0, math.tan(math.radians(31.0))), "B": (300.0, math.tan(math.radians(28.0)))}
"""c [Pa] and tan phi of each soil."""
SINKAGES = {"original": "sinkage", "rut": "sinkage_rut"}
"""Columns of the sinkage: below the original surface, below the surface just ahead of the wheel."""

Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Log:
    """One drive of Chrono's SCM terrain, 10 Hz."""

    soil: str
    drive: str
    law: str
    columns: dict[str, Column]  # [T] each, SI units; see bags/foreign/README.md

    @property
    def name(self) -> str:
        """Name of its file, without the ending."""
        return f"{self.soil}_{self.drive}_{self.law}"

    @property
    def truth(self) -> Column:
        """True c [Pa] and tan phi [2]."""
        return np.array(TRUTH[self.soil])


def log_names(folder: Path = FOLDER) -> list[str]:
    """Return the names of all logs, in order."""
    return sorted(path.name.removesuffix(ENDING) for path in folder.glob(f"*{ENDING}"))


def read_log(name: str, folder: Path = FOLDER) -> Log:
    """Read a log by its name, SOIL_DRIVE_LAW. Raises OSError and ValueError."""
    soil, drive, law = name.split("_")
    with gzip.open(folder / f"{name}{ENDING}", "rt", encoding="ascii", newline="") as file:
        head, *rows = csv.reader(file)
    values = np.array(rows, dtype=np.float64)
    return Log(soil, drive, law, dict(zip(head, values.T, strict=True)))


def measured_columns(
    log: Log, rover: Rover, seed: int, sinkage: str = "original"
) -> dict[str, Column]:
    """Return what sensors measure of a log, [T] each, under the names that the mapping has.

    The noise is that of docs/simulator.md, drawn anew for each log and ``seed``; bogie and wheel
    rates are exact, as in the simulator.
    """
    noise, generator = Noise(), np.random.default_rng([seed, zlib.crc32(log.name.encode())])

    def noisy(name: str, relative: float, absolute: float) -> Column:
        true = log.columns[name]
        spread = np.hypot(relative * true, absolute)
        return true + spread * generator.standard_normal(len(true))

    bias = noise.acceleration * generator.standard_normal()
    found = {
        "time": log.columns["time"],
        "velocity": noisy("velocity", 0.0, noise.velocity),
        "pitch": noisy("pitch", 0.0, noise.pitch),
        "acceleration": noisy("acceleration", 0.0, noise.acceleration) + bias,
        "bogie": log.columns["bogie"],
    }
    torque = noise.torque_of_load * _torque_unit(rover)
    for wheel in rover.wheel_names:
        found[f"{wheel}_rate"] = log.columns[f"{wheel}_rate"]
        found[f"{wheel}_slip"] = noisy(f"{wheel}_slip", noise.slip_relative, noise.slip)
        found[f"{wheel}_sinkage"] = noisy(
            f"{wheel}_{SINKAGES[sinkage]}", noise.sinkage_relative, rover.sinkage_noise_floor
        )
        found[f"{wheel}_contact"] = noisy(f"{wheel}_contact", 0.0, noise.contact_angle)
        found[f"{wheel}_torque"] = noisy(f"{wheel}_torque", noise.torque_relative, torque)
    return found


def _torque_unit(rover: Rover) -> float:
    return 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)


def mapping_of(rover: Rover) -> dict[str, Any]:
    """Return the mapping of the columns of :func:`measured_columns` for csv_to_bag."""
    noise = Noise()

    def signal(unit: str, relative: float, absolute: float, **more: str) -> dict[str, Any]:
        spread = {"relative": float(relative), "absolute": float(absolute)}
        return {**more, "unit": unit, "noise": spread}

    names = {"slip": "slip", "sinkage": "sinkage", "contact_angle": "contact"} | {
        "wheel_rate": "rate",
        "torque": "torque",
    }
    wheels = [
        {"name": wheel} | {key: f"{wheel}_{end}" for key, end in names.items()}
        for wheel in rover.wheel_names
    ]
    torque = noise.torque_of_load * _torque_unit(rover)
    # the accelerometer's deviation holds its constant bias, too
    sensed = math.sqrt(2.0) * noise.acceleration
    return {
        "time": {"column": "time", "unit": "s"},
        "frame": "base_link",
        "slip_definition": "one_minus_v_over_rw",
        "wheels": wheels,
        "slip": signal("1", noise.slip_relative, noise.slip),
        "sinkage": signal("m", noise.sinkage_relative, rover.sinkage_noise_floor),
        "contact_angle": signal("rad", 0.0, noise.contact_angle),
        "wheel_rate": signal("rad/s", 0.0, 0.0),
        "torque": signal("N m", noise.torque_relative, torque),
        "velocity": signal("m/s", 0.0, noise.velocity, column="velocity"),
        "pitch": signal("rad", 0.0, noise.pitch, column="pitch", positive="nose_up"),
        "acceleration": signal("m/s^2", 0.0, sensed, column="acceleration"),
        "bogie_angle": signal("rad", 0.0, 0.0, column="bogie", positive="nose_up"),
    }


def write_measured(
    log: Log, prefix: Path, seed: int, sinkage: str = "original"
) -> tuple[Path, Path]:
    """Write PREFIX.csv and PREFIX.yaml, what csv_to_bag takes, and return the two paths."""
    rover = load_rover("mars_rover")
    columns = measured_columns(log, rover, seed, sinkage)
    data, mapping = prefix.with_suffix(".csv"), prefix.with_suffix(".yaml")
    with data.open("w", encoding="ascii", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(_cells(columns.values()))
    mapping.write_text(yaml.safe_dump(mapping_of(rover), sort_keys=False), encoding="ascii")
    return data, mapping


def _cells(columns: Iterable[Column]) -> list[list[str]]:
    return [[f"{value:.7g}" for value in row] for row in np.column_stack(list(columns)).tolist()]
