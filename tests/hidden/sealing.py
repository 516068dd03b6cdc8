# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sealed bags of a case: the estimator's input topics only, under neutral names."""

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import torch

from terrain_estimator.bags import BagWriter
from terrain_estimator.importing.mapping import (
    BodySignal,
    Mapping,
    SignalNoise,
    Time,
    WheelColumns,
    WheelSignal,
)
from terrain_estimator.importing.messages import SampleWriter
from terrain_estimator.importing.samples import MeasuredValue, TableSample
from terramechanics.simulation.sample import TIME_STEP, Measurement
from terramechanics.vehicle.rover import Rover
from tests.hidden.cases import Case

START_NS = 1_000 * 1_000_000_000
STEP_NS = round(TIME_STEP * 1e9)
COLUMN = "column"
"""Name of every column, which is not in the bags."""


def seal(case: Case, folder: Path) -> list[Path]:
    """Write the drives of a case to bags run_1, run_2, ... in a new ``folder``; return them."""
    folder.mkdir(parents=True, exist_ok=True)
    bags = []
    for number, drive in enumerate(case.drives, start=1):
        bags.append(folder / f"run_{number}")
        with BagWriter(bags[-1]) as writer:
            SampleWriter(writer, _mapping(case.rover, drive)).write_all(samples(drive))
    return bags


def samples(drive: Measurement) -> Iterator[TableSample]:
    """Return the samples of one drive [time, wheels] for the writer of bags."""
    slips, sinkages, angles = (_pairs(drive, name) for name in ("slip", "sinkage", "contact_angle"))
    velocities, pitches, accelerations = (
        _pairs(drive, name) for name in ("velocity", "pitch", "acceleration")
    )
    rates, torques, bogie_angles = (
        drive.wheel_rate.tolist(),
        drive.torque.tolist(),
        drive.bogie_angle.tolist(),
    )
    for k in range(drive.velocity.shape[0]):
        yield TableSample(
            stamp_ns=START_NS + k * STEP_NS,
            slip=[MeasuredValue(*pair) for pair in slips[k]],
            sinkage=[MeasuredValue(*pair) for pair in sinkages[k]],
            contact_angle=[MeasuredValue(*pair) for pair in angles[k]],
            wheel_rate=rates[k],
            torque=torques[k],
            velocity=MeasuredValue(*velocities[k]),
            pitch=MeasuredValue(*pitches[k]),
            acceleration=MeasuredValue(*accelerations[k]),
            bogie_angle=bogie_angles[k],
        )


def _pairs(drive: Measurement, name: str) -> list:  # type: ignore[type-arg]
    """Return value and deviation as nested lists [time, ..., 2]."""
    value = getattr(drive, name)
    deviation = torch.as_tensor(getattr(drive, f"{name}_sd")).expand_as(value)
    return torch.stack([value, deviation], dim=-1).tolist()


def _mapping(rover: Rover, drive: Measurement) -> Mapping:
    """Return the mapping of the signals; its deviations are required but unused."""
    some = SignalNoise(absolute=1.0)
    mapping = Mapping(
        time=Time(COLUMN),
        wheels=tuple(
            WheelColumns(wheel, COLUMN, COLUMN, COLUMN, COLUMN) for wheel in rover.wheel_names
        ),
        slip=WheelSignal("1", some),
        sinkage=WheelSignal("m", some),
        contact_angle=WheelSignal("rad", some),
        wheel_rate=WheelSignal("rad/s"),
        velocity=BodySignal(COLUMN, "m/s", some),
        pitch=BodySignal(COLUMN, "rad", some, positive="nose_up"),
        acceleration=BodySignal(COLUMN, "m/s^2", some),
        bogie_angle=BodySignal(COLUMN, "rad", positive="nose_up"),
    )
    if math.isnan(float(drive.torque[0, 0])):
        return mapping
    wheels = tuple(dataclasses.replace(wheel, torque=COLUMN) for wheel in mapping.wheels)
    return dataclasses.replace(mapping, wheels=wheels, torque=WheelSignal("N m"))
