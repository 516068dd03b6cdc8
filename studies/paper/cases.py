# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The experiments as small jobs: drives to draw, models to train, methods to run."""

from dataclasses import dataclass

import torch

from studies.baselines.alpaca import Alpaca
from studies.baselines.constant import ConstantGuess
from studies.baselines.drives import LevelDrives, closed_form_forces, quadrature_forces
from studies.baselines.features import FeatureSpan, LearntModel
from studies.baselines.iagnemma import Iagnemma
from studies.baselines.integrated import IntegratedRegression
from studies.baselines.interface import BaselinePrior, Method
from studies.baselines.least_squares import RecursiveLeastSquares
from studies.baselines.linear import LinearModel
from studies.baselines.palpaca import PaperPAlpaca
from studies.paper.plants import NARROW, TESTING, TRAINING, PaperPlant, draw_drives, vehicle
from studies.paper.training import PaperRecipe, train
from terrain_estimator.learning.loss import Orthogonality
from terramechanics.presets import load_rover, load_soil

ROVER = "paper_rover"
SOILS = ("loose_sand", "compact_sand")
STRENGTHS = (0.0, 3.3e-5, 3.3e-4, 3.3e-3, 3.3e-2, 3.3e-1, 3.3)
"""Weights of the penalty in the paper's trade-off figure."""
PAPER_STRENGTH = 3.3e-2
"""Weight in its other figures, with which the authors' code starts."""
WHITENED_STRENGTH = 10.0


@dataclass(frozen=True, slots=True)
class Size:
    """Size of the experiments."""

    seed: int = 0
    tasks: int = 200  # drives to train on, for each plant and soil
    trainings: int = 2  # of every model, from different seeds
    drives: int = 30  # to test on, for each plant, soil and set
    duration_s: float = 40.0
    iterations: int = 1000
    columns: int = 32
    hidden: int = 128


QUICK = Size(tasks=8, trainings=2, drives=3, duration_s=6.0, iterations=4, columns=4, hidden=8)
"""Size for a run of seconds, whose numbers are meaningless."""


@dataclass(frozen=True, slots=True)
class PaperCell:
    """One plant with one soil."""

    plant: PaperPlant
    soil: str


@dataclass(frozen=True, slots=True)
class Data:
    """The drives of a cell."""

    training: LevelDrives
    testing: LevelDrives  # the paper's test: soil constants wrong by up to 5 %
    narrow: LevelDrives  # the band of the authors' code, soil constants exact
    kept: float  # smallest share of drives that went to their end


@dataclass(frozen=True, slots=True)
class Variant:
    """A model to train."""

    name: str
    nominal: bool = True
    strength: float = 0.0
    orthogonality: Orthogonality = Orthogonality.PAPER
    span: FeatureSpan = FeatureSpan.FREE


def variants(cell: PaperCell) -> list[Variant]:
    """Return the models to train for a cell; the trade-off is on loose sand, as in the paper."""
    strengths = STRENGTHS if cell.soil == "loose_sand" else (0.0, PAPER_STRENGTH)
    return [
        Variant("P-ALPaCA without nominal", nominal=False),
        *(Variant(strength_name(strength), strength=strength) for strength in strengths),
        Variant(
            "P-ALPaCA, whitened", strength=WHITENED_STRENGTH, orthogonality=Orthogonality.WHITENED
        ),
        Variant("P-ALPaCA, projected", span=FeatureSpan.PROJECTED),
    ]


def strength_name(strength: float) -> str:
    """Return the name of P-ALPaCA with nominal features and this weight of the paper's penalty."""
    return f"P-ALPaCA + nominal, {strength:g}"


def draw(cell: PaperCell, size: Size) -> Data:
    """Simulate and measure all drives of a cell."""
    rover, soil = load_rover(ROVER), load_soil(cell.soil)
    sets = ((TRAINING, size.tasks), (TESTING, size.drives), (NARROW, size.drives))
    batches = [
        draw_drives(
            cell.plant,
            rover,
            soil,
            band,
            size.duration_s,
            count,
            torch.Generator().manual_seed(1000 * size.seed + number),
        )
        for number, (band, count) in enumerate(sets)
    ]
    training, testing, narrow = (batch.drives for batch in batches)
    return Data(training, testing, narrow, min(batch.kept for batch in batches))


def train_variant(
    cell: PaperCell, variant: Variant, repeat: int, training: LevelDrives, size: Size
) -> LearntModel:
    """Train one model for the ``repeat``-th time.

    Nominal features are the paper's closed form on both plants.
    """
    forces = closed_form_forces if variant.nominal else None
    car, constants = vehicle(load_rover(ROVER), cell.plant), load_soil(cell.soil).constants()
    model = LearntModel(car, constants, forces, size.columns, size.hidden, variant.span)
    recipe = PaperRecipe(
        1000 * size.seed + repeat,
        size.iterations,
        strength=variant.strength,
        orthogonality=variant.orthogonality,
    )
    for _ in train(model, training, recipe):
        pass
    return model


def methods(cell: PaperCell, trained: dict[str, list[LearntModel]]) -> list[list[Method]]:
    """Return all methods of a cell, trained ones last, one for each training."""
    car, constants, prior = (
        vehicle(load_rover(ROVER), cell.plant),
        load_soil(cell.soil).constants(),
        BaselinePrior(),
    )
    found: list[Method] = [
        ConstantGuess(),
        LinearModel(car, constants, prior),
        RecursiveLeastSquares(car, constants),
        Iagnemma(car, constants),
        IntegratedRegression(car, constants, prior),
    ]
    if cell.plant is PaperPlant.INTEGRATED:
        found.append(LinearModel(car, constants, prior, quadrature_forces, "linear, quadrature"))
        found.append(
            IntegratedRegression(car, constants, prior, quadrature_forces, "integrated, quadrature")
        )
    learnt: list[list[Method]] = [
        [Alpaca(model) for model in models] for models in trained.values() if models[0].nominal == 0
    ]
    learnt += [[PaperPAlpaca(model, name) for model in models] for name, models in trained.items()]
    return [*([method] for method in found), *learnt]
