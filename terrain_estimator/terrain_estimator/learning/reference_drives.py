# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulate the reference drives by which a configuration's sensors are judged."""

import dataclasses
from typing import Any

import torch

from terrain_estimator.model.metadata import Metadata
from terrain_estimator.observation import Observation
from terramechanics.simulation.sample import TIME_STEP, Measurement
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

SECONDS = 40.0
"""[s] Length of a drive, that of docs/bring_your_own_sensors.md."""
SCHEDULE = "S1"
"""Over hills, with every sensor of the simulator."""


def measured_drives(metadata: Metadata, seconds: float = SECONDS) -> dict[str, list[Observation]]:
    """Return what a model's rover measures on each of its soils, with the prior's c and tan phi.

    All soils have one contact law. Takes a quarter of a minute.
    """
    generator, soils = torch.Generator().manual_seed(1), metadata.soils
    strength = torch.tensor([metadata.prior_mean] * len(soils), dtype=torch.float64)
    constants = torch.stack([soil.constants() for soil in soils])
    ground = Ground([Patch(constants, strength, name=soils[0].name, law=soils[0].law)])
    drive = simulate(metadata.rover, ground, SCHEDULE, seconds, generator, len(soils))
    measured = measure_drive(metadata.rover, drive.seen, Noise(), generator)
    return {soil.name: _observations(measured, index) for index, soil in enumerate(soils)}


def _observations(measured: Measurement, index: int) -> list[Observation]:
    known = {field.name for field in dataclasses.fields(Observation)}
    names = [field.name for field in dataclasses.fields(measured) if field.name in known]
    batch, time = measured.velocity.shape
    series = {}
    for name in names:
        values = getattr(measured, name)
        series[name] = (values if values.ndim == 3 else values.expand(batch, time))[index].numpy()
    drive = []
    for step in range(time):
        at: dict[str, Any] = {
            name: each[step] if each.ndim > 1 else float(each[step])
            for name, each in series.items()
        }
        drive.append(Observation(round((step + 1) * TIME_STEP * 1e9), **at))
    return drive
