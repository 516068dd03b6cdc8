# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge models by wheel on the drives in ``bags/foreign/turns``, another engine's rovers that turn.

Called by ``make foreign-turns``, which prints the tables of docs/lateral.md.
"""

import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.stats import norm

from studies.by_wheel.drives import model_of_soils
from studies.by_wheel.motions import ANGLE_SD, without_angles, without_torques
from studies.command import study_parser
from studies.foreign.logs import (
    TURNS,
    Log,
    log_names,
    measured_columns,
    read_log,
    wheel_noise,
)
from studies.foreign.models import SCM_SAND
from studies.foreign.scores import FAR
from studies.tables import table
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.observation import Floats, Observation
from terramechanics.presets import load_rover, load_soil, soil_names
from terramechanics.simulation.sensors import LATERAL_SD, YAW_RATE_SD, Noise
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces, wheel_order

TRACKS = {"four_wheel_rover": 0.57, "mars_rover": 1.0}
"""[m] Distance of left and right wheels."""
SEED = 0
SOILS = {
    "three soils": [load_soil(name) for name in soil_names()],
    "constants of SCM": [SCM_SAND],
}
"""Soils of the models: those that ship, SCM's own; the law is the project's."""


def places_of(rover: Rover) -> WheelPlaces:
    """Return the places of the wheels of a rover of the logs; the six-wheel one steers all."""
    steered = rover.wheel_names if rover.suspension else ()
    return WheelPlaces.of(rover, TRACKS[rover.name], steered)


def observations_by_wheel(columns: Mapping[str, Floats], rover: Rover) -> list[Observation]:
    """Return the observations of measured columns, as the node makes them of a bag's messages."""
    noise, names = Noise(), [rover.wheel_names[k] for k in wheel_order(rover)]

    def wheels(end: str) -> Floats:
        return np.stack([columns[f"{name}_{end}"] for name in names], 1)

    single = {"wheel_rate": wheels("rate"), "steering": wheels("steering")}
    for name, (end, relative, absolute) in wheel_noise(rover).items():
        single[name] = wheels(end)
        single[f"{name}_sd"] = np.hypot(relative * single[name], absolute)
    deviations = {
        "velocity": noise.velocity,
        "pitch": noise.pitch,
        "acceleration": math.sqrt(2.0) * noise.acceleration,
        "roll": noise.pitch,
        "lateral_velocity": LATERAL_SD,
        "yaw_rate": YAW_RATE_SD,
    }
    stamps = np.round(columns["time"] * 1e9).astype(np.int64).tolist()
    bogie = columns.get("bogie", np.zeros(len(stamps)))
    observations = []
    for k, stamp in enumerate(stamps):
        values: dict[str, Any] = {name: each[k] for name, each in single.items()}
        values |= {name: float(columns[name][k]) for name in deviations}
        values |= {f"{name}_sd": deviation for name, deviation in deviations.items()}
        observations.append(Observation(stamp, **values, bogie_angle=float(bogie[k])))
    return observations


@dataclass(frozen=True, slots=True)
class Sensors:
    """What a line of the table measures."""

    words: str
    core: CoreConfig
    read: Callable[[Observation], Observation] = lambda observation: observation


SENSORS = (
    Sensors("all", CoreConfig()),
    Sensors("no torques", CoreConfig(), without_torques),
    Sensors("no contact angles", CoreConfig(contact_angle_sd=ANGLE_SD), without_angles),
    Sensors("no sinkages", CoreConfig(use_sinkage=False)),
)


@dataclass(frozen=True, slots=True)
class Turned:
    """What was published in one drive of T observations."""

    statuses: list[Status]  # [T]
    z: Floats  # [T, 2] error of the published mean over its deviation
    inside: bool  # whether the last published 95 % intervals hold the truth
    forecasts: int  # of the next velocity
    forecasts_hold: int  # whose 95 % interval holds the measured one

    @property
    def far(self) -> bool:
        """Whether an answer was IDENTIFIED and FAR at any time."""
        known = np.array([status is Status.IDENTIFIED for status in self.statuses])
        return bool((known & (np.abs(self.z).max(1) > FAR)).any())


def turned(log: Log, model: LoadedModel, sensors: Sensors) -> Turned:
    """Run the node's estimator over a log."""
    columns = measured_columns(log, SEED)
    estimator, rows = Estimator(model, sensors.core), usable_rows(model.rows, sensors.core)
    observations = observations_by_wheel(columns, log.rover)
    updates = [estimator.update(sensors.read(each)) for each in observations]
    published = [each.estimate for each in updates]
    last = published[-1]
    innovation = np.array([each.prediction.innovation for each in updates])
    variance = np.array([each.prediction.innovation_variance for each in updates])
    made = np.isfinite(innovation)
    hold = innovation[made] ** 2 < norm.ppf(0.975) ** 2 * variance[made]
    return Turned(
        [status_of(each, rows) for each in updates],
        np.array([(e.mean - log.truth) / np.sqrt(np.diag(e.covariance)) for e in published]),
        bool(((last.lower_95 <= log.truth) & (log.truth <= last.upper_95)).all()),
        int(made.sum()),
        int(hold.sum()),
    )


HEAD = (
    "rover",
    "soils of the model",
    "sensors",
    "end DISAGREES",
    "end IDENTIFIED",
    "of these outside",
    "ever IDENTIFIED and far",
    "next velocity in its 95 %",
)


def lines(names: list[str]) -> Iterator[tuple[str, ...]]:
    """Yield the lines of the table for these logs."""
    logs = [read_log(name) for name in names]
    for name in sorted({log.rover.name for log in logs}):
        rover, own = load_rover(name), [log for log in logs if log.rover.name == name]
        for words, soils in SOILS.items():
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "model.pt"
                model = model_of_soils(rover, places_of(rover), soils, DEFAULT_PRIOR, path)
            for sensors in SENSORS:
                found = [turned(log, model, sensors) for log in own]
                ends = [each.statuses[-1] for each in found]
                known = [each for each in found if each.statuses[-1] is Status.IDENTIFIED]
                made = sum(each.forecasts for each in found)
                share = sum(each.forecasts_hold for each in found) / made if made else math.nan
                yield (
                    name,
                    words,
                    sensors.words,
                    f"{sum(status is Status.DISAGREES for status in ends)} of {len(found)}",
                    f"{len(known)}",
                    f"{sum(not each.inside for each in known)}",
                    f"{sum(each.far for each in found)}",
                    f"{100.0 * share:.1f} %",
                )


def main(argv: list[str] | None = None) -> int:
    """Print the table of docs/lateral.md about another engine's turns."""
    parser = study_parser("foreign.turns", main.__doc__)
    names = log_names(TURNS)
    parser.add_argument("--log", nargs="+", choices=names, default=names, help="logs")
    args = parser.parse_args(argv)
    torch.set_num_threads(1)
    sys.stdout.write(table(HEAD, lines(args.log)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
