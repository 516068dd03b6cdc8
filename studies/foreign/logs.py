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
from terramechanics.simulation.sensors import LATERAL_SD, YAW_RATE_SD, Noise
from terramechanics.vehicle.rover import Rover

STRAIGHT, TURNS = (ROOT / "bags" / "foreign" / name for name in ("logs", "turns"))
"""Folders of the drives straight ahead, and of those with turns and cross slopes."""
ENDING = ".csv.gz"
ROVERS = {"skid": "four_wheel_rover"}
"""Rovers other than mars_rover, by the kind of a log."""
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
    kind: str  # its contact law; where it turns its steering
    columns: dict[str, Column]  # [T] each, SI units; see bags/foreign/README.md

    @property
    def name(self) -> str:
        """Name of its file, without the ending."""
        return f"{self.soil}_{self.drive}_{self.kind}"

    @property
    def rover(self) -> Rover:
        """The rover that was driven."""
        return load_rover(ROVERS.get(self.kind, "mars_rover"))

    @property
    def turns(self) -> bool:
        """Whether it has what a model by wheel needs."""
        return "yaw_rate" in self.columns

    @property
    def truth(self) -> Column:
        """True c [Pa] and tan phi [2]."""
        return np.array(TRUTH[self.soil])


def log_names(folder: Path = STRAIGHT) -> list[str]:
    """Return the names of all logs of a folder, in order."""
    return sorted(path.name.removesuffix(ENDING) for path in folder.glob(f"*{ENDING}"))


def read_log(name: str) -> Log:
    """Read a log by its name, SOIL_DRIVE_KIND. Raises OSError and ValueError."""
    soil, drive, kind = name.split("_")
    folder = STRAIGHT if (STRAIGHT / f"{name}{ENDING}").exists() else TURNS
    with gzip.open(folder / f"{name}{ENDING}", "rt", encoding="ascii", newline="") as file:
        head, *rows = csv.reader(file)
    values = np.array(rows, dtype=np.float64)
    return Log(soil, drive, kind, dict(zip(head, values.T, strict=True)))


def wheel_noise(rover: Rover) -> dict[str, tuple[str, float, float]]:
    """Return the end of its columns and the relative and absolute deviation of a wheel's signal."""
    noise, unit = Noise(), 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)
    return {
        "slip": ("slip", noise.slip_relative, noise.slip),
        "sinkage": ("sinkage", noise.sinkage_relative, rover.sinkage_noise_floor),
        "contact_angle": ("contact", 0.0, noise.contact_angle),
        "torque": ("torque", noise.torque_relative, noise.torque_of_load * unit),
    }


def measured_columns(log: Log, seed: int, sinkage: str = "original") -> dict[str, Column]:
    """Return what sensors measure of a log, [T] each, under the names that the mapping has.

    The noise is that of docs/simulator.md, drawn anew for each log and ``seed``; angles of joints
    and wheel rates are exact, as in the simulator.
    """
    noise, generator = Noise(), np.random.default_rng([seed, zlib.crc32(log.name.encode())])
    rover = log.rover

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
    }
    for wheel in rover.wheel_names:
        found[f"{wheel}_rate"] = log.columns[f"{wheel}_rate"]
        for end, relative, absolute in wheel_noise(rover).values():
            true = SINKAGES[sinkage] if end == "sinkage" else end
            found[f"{wheel}_{end}"] = noisy(f"{wheel}_{true}", relative, absolute)
    exact = ["bogie"] if rover.suspension else []
    if log.turns:
        found["roll"] = noisy("roll", 0.0, noise.pitch)
        found["lateral_velocity"] = noisy("lateral_velocity", 0.0, LATERAL_SD)
        found["yaw_rate"] = noisy("yaw_rate", 0.0, YAW_RATE_SD)
        exact += [f"{wheel}_steering" for wheel in rover.wheel_names]
    return found | {name: log.columns[name] for name in exact}


def mapping_of(log: Log) -> dict[str, Any]:
    """Return the mapping of the columns of :func:`measured_columns` for csv_to_bag."""
    noise, rover = Noise(), log.rover

    def signal(unit: str, relative: float, absolute: float, **more: str) -> dict[str, Any]:
        spread = {"relative": float(relative), "absolute": float(absolute)}
        return {**more, "unit": unit, "noise": spread}

    units = {"slip": "1", "sinkage": "m", "contact_angle": "rad", "torque": "N m"}
    ends = {name: end for name, (end, _, _) in wheel_noise(rover).items()} | {"wheel_rate": "rate"}
    # the accelerometer's deviation holds its constant bias, too
    sensed = math.sqrt(2.0) * noise.acceleration
    found: dict[str, Any] = {
        "time": {"column": "time", "unit": "s"},
        "frame": "base_link",
        "slip_definition": "one_minus_v_over_rw",
        **{
            name: signal(units[name], relative, absolute)
            for name, (_, relative, absolute) in wheel_noise(rover).items()
        },
        "wheel_rate": signal("rad/s", 0.0, 0.0),
        "velocity": signal("m/s", 0.0, noise.velocity, column="velocity"),
        "pitch": signal("rad", 0.0, noise.pitch, column="pitch", positive="nose_up"),
        "acceleration": signal("m/s^2", 0.0, sensed, column="acceleration"),
    }
    if rover.suspension:
        found["bogie_angle"] = signal("rad", 0.0, 0.0, column="bogie", positive="nose_up")
    if log.turns:
        ends["steering"] = "steering"
        found["steering"] = signal("rad", 0.0, 0.0)
        found["roll"] = signal("rad", 0.0, noise.pitch, column="roll")
        found["lateral_velocity"] = signal("m/s", 0.0, LATERAL_SD, column="lateral_velocity")
        found["yaw_rate"] = signal("rad/s", 0.0, YAW_RATE_SD, column="yaw_rate")
    found["wheels"] = [
        {"name": wheel} | {name: f"{wheel}_{end}" for name, end in ends.items()}
        for wheel in rover.wheel_names
    ]
    return found


def write_measured(
    log: Log, prefix: Path, seed: int, sinkage: str = "original"
) -> tuple[Path, Path]:
    """Write PREFIX.csv and PREFIX.yaml, what csv_to_bag takes, and return the two paths."""
    columns = measured_columns(log, seed, sinkage)
    data, mapping = prefix.with_suffix(".csv"), prefix.with_suffix(".yaml")
    with data.open("w", encoding="ascii", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(_cells(columns.values()))
    mapping.write_text(yaml.safe_dump(mapping_of(log), sort_keys=False), encoding="ascii")
    return data, mapping


def _cells(columns: Iterable[Column]) -> list[list[str]]:
    return [[f"{value:.7g}" for value in row] for row in np.column_stack(list(columns)).tolist()]
