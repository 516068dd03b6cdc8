# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training data in chunks, each with a seed: the data depend neither on order nor on workers."""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from terrain_estimator.learning.departures import Family, random_plant
from terrain_estimator.learning.regression import Regression, regression
from terrain_estimator.learning.tasks import BENCHMARK, StrengthRange, draw_tasks
from terrain_estimator.learning.training import build_model
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

CHUNK = 20
"""[1] Drives in a chunk; another number gives other drives."""


@dataclass(frozen=True, slots=True)
class Order:
    """Description of the data to draw."""

    rover: Rover
    soil: Soil
    drives: int
    seed: int
    duration_s: float = 40.0
    strength: StrengthRange = BENCHMARK
    family: Family = Family.LEARNT
    share: float = 0.0  # [1] of the drives in which each effect of the family acts
    # [1] of each soil constant, which is drawn from a uniform range of that deviation
    constants_sd: float = DEFAULT_PRIOR.constants_sd


@dataclass(frozen=True, slots=True)
class Chunk:
    """Some drives of an order."""

    order: Order
    number: int
    size: int


Spread = Callable[[Callable[[Chunk], Regression], Sequence[Chunk]], Iterable[Regression]]
"""Apply a function to each chunk, on any workers; results are in the order of the chunks."""


def chunks(order: Order) -> list[Chunk]:
    """Return the chunks of an order; the last may be smaller."""
    firsts = range(0, order.drives, CHUNK)
    return [
        Chunk(order, number, min(CHUNK, order.drives - first))
        for number, first in enumerate(firsts)
    ]


def generator_of(chunk: Chunk) -> torch.Generator:
    """Return the generator of a chunk, independent of that of every other chunk and seed."""
    (state,) = np.random.SeedSequence([chunk.order.seed, chunk.number]).generate_state(1, np.uint64)
    return torch.Generator().manual_seed(int(state >> np.uint64(1)))


def draw_chunk(chunk: Chunk) -> Regression:
    """Simulate and measure the drives of a chunk, and return their rows; a pure function."""
    order, generator = chunk.order, generator_of(chunk)
    plant = random_plant(order.family, order.rover, chunk.size, order.share, generator)
    spread = order.constants_sd * 3.0**0.5
    prior = dataclasses.replace(DEFAULT_PRIOR, constants_sd=order.constants_sd)
    tasks = draw_tasks(
        order.rover,
        order.soil,
        "S1",
        order.duration_s,
        chunk.size,
        generator,
        spread,
        order.strength,
        plant,
    )
    return regression(build_model(order.rover, [order.soil], prior=prior), tasks, generator)


def generate(order: Order, spread: Spread = map) -> Regression:
    """Return all drives of an order."""
    return Regression.join(list(spread(draw_chunk, chunks(order))))
