# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated drives as observations, for tests of the core."""

import dataclasses

import torch

from terrain_estimator.observation import Observation
from terramechanics.ground import Ground
from terramechanics.rover import Rover
from terramechanics.sensors import Measurement, Noise, measure_drive
from terramechanics.simulation import simulate
from terramechanics.soil import Soil

STEP_NS = 100_000_000


def drive_observations(rover: Rover, soil: Soil, duration_s: float, seed: int) -> list[Observation]:
    """Observations of one S1 drive with the noise of the benchmarks."""
    generator = torch.Generator().manual_seed(seed)
    drive = simulate(rover, Ground.constant(soil), "S1", duration_s, generator, 1)
    return observations_of(measure_drive(rover, drive.sample, Noise(), generator), 0)


def observations_of(measurement: Measurement, index: int) -> list[Observation]:
    """Observations of one drive of a measured batch."""
    batch, time = measurement.velocity.shape
    names = [field.name for field in dataclasses.fields(Observation) if field.name != "stamp_ns"]
    columns = {name: getattr(measurement, name) for name in names}
    series = {name: (value[index] if value.ndim == 3 else value.expand(batch, time)[index]) for name, value in columns.items()}
    return [
        Observation(stamp_ns=(k + 1) * STEP_NS, **{name: _plain(value[k]) for name, value in series.items()})  # type: ignore[arg-type]
        for k in range(time)
    ]


def _plain(value: torch.Tensor) -> object:
    return value.numpy() if value.ndim else float(value)
