# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training tasks: drives on random ground, as packed observations, in batches."""

import math
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from terrain_estimator.packing import AXLE_FIELDS
from terramechanics.ground import Ground, Patch
from terramechanics.rover import Rover
from terramechanics.sample import Drive
from terramechanics.sensors import Measurement, Noise, measure_drive
from terramechanics.simulation import TIME_STEP, simulate
from terramechanics.soil import Soil

COHESION_PA = (500.0, 5000.0)
FRICTION_ANGLE = (math.radians(15.0), math.radians(45.0))
"""[rad] Range of the tasks, as that of COHESION_PA [Pa]: that of the benchmarks."""
CONSTANTS_SPREAD = 0.05
"""[1] Each soil constant of a training task is wrong by up to this share: that is what the net can learn."""


@dataclass(frozen=True, slots=True)
class Tasks:
    """A batch of drives: packed observations [batch, time, 8 A + 9], and what is true."""

    measured: Tensor
    true: Tensor  # the same without noise, deviations as measured
    strength: Tensor  # [batch, 2] c [Pa], tan phi
    usable: Tensor  # [batch, time] bool: moving, not stuck, every wheel in range

    def split(self, size: int) -> list["Tasks"]:
        """The same in batches of ``size`` drives."""
        pieces = zip(*(getattr(self, field.name).split(size) for field in fields(self)), strict=True)
        return [Tasks(*piece) for piece in pieces]


def random_ground(soil: Soil, batch: int, generator: torch.Generator, spread: float = CONSTANTS_SPREAD) -> Ground:
    """One ground a drive: c and phi uniform in the ranges above, each soil constant uniform within +-``spread``."""
    unit = torch.rand(batch, 2, generator=generator, dtype=torch.float64)
    cohesion = COHESION_PA[0] + (COHESION_PA[1] - COHESION_PA[0]) * unit[:, 0]
    angle = FRICTION_ANGLE[0] + (FRICTION_ANGLE[1] - FRICTION_ANGLE[0]) * unit[:, 1]
    error = 2.0 * torch.rand(batch, 6, generator=generator, dtype=torch.float64) - 1.0
    constants = soil.constants() * (1.0 + spread * error)
    return Ground([Patch(constants, torch.stack([cohesion, torch.tan(angle)], 1), name=soil.name)])


def pack_measurement(measurement: Measurement) -> Tensor:
    """Packed observations [batch, time, 8 A + 9] of a batch of drives; every one is linked to the one before."""
    groups = torch.stack([getattr(measurement, name) for name in AXLE_FIELDS], dim=2)
    batch, time = measurement.velocity.shape
    names = ("velocity", "velocity_sd", "pitch", "pitch_sd", "acceleration", "acceleration_sd", "bogie_angle")
    scalars = [getattr(measurement, name).expand(batch, time) for name in names]
    step = torch.full((batch, time), TIME_STEP, dtype=torch.float64)
    linked = torch.ones(batch, time, dtype=torch.float64)
    linked[:, 0] = 0.0
    return torch.cat([groups.flatten(2), torch.stack([*scalars, step, linked], dim=2)], dim=2)


def draw_tasks(
    rover: Rover, soil: Soil, schedule: str, duration_s: float, batch: int, generator: torch.Generator, spread: float = CONSTANTS_SPREAD
) -> Tasks:
    """Simulate and measure a batch of drives; the same state of the generator gives the same tasks."""
    drive = simulate(rover, random_ground(soil, batch, generator, spread), schedule, duration_s, generator, batch)
    return measure_tasks(drive, Noise(), generator)


def measure_tasks(drive: Drive, noise: Noise, generator: torch.Generator) -> Tasks:
    """Measured and true observations of a batch of drives. Torque is that on the ground, without wheel inertia."""
    rover, sample = drive.rover, drive.sample
    sample = replace(sample, torque=sample.ground_torque)
    measured = pack_measurement(measure_drive(rover, sample, noise, generator))
    true = pack_measurement(measure_drive(rover, sample, replace(noise, factor=0.0), generator))
    for deviation in _deviations(len(rover.axle_x)):
        true[..., deviation] = measured[..., deviation]
    return Tasks(measured, true, sample.strength[:, 0, 0], drive.measurable())


def _deviations(axles: int) -> list[int]:
    """Places of the standard deviations in a packed observation."""
    groups = [axles * index + axle for index, name in enumerate(AXLE_FIELDS) if name.endswith("_sd") for axle in range(axles)]
    return [*groups, 8 * axles + 1, 8 * axles + 3, 8 * axles + 5]
