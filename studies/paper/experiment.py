# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiments: every cell, model and method; reproducible from the seed."""

from collections.abc import Callable
from concurrent.futures import Future, as_completed
from dataclasses import dataclass, field

import torch
from torch import Tensor

from studies.baselines.drives import LevelDrives, closed_form_forces, quadrature_forces
from studies.baselines.features import LearntModel
from studies.baselines.integrated import cramer_rao
from studies.baselines.interface import BaselinePrior, Estimates, Method
from studies.paper.cases import (
    ROVER,
    SOILS,
    Data,
    PaperCell,
    Size,
    draw,
    methods,
    train_variant,
    variants,
)
from studies.paper.plants import PaperPlant, vehicle
from studies.paper.scores import Scores, quartiles, relative_errors, score
from studies.workers import workers
from terramechanics.presets import load_rover

Report = Callable[[float, str], None]
"""Receives the share that is done, and the present step."""


@dataclass(frozen=True, slots=True)
class MethodCurves:
    """Curves of one method on the paper's test drives of a cell, for the pictures."""

    example: Tensor | None  # [time, 2] c [Pa], tan phi of the first drive
    example_sd: Tensor | None  # [time, 2]
    cohesion_error: Tensor | None  # [3, time] quartiles over drives, in percent
    angle_error: Tensor | None  # [3, time]
    velocity_error: Tensor | None  # [time] median over drives of |error| [mm/s]


@dataclass(slots=True)
class CellResult:
    """Results of one cell."""

    cell: PaperCell
    kept: float
    truth: Tensor  # [2] c [Pa], tan phi of the first test drive
    testing: dict[str, Scores] = field(default_factory=dict)
    narrow: dict[str, Scores] = field(default_factory=dict)
    curves: dict[str, MethodCurves] = field(default_factory=dict)


def run(size: Size, jobs: int, report: Report) -> list[CellResult]:
    """Run all experiments with ``jobs`` processes."""
    cells = [PaperCell(plant, soil) for plant in PaperPlant for soil in SOILS]
    trainings = size.trainings * sum(len(variants(cell)) for cell in cells)
    steps = len(cells) + trainings + len(cells)
    with workers(jobs) as pool:
        report(0.0, "simulating")
        drawn = {cell: pool.submit(draw, cell, size) for cell in cells}
        data = {
            cell: _waited(future, report, (index + 1) / steps)
            for index, (cell, future) in enumerate(drawn.items())
        }
        futures = {
            pool.submit(train_variant, cell, variant, repeat, data[cell].training, size): (
                cell,
                variant.name,
                repeat,
            )
            for cell in cells
            for variant in variants(cell)
            for repeat in range(size.trainings)
        }
        trained: dict[tuple[PaperCell, str, int], LearntModel] = {}
        for future in as_completed(futures):
            trained[futures[future]] = future.result()
            report((len(cells) + len(trained)) / steps, "training")
    results: list[CellResult] = []
    for cell in cells:
        report((len(cells) + trainings + len(results)) / steps, "estimating")
        models = {
            variant.name: [trained[cell, variant.name, repeat] for repeat in range(size.trainings)]
            for variant in variants(cell)
        }
        results.append(evaluate(cell, data[cell], models))
    return results


def _waited(future: Future[Data], report: Report, share: float) -> Data:
    data = future.result()
    report(share, "simulating")
    return data


def evaluate(cell: PaperCell, data: Data, models: dict[str, list[LearntModel]]) -> CellResult:
    """Evaluate every method, in all its trainings, on both sets of drives."""
    result = CellResult(cell, data.kept, data.testing.strength[0])
    for trainings in methods(cell, models):
        name = trainings[0].name
        estimates, drives = _all_trainings(trainings, data.testing)
        result.testing[name] = score(estimates, drives)
        result.curves[name] = curves(estimates, drives)
        result.narrow[name] = score(*_all_trainings(trainings, data.narrow))
    result.narrow["Cramer-Rao bound"] = bound(cell, data.narrow)
    return result


def _all_trainings(trainings: list[Method], drives: LevelDrives) -> tuple[Estimates, LevelDrives]:
    """Return the estimates of all trainings in a row, and the drives repeated to match."""
    parts = [method.estimate(drives) for method in trainings]

    def joined(name: str) -> Tensor | None:
        values = [getattr(part, name) for part in parts]
        return None if values[0] is None else torch.cat(values)

    repeated = drives.subset(torch.arange(drives.slip.shape[0]).repeat(len(parts)))
    return (
        Estimates(
            joined("parameters"), joined("deviation"), joined("velocity"), joined("velocity_sd")
        ),
        repeated,
    )


def bound(cell: PaperCell, drives: LevelDrives) -> Scores:
    """Return the bound's median and mean |error|, those of a Gaussian of its deviation."""
    forces = closed_form_forces if cell.plant is PaperPlant.CLOSED_FORM else quadrature_forces
    deviation = cramer_rao(drives, vehicle(load_rover(ROVER), cell.plant), BaselinePrior(), forces)
    percent = 100.0 * deviation / drives.strength
    scores: Scores = {}
    for column, name in enumerate(("cohesion", "tan_phi")):
        time = f"{drives.slip.shape[1] / 10:g}"
        scores[f"{name}_error_percent"] = {
            time: [0.6745 * value for value in quartiles(percent[:, column])]
        }
        scores[f"{name}_mean_error_percent"] = float(
            (2.0 / torch.pi) ** 0.5 * percent[:, column].mean()
        )
    return scores


def curves(estimates: Estimates, drives: LevelDrives) -> MethodCurves:
    """Return the series for the pictures."""
    levels = torch.tensor([0.25, 0.5, 0.75], dtype=torch.float64)
    cohesion = angle = velocity = None
    if estimates.parameters is not None:
        errors = torch.quantile(relative_errors(estimates.parameters, drives), levels, dim=0)
        cohesion, angle = errors[..., 0], errors[..., 2]
    if estimates.velocity is not None:
        velocity = 1e3 * (estimates.velocity - drives.true_velocity[:, 1:]).abs().median(0).values
    example = estimates.parameters[0] if estimates.parameters is not None else None
    deviation = estimates.deviation[0] if estimates.deviation is not None else None
    return MethodCurves(example, deviation, cohesion, angle, velocity)
