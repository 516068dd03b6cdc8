# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How long a training takes, and how long it would take with the recursion written out step by step."""

import time
from collections.abc import Callable

import torch
from torch import Tensor

from terrain_estimator.gaussian import cholesky, log_determinant
from terrain_estimator.learning.loss import whiten
from terrain_estimator.learning.regression import Regression, distinct_rows
from terrain_estimator.learning.training import Recipe, build_model, train
from terrain_estimator.palpaca import PAlpaca
from terramechanics.rover import load_rover
from terramechanics.soil import load_soil

TARGET_S = 30.0
"""[s] For 1000 iterations of 20 tasks x 40 steps on 2 cores."""
TASKS, STEPS, TIMED, RECURSIONS, RUNS = 40, 40, 40, 4, 3


def training_seconds() -> tuple[float, float]:
    """Seconds of one core for 1000 iterations of the recipe, and of the same net with one update of the posterior a step.

    The recipe makes two Cholesky factors a task instead. On random data of the right shapes: no number changes how long it takes.
    """
    recipe = Recipe(iterations=TIMED)
    model = build_model(load_rover("mars_rover"), [load_soil("loose_sand")], recipe.columns, recipe.hidden)
    data = _random_data(model, torch.Generator().manual_seed(0))

    def batched() -> None:
        model.net.requires_grad_(requires_grad=True)
        list(train(model, data, recipe))

    def by_steps() -> None:
        model.net.requires_grad_(requires_grad=True)
        for _ in range(RECURSIONS):
            _step_by_step(model, data.of(torch.arange(recipe.batch))).backward()  # type: ignore[no-untyped-call]

    return 1000.0 * _fastest(batched) / TIMED, 1000.0 * _fastest(by_steps) / RECURSIONS


def _fastest(function: Callable[[], None]) -> float:
    """Seconds of one core, the least of RUNS: what else the machine does only slows it down."""
    spent = []
    for _ in range(RUNS):
        start = time.process_time()
        function()
        spent.append(time.process_time() - start)
    return min(spent)


def _random_data(model: PAlpaca, generator: torch.Generator) -> Regression:
    rows, columns = len(distinct_rows(model.axles)), 2 + model.uncertain.shape[1]

    def draw(*shape: int) -> Tensor:
        return torch.randn(TASKS, STEPS, *shape, generator=generator, dtype=torch.float64)

    inputs = 0.1 * draw(model.observation_size)
    return Regression(
        draw(rows, columns),
        draw(rows),
        torch.eye(rows, dtype=torch.float64).expand(TASKS, STEPS, rows, rows),
        inputs,
        draw().square().clamp(1, 1),
    )


def _step_by_step(model: PAlpaca, data: Regression) -> Tensor:
    """Negative log predictive of every step given those before it (Banerjee et al. eqs. 20 to 23)."""
    rows = distinct_rows(model.axles)
    learnt = model.learnt(data.inputs.flatten(0, 1))[:, rows].reshape(*data.target.shape, -1)
    joined = torch.cat([data.nominal, learnt, data.target.unsqueeze(-1)], -1)
    whitened, _ = whiten(joined, data.covariance, torch.zeros(len(rows), dtype=torch.float64))
    size = whitened.shape[-1] - 1
    precision = torch.eye(size, dtype=torch.float64).expand(joined.shape[0], size, size)
    pull = torch.zeros(joined.shape[0], size, 1, dtype=torch.float64)
    total = torch.zeros((), dtype=torch.float64)
    for step in whitened.unbind(1):
        features, target = step[..., :-1], step[..., -1:]
        factor = cholesky(precision)
        spread = features @ torch.cholesky_solve(features.mT, factor) + torch.eye(len(rows), dtype=torch.float64)
        residual, root = target - features @ torch.cholesky_solve(pull, factor), cholesky(spread)
        total = total + 0.5 * (log_determinant(root).sum() + (residual * torch.cholesky_solve(residual, root)).sum())
        precision, pull = precision + features.mT @ features, pull + features.mT @ target
    return total
