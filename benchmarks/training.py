# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Processor time of a training step beside plain NumPy loops over the same tasks and blocks."""

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.numpy_training import Adam, Floats, TaskArrays, loss_and_gradients
from terrain_estimator.learning.regression import Regression, distinct_rows
from terrain_estimator.learning.training import Recipe, build_model, train
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.palpaca import PAlpaca
from terramechanics.presets import load_rover, load_soil

BAR_MS = 30.0
"""[ms] Bar for a step of 20 tasks x 40 blocks on one core: 1000 of them in half a minute."""
TASKS, BLOCKS, TIMED, RUNS = 40, 40, 40, 3


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield a step of the recipe without penalties, which the loops lack, and one with them."""
    timed = effort.count(TIMED, least=3)
    plain = Recipe(iterations=timed, strength=0.0, positivity=0.0)
    model = model_of(plain)
    data = random_data(model, torch.Generator().manual_seed(0))
    loops = fastest_ms(lambda: loops_step(model, data, plain))
    name = "NumPy loops over tasks and blocks with gradients by hand"
    for what, recipe in (
        ("training step without penalties", plain),
        ("training step of the recipe", Recipe(iterations=timed)),
    ):
        spent = fastest_ms(partial(batched, model, data, recipe)) / timed
        yield BenchmarkLine(
            what,
            spent,
            "ms",
            BAR_MS,
            reference=name,
            against=loops,
            note=f"{recipe.batch} tasks of {BLOCKS} blocks",
        )


def fastest_ms(function: Callable[[], object]) -> float:
    """Return milliseconds of one core, the least of RUNS, as other load only slows it down."""
    spent = []
    for _ in range(RUNS):
        begun_s = time.process_time()
        function()
        spent.append(time.process_time() - begun_s)
    return 1e3 * min(spent)


def model_of(recipe: Recipe) -> PAlpaca:
    """Return an untrained model for the Mars rover on loose sand."""
    return build_model(
        load_rover("mars_rover"), [load_soil("loose_sand")], recipe.columns, recipe.hidden
    )


def batched(model: PAlpaca, data: Regression, recipe: Recipe) -> None:
    """Run all steps of the recipe."""
    model.net.requires_grad_(requires_grad=True)
    for _ in train(model, data, recipe):
        pass


def loops_step(model: PAlpaca, data: Regression, recipe: Recipe) -> None:
    """Run one step of the loops, on as many tasks."""
    arrays = weights_of(model, torch.zeros(recipe.columns), torch.zeros(data.target.shape[-1]))
    tasks = tasks_of(model, data.of(torch.arange(recipe.batch)))
    _, gradients = loss_and_gradients(arrays, tasks, np.full(recipe.batch, BLOCKS // 2))
    rates = [recipe.learning_rate] * 6 + [recipe.prior_rate] * 2
    Adam(
        rates, [np.zeros_like(each) for each in arrays], [np.zeros_like(each) for each in arrays]
    ).step(arrays, gradients)


def random_data(model: PAlpaca, generator: torch.Generator) -> Regression:
    """Return data of the right shapes; the numbers do not change the time."""
    rows, columns = len(distinct_rows(model.axles)), 2 + model.layout.constants

    def draw(*shape: int) -> Tensor:
        return torch.randn(TASKS, BLOCKS, *shape, generator=generator, dtype=torch.float64)

    spread = 0.3 * draw(rows, rows)
    return Regression(
        draw(rows, columns),
        draw(rows),
        torch.eye(rows, dtype=torch.float64) + spread @ spread.mT,
        0.1 * draw(model.observation_size),
        (draw() > -1.0).to(torch.float64),
    )


def weights_of(model: PAlpaca, log_precision: Tensor, log_noise: Tensor) -> list[Floats]:
    """Return everything that is learnt, for the loops."""
    layers = [part for part in model.net.layers if isinstance(part, nn.Linear)]
    learnt = [part for layer in layers for part in (layer.weight, layer.bias)]
    return [
        part.detach().to(torch.float64).numpy().copy()
        for part in (*learnt, log_precision, log_noise)
    ]


def tasks_of(model: PAlpaca, data: Regression) -> TaskArrays:
    """Return the same regressions for the loops."""
    inputs, prior = view_of(data.inputs, model.axles), model.hypotheses
    pitch = inputs.pitch.unsqueeze(-1)
    seen = torch.cat([inputs.slip, inputs.sinkage, inputs.contact_angle, pitch], -1)
    others = data.nominal.shape[-1] - 2
    return TaskArrays(
        data.nominal.numpy(),
        data.target.numpy(),
        data.covariance.numpy(),
        (seen / model.net.input_scale).numpy(),
        data.valid.numpy() > 0.0,
        model.net.row_scale.numpy(),
        np.concatenate(
            [(prior.prior_mean / prior.unit).numpy(), np.zeros(others + model.net.columns)]
        ),
        np.concatenate([((prior.prior_sd / prior.unit) ** -2.0).numpy(), np.ones(others)]),
    )
