# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""P-ALPaCA trained as in its authors' code: slips and sinkages drawn at random, not driven.

A wheel in equilibrium has the sinkage that carries its load, so in drives slip, sinkage and ground
go together, and learnt features can replace the nominal ones. The authors' training draws slip and
sinkage of every wheel and step independently of the ground. Here the same is done, with the noise
that the test drives have in inputs and targets (their own targets have none). P-ALPaCA is trained
twice: on grounds of the wide range of their training, and on those of the band of the test. Its
prior is learnt, so the range of its training matters.

The ranges are those of the authors' public code (StanfordASL/rover-meta-learning, MIT, commit
6673155, ``rocker_bogie_with_terrain_simplified.py``).
"""

import itertools
import math
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import dataclass

import torch
from torch import Tensor

from studies.baselines.constant import ConstantGuess
from studies.baselines.drives import LevelDrives, closed_form_forces
from studies.baselines.features import LearntModel
from studies.baselines.iagnemma import Iagnemma
from studies.baselines.integrated import IntegratedRegression
from studies.baselines.interface import BaselinePrior, Method
from studies.baselines.least_squares import RecursiveLeastSquares
from studies.baselines.linear import LinearModel
from studies.baselines.palpaca import PaperPAlpaca
from studies.paper.cases import PAPER_STRENGTH, ROVER, SOILS, Size, strength_name
from studies.paper.plants import (
    NARROW,
    Draw,
    PaperNoise,
    PaperPlant,
    TrueMotion,
    closed_form_wheels,
    draw_drives,
    measured,
    vehicle,
)
from studies.paper.scores import Scores, score
from studies.paper.training import PaperRecipe, train
from studies.workers import workers
from terrain_estimator.learning.tasks import degrees
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

SEEDS = 10
"""Draws of training, test and network."""
GROUNDS = Draw(((700.0, 5000.0),), (degrees(15.0, 45.0),))
"""Grounds of the authors' training tasks; the test has those of NARROW, which lie within."""
BANDS = {"": GROUNDS, ", trained on the band": NARROW}
"""Grounds of the trainings by what is added to the names of their models."""
SLIPS = ((-0.0016, 0.24), (-0.016, 0.24), (-0.016, 0.24))
DEPTHS = (0.004, 0.0105)  # [m] of every wheel
FASTEST_START = 20.0
"""[m/s] Tasks start at any velocity below; the test drives end at 17 m/s."""
STRENGTHS = (0.0, PAPER_STRENGTH)

_Ranges = tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class SeedScores:
    """Scores of all methods on the drives of one seed."""

    soil: str
    seed: int
    methods: dict[str, Scores]


def random_motion(
    rover: Rover, soil: Soil, strength: Tensor, duration_s: float, generator: torch.Generator
) -> TrueMotion:
    """Return motions on grounds ``strength`` [batch, 2], every wheel at random slip and sinkage."""
    shape = (strength.shape[0], round(duration_s / TIME_STEP), rover.axles)
    slip = _uniform(SLIPS, shape, generator)
    sinkage = _uniform((DEPTHS,) * rover.axles, shape, generator)
    constants = soil.constants().expand(shape[0], 6)
    flat = closed_form_wheels(rover, slip.flatten(1), sinkage.flatten(1), constants, strength)
    forces = flat.view(*shape, 3)
    start = FASTEST_START * torch.rand(shape[0], 1, generator=generator, dtype=torch.float64)
    change = TIME_STEP / rover.mass * forces[..., 1].sum(-1)
    velocity = torch.cat([start, start + change.cumsum(1)], 1)
    every = torch.ones(shape[0], dtype=torch.bool)
    return TrueMotion(slip, sinkage, forces[..., 2], forces[..., 0], velocity, every)


def _uniform(ranges: _Ranges, shape: tuple[int, int, int], generator: torch.Generator) -> Tensor:
    low, high = torch.tensor(ranges, dtype=torch.float64).unbind(1)
    return torch.lerp(low, high, torch.rand(shape, generator=generator, dtype=torch.float64))


def training_tasks(
    grounds: Draw, rover: Rover, soil: Soil, size: Size, generator: torch.Generator
) -> LevelDrives:
    """Draw and measure the training tasks of one seed."""
    share = torch.rand(size.tasks, 2, generator=generator, dtype=torch.float64)
    strength = grounds.strength(share)
    motion = random_motion(rover, soil, strength, size.duration_s, generator)
    constants = soil.constants().expand(size.tasks, 6)
    return measured(motion, strength, constants, PaperNoise(), generator)


def compare(soil_name: str, seed: int, size: Size) -> SeedScores:
    """Train P-ALPaCA and test it and the methods without training on the same drives."""
    rover, soil = load_rover(ROVER), load_soil(soil_name)
    generator = torch.Generator().manual_seed(100_000 + 1000 * size.seed + seed)
    tasks = {
        name: training_tasks(grounds, rover, soil, size, generator)
        for name, grounds in BANDS.items()
    }
    plant = PaperPlant.CLOSED_FORM
    test = draw_drives(plant, rover, soil, NARROW, size.duration_s, size.drives, generator).drives
    car, constants, prior = vehicle(rover, plant), soil.constants(), BaselinePrior()
    methods: list[Method] = [
        ConstantGuess(),
        LinearModel(car, constants, prior),
        RecursiveLeastSquares(car, constants),
        Iagnemma(car, constants),
        IntegratedRegression(car, constants, prior),
    ]
    for (band, drawn), strength in itertools.product(tasks.items(), STRENGTHS):
        model = LearntModel(car, constants, closed_form_forces, size.columns, size.hidden)
        recipe = PaperRecipe(1000 * size.seed + seed, size.iterations, strength=strength)
        for _ in train(model, drawn, recipe):
            pass
        methods.append(PaperPAlpaca(model, strength_name(strength) + band))
    return SeedScores(
        soil_name, seed, {each.name: score(each.estimate(test), test) for each in methods}
    )


def compare_all(size: Size, jobs: int, seeds: int = SEEDS) -> Iterator[SeedScores]:
    """Yield the scores of every soil and seed, in that order."""
    with workers(jobs) as pool:
        pending: list[Future[SeedScores]] = [
            pool.submit(compare, soil, seed, size) for soil in SOILS for seed in range(seeds)
        ]
        for each in pending:
            yield each.result()


def mean_and_error(values: list[float]) -> tuple[float, float]:
    """Return the mean over seeds and its standard error."""
    count, mean = len(values), math.fsum(values) / len(values)
    spread = math.fsum((value - mean) ** 2 for value in values) / max(count - 1, 1)
    return mean, math.sqrt(spread / count)
