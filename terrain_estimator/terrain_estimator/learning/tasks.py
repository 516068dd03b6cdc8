# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training tasks: drives on random ground, as packed observations, in batches."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from terrain_estimator.model.packing import PackedView, pack_measurement, view_of
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import TIME_STEP, Drive, Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

ROVERS = ("paper_rover", "mars_rover")
"""Rovers of the models that ship."""
SOILS = ("loose_sand", "compact_sand", "regolith")
"""Soils of the models that ship, in the order of their hypotheses."""


@dataclass(frozen=True, slots=True)
class StrengthRange:
    """Distribution of c [Pa] and phi [rad]: uniform over unions of disjoint intervals."""

    cohesion: tuple[tuple[float, float], ...]
    angle: tuple[tuple[float, float], ...]

    def strength(self, share: Tensor) -> Tensor:
        """Return c [Pa] and tan phi [batch, 2] at shares [batch, 2] of all intervals' length."""
        return torch.stack(
            [uniform(self.cohesion, share[:, 0]), torch.tan(uniform(self.angle, share[:, 1]))], 1
        )


@dataclass(frozen=True, slots=True)
class AboveZero:
    """Distribution of c [Pa] and tan phi: independent Gaussians, truncated at zero."""

    mean: tuple[float, float]
    sd: tuple[float, float]

    def strength(self, share: Tensor) -> Tensor:
        """Return c [Pa] and tan phi, shape [batch, 2], at these quantiles [batch, 2]."""
        mean, sd = torch.tensor([self.mean, self.sd], dtype=torch.float64)
        impossible = torch.special.ndtr(-mean / sd)
        return mean + sd * torch.special.ndtri(impossible + (1.0 - impossible) * share)


def degrees(*ends: float) -> tuple[float, float]:
    """Return an interval in radians."""
    low, high = ends
    return math.radians(low), math.radians(high)


BENCHMARK = StrengthRange(((500.0, 5000.0),), (degrees(15.0, 45.0),))
"""Distribution of the benchmarks' drives."""
PAPER = StrengthRange(((500.0, 700.0), (1300.0, 5000.0)), (degrees(0.0, 20.0), degrees(45.0, 60.0)))
"""The paper's training tasks (Banerjee et al., section V): its test tasks lie in the gaps."""
CONSTANTS_SPREAD = 0.05
"""[1] Each soil constant of a training task is wrong by up to this share."""


@dataclass(frozen=True, slots=True)
class Tasks:
    """A batch of drives: packed observations [batch, time, P], and their truth."""

    measured: Tensor
    true: Tensor  # the same without noise, deviations as measured
    strength: Tensor  # [batch, 2] c [Pa], tan phi
    usable: Tensor  # [batch, time] bool: moving, not stuck, every wheel in range

    @classmethod
    def joined(cls, parts: Sequence["Tasks"]) -> "Tasks":
        """Return the drives of all parts."""
        return cls(
            *(torch.cat([getattr(part, field.name) for part in parts]) for field in fields(cls))
        )

    def split(self, size: int) -> list["Tasks"]:
        """Return these drives in batches of ``size``."""
        pieces = zip(
            *(getattr(self, field.name).split(size) for field in fields(self)), strict=True
        )
        return [Tasks(*piece) for piece in pieces]


def uniform(intervals: tuple[tuple[float, float], ...], share: Tensor) -> Tensor:
    """Return the points of a union of intervals at this ``share`` [1] of its length."""
    ends = torch.tensor(intervals, dtype=torch.float64)
    if len(intervals) == 1:
        return ends[0, 0] + (ends[0, 1] - ends[0, 0]) * share
    length = ends[:, 1] - ends[:, 0]
    place = share * length.sum()
    before = torch.cumsum(length, 0) - length
    index = (place.unsqueeze(-1) >= before).sum(-1) - 1
    return ends[index, 0] + place - before[index]


def random_ground(
    soil: Soil,
    batch: int,
    generator: torch.Generator,
    spread: float = CONSTANTS_SPREAD,
    strength: StrengthRange | AboveZero = BENCHMARK,
) -> Ground:
    """Draw one ground a drive: c and phi of ``strength``, each constant uniform in +-``spread``."""
    unit = torch.rand(batch, 2, generator=generator, dtype=torch.float64)
    error = 2.0 * torch.rand(batch, 6, generator=generator, dtype=torch.float64) - 1.0
    constants = soil.constants() * (1.0 + spread * error)
    patch = Patch(constants, strength.strength(unit), name=soil.name, law=soil.law)
    return Ground([patch])


def draw_tasks(
    rover: Rover,
    soil: Soil,
    schedule: str,
    duration_s: float,
    batch: int,
    generator: torch.Generator,
    spread: float = CONSTANTS_SPREAD,
    strength: StrengthRange = BENCHMARK,
    plant: Plant | None = None,
) -> Tasks:
    """Simulate and measure a batch of drives; the same state of the generator gives the same tasks.

    ``plant`` holds the effects that act besides the nominal model.
    """
    drive = simulate(
        rover,
        random_ground(soil, batch, generator, spread, strength),
        schedule,
        duration_s,
        generator,
        batch,
        plant=plant,
    )
    return measure_tasks(drive, Noise(), generator)


def measure_tasks(drive: Drive, noise: Noise, generator: torch.Generator) -> Tasks:
    """Return measured and true observations of a batch of drives.

    Torque is that of the motor, without wheel inertia. Where effects act between truth and sensors,
    the input of the sensors stands for the truth.
    """
    rover, sample = drive.rover, drive.seen
    sample = replace(
        sample,
        torque=sample.ground_torque if sample is drive.sample else _without_inertia(rover, sample),
    )
    measured = pack_measurement(measure_drive(rover, sample, noise, generator))
    true = pack_measurement(measure_drive(rover, sample, replace(noise, factor=0.0), generator))
    exact, noisy = view_of(true, len(rover.axle_x)), view_of(measured, len(rover.axle_x))
    for name in PackedView._fields:
        if name.endswith("_sd"):
            getattr(exact, name).copy_(getattr(noisy, name))
    return Tasks(measured, true, sample.strength[:, 0, 0], drive.measurable())


def _without_inertia(rover: Rover, sample: Sample) -> Tensor:
    """Return the motor torque [batch, time, axles] less the part that accelerates the wheel.

    It includes the part that friction takes.
    """
    gain = torch.diff(sample.wheel_rate, dim=1) / TIME_STEP
    return sample.torque - rover.wheel_inertia * torch.cat([gain[:, :1], gain], 1)
