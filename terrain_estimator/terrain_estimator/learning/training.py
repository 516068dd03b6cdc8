# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Trains the network and its prior; reproducible from the seed."""

from collections.abc import Iterator
from dataclasses import dataclass

import torch

from terrain_estimator.learning.loss import negative_log_predictive, overlap
from terrain_estimator.learning.regression import Regression, regression
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.net import NetFeatures
from terrain_estimator.palpaca import Body, PAlpaca, Prior
from terramechanics.rover import Rover
from terramechanics.soil import Soil
from terramechanics.suspension import geometry_of

PRIOR = Prior(
    cohesion_pa=2750.0, cohesion_sd_pa=1300.0, tan_phi=0.6, tan_phi_sd=0.22, acceleration_bias_sd=0.02, constants_sd=0.05 / 3**0.5
)
"""Mean and deviation of the benchmarks' draws: c uniform in 0.5 to 5 kPa, phi in 15 to 45 deg, constants within 5 %."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Every choice of a training."""

    seed: int = 0
    iterations: int = 400
    tasks: int = 160
    batch: int = 20
    duration_s: float = 40.0
    columns: int = 3
    hidden: int = 32
    learning_rate: float = 3e-3
    orthogonality: float = 1.0  # weight of the overlap of learnt and nominal features


@dataclass(frozen=True, slots=True)
class Progress:
    """One iteration."""

    iteration: int
    loss: float  # mean negative log predictive density of a row [nat]
    overlap: float  # squared cosine between learnt and nominal features


def build_model(rover: Rover, soil: Soil, columns: int, hidden: int, prior: Prior = PRIOR) -> PAlpaca:
    """An untrained model of a rover on a soil."""
    body = Body(
        len(rover.axle_x), rover.wheels_per_axle, rover.mass, rover.gravity, rover.wheel_radius, rover.wheel_width, geometry_of(rover)
    )
    torque = 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)
    sizes = [0.05 * rover.gravity, 0.05] + [0.05 * torque] * body.axles  # what a learnt effect may amount to
    net = NetFeatures(body.axles, columns, hidden, 0.1 * rover.wheel_radius, torch.tensor(sizes, dtype=torch.float64))
    return PAlpaca(body, soil.constants(), prior, net)


def train(model: PAlpaca, rover: Rover, soil: Soil, recipe: Recipe) -> Iterator[Progress]:
    """Train ``model`` in place, yielding after every iteration."""
    generator = torch.Generator().manual_seed(recipe.seed)
    for parameter in model.net.parameters():
        bound = parameter.shape[-1] ** -0.5
        torch.nn.init.uniform_(parameter, -bound, bound, generator=generator)
    data = regression(model, draw_tasks(rover, soil, "S1", recipe.duration_s, recipe.tasks, generator), generator)
    log_precision = torch.zeros(recipe.columns, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([*model.net.parameters(), log_precision], lr=recipe.learning_rate)
    for iteration in range(recipe.iterations):
        chosen = torch.randperm(recipe.tasks, generator=generator)[: recipe.batch]
        context = torch.randint(0, data.valid.shape[1] - 1, (recipe.batch,), generator=generator)
        loss, shared = _loss(model, data, chosen, context, log_precision)
        optimizer.zero_grad()
        (loss + recipe.orthogonality * shared).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        yield Progress(iteration, loss.item(), shared.item())
    model.net_precision.copy_(log_precision.detach().exp())
    for parameter in model.net.parameters():
        parameter.requires_grad = False  # a scripted module with gradients fails where none are recorded


def _loss(
    model: PAlpaca, data: Regression, chosen: torch.Tensor, context: torch.Tensor, log_precision: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Predictive loss and overlap of some tasks."""
    inputs = data.inputs[chosen]
    rows = data.whitener.shape[-1]
    columns = model.learnt(inputs.flatten(0, 2))[:, :rows].reshape(*inputs.shape[:3], rows, -1).mean(2)
    learnt = data.whitener[chosen] @ columns
    nominal = data.nominal[chosen]
    others = nominal.new_zeros(nominal.shape[-1] - 2)
    mean = torch.cat([model.prior_mean / model.unit, others, torch.zeros_like(log_precision)])
    precision = torch.cat([(model.prior_sd / model.unit) ** -2.0, others + 1.0, log_precision.exp()])
    features = torch.cat([nominal, learnt], -1)
    loss = negative_log_predictive(features, data.target[chosen], data.valid[chosen], context, mean, precision)
    return loss, overlap(nominal[..., :2], learnt, data.valid[chosen])
