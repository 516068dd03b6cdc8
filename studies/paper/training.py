# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's training.

The loss is the negative log predictive of the rest of a task given a context of random length, with
two penalties.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from studies.baselines.drives import LevelDrives
from studies.baselines.features import FeatureSpan, LearntModel, net_inputs
from terrain_estimator.learning.loss import (
    Orthogonality,
    negative_log_predictive,
    overlap,
    paper_penalty,
    shortfall,
)


@dataclass(frozen=True, slots=True)
class PaperRecipe:
    """Settings of a training.

    The paper has 1000 iterations of 20 tasks, the authors' code 40 steps a task.
    """

    seed: int = 0
    iterations: int = 1000
    batch: int = 20
    steps: int = 40
    learning_rate: float = 1e-3
    prior_rate: float = 1e-2  # of prior and noise, which are few and far from their start
    # as in the figure: the authors' code applies it to the mean over tasks and rows, not to the sum
    strength: float = 0.0
    orthogonality: Orthogonality = Orthogonality.PAPER
    positivity: float = 1.0  # weight of the mean shortfall of c [kPa] and tan phi below zero


@dataclass(frozen=True, slots=True)
class PaperProgress:
    """One iteration."""

    iteration: int
    loss: float  # mean negative log predictive density of a velocity increment in m/s [nat]
    penalty: float  # orthogonality, not multiplied by its strength


@dataclass(frozen=True, slots=True)
class _Data:
    """Data that stay constant in a training."""

    nominal: Tensor  # [tasks, time, 3]
    inputs: Tensor  # [tasks, time, INPUTS]
    increment: Tensor  # [tasks, time]


def train(model: LearntModel, drives: LevelDrives, recipe: PaperRecipe) -> Iterator[PaperProgress]:
    """Train ``model`` in place on noisy drives, yielding after every iteration."""
    generator = torch.Generator().manual_seed(recipe.seed)
    for parameter in model.net.parameters():
        bound = parameter.shape[-1] ** -0.5
        torch.nn.init.uniform_(parameter, -bound, bound, generator=generator)
    model.scale_inputs(drives)
    data = _Data(model.nominal_features(drives), net_inputs(drives), drives.increment)
    slow = {"params": list(model.net.parameters()), "lr": recipe.learning_rate}
    fast = {"params": [model.mean, model.log_precision, model.log_noise], "lr": recipe.prior_rate}
    optimizer = torch.optim.Adam([slow, fast])
    tasks, time = data.increment.shape
    for iteration in range(recipe.iterations):
        chosen = torch.randint(0, tasks, (recipe.batch, 1), generator=generator)
        steps = (
            torch.rand(recipe.batch, time, generator=generator)
            .argsort(1)[:, : recipe.steps]
            .sort(1)
            .values
        )
        context = torch.randint(0, recipe.steps - 1, (recipe.batch,), generator=generator)
        loss, penalty, negative = _losses(
            model, data, (chosen, steps), context, recipe.orthogonality
        )
        optimizer.zero_grad()
        total = loss + recipe.strength * penalty + recipe.positivity * negative
        total.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        yield PaperProgress(iteration, loss.item(), penalty.item())
    _share(model, data)
    for parameter in model.parameters():
        parameter.requires_grad = False


def _losses(
    model: LearntModel,
    data: _Data,
    place: tuple[Tensor, Tensor],
    context: Tensor,
    orthogonality: Orthogonality,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return predictive loss, orthogonality and shortfall of some samples of some tasks."""
    nominal, inputs = data.nominal[place], data.inputs[place]
    target = data.increment[place] - nominal[..., -1]
    if model.span is FeatureSpan.PROJECTED:
        _regress(model, nominal[..., :-1], inputs)
    features = model.joined(nominal[..., :-1], inputs)
    noise, (mean, precision) = model.noise(), model.prior()
    valid = torch.ones_like(target)
    whitened = features / noise
    loss = negative_log_predictive(
        whitened.unsqueeze(2), (target / noise).unsqueeze(2), valid, context, mean, precision
    )
    loss = loss + model.log_noise
    if model.nominal == 0:
        return loss, torch.zeros_like(loss), torch.zeros_like(loss)
    if orthogonality is Orthogonality.PAPER:
        penalty = paper_penalty(features.unsqueeze(2)) / features.shape[0]
    else:
        penalty = overlap(features[..., :2].unsqueeze(2), features[..., 2:].unsqueeze(2), valid)
    return loss, penalty, shortfall(whitened, target / noise, mean, precision)


def _regress(model: LearntModel, nominal: Tensor, inputs: Tensor) -> None:
    """Regress the learnt features on the nominal ones; ``PROJECTED`` subtracts that share."""
    with torch.no_grad():
        learnt = model.net((inputs - model.input_mean) / model.input_scale).flatten(0, -2)
        flat = nominal.flatten(0, -2)
        model.shared.copy_(torch.linalg.lstsq(flat, learnt, driver="gelsd").solution)


def _share(model: LearntModel, data: _Data) -> None:
    """Store that regression over the whole training set, for use."""
    if model.span is FeatureSpan.PROJECTED:
        _regress(model, data.nominal[..., :-1], data.inputs)
