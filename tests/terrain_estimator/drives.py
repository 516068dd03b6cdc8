# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated drives as observations, for tests of the core."""

from functools import cache

import torch

from terrain_estimator.learning.observing import observations_of
from terrain_estimator.observation import Observation
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover


def drive_observations(rover: Rover, soil: Soil, duration_s: float, seed: int) -> list[Observation]:
    """Observations of one S1 drive with the noise of the benchmarks; simulated once a process."""
    return list(_simulated(rover, soil, duration_s, seed))


@cache
def _simulated(rover: Rover, soil: Soil, duration_s: float, seed: int) -> list[Observation]:
    generator = torch.Generator().manual_seed(seed)
    drive = simulate(rover, Ground.constant(soil), "S1", duration_s, generator, 1)
    return observations_of(measure_drive(rover, drive.sample, Noise(), generator), 0)
