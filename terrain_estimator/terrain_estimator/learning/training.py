# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training of the network and its prior, reproducible from the seed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn

from rover_parameters.records import ConfigError
from terrain_estimator.learning.loss import (
    Orthogonality,
    negative_log_predictive,
    overlap,
    paper_penalty,
    shortfall,
    span_share,
    whiten,
)
from terrain_estimator.learning.regression import Regression, distinct_rows
from terrain_estimator.model.constant_columns import ConstantColumns
from terrain_estimator.model.net import NetFeatures
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics import Physics, RoverBody
from terrain_estimator.model.physics_by_law import LinearStresses, PhysicsByLaw, ScmStresses
from terrain_estimator.model.physics_on_varying_ground import PhysicsOnVaryingGround
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terrain_estimator.model.row_names import row_names
from terramechanics.terrain.soil import SCM, WONG_REECE, Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import geometry_of

LEAST_NOISE = 0.05
"""[row scale] Learnt noise at the start of a training."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """Settings of a training."""

    seed: int = 0
    iterations: int = 1000
    batch: int = 20
    columns: int = 6
    hidden: int = 128
    learning_rate: float = 3e-3  # of the net, falling to zero along a cosine
    prior_rate: float = 1e-2  # of prior and noise, likewise
    orthogonality: Orthogonality = Orthogonality.SPAN
    strength: float = 0.1  # weight of the orthogonality penalty
    positivity: float = 1.0  # weight of the mean shortfall of c [kPa] and tan phi below zero
    caution: float = 1.0  # divisor of the learnt prior deviations of the net's weights


@dataclass(frozen=True, slots=True)
class Progress:
    """One iteration."""

    iteration: int
    # mean negative log predictive density of a row [nat], less that of the sensors' noise scale
    loss: float
    overlap: float  # squared cosine between learnt and nominal features


def body_of(rover: Rover) -> RoverBody:
    """Return the properties of ``rover`` that the rows need.

    Raises ConfigError for a rover that is not planar.
    """
    rover.check_planar()
    return RoverBody(
        row_names(rover.axles),
        rover.axles,
        rover.wheels_per_axle,
        rover.mass,
        rover.gravity,
        rover.wheel_radius,
        rover.wheel_width,
        geometry_of(rover),
    )


def build_model(
    rover: Rover,
    soils: Sequence[Soil],
    columns: int = 0,
    hidden: int = 1,
    prior: Prior = DEFAULT_PRIOR,
    *,
    moments: bool = True,
    used_rows: Sequence[str] = (),
) -> PAlpaca:
    """Return the model of a rover with these soils: its physics, and an untrained net.

    Without ``columns`` there is no net. With ``moments`` it has columns in the moment rows, too.
    Where ``used_rows`` are named, no other row counts.
    """
    constants = torch.stack([soil.constants() for soil in soils])
    physics = Physics(body_of(rover), constants, prior.constants_sd)
    net = _net(rover, columns, hidden, moments=moments) if columns else _no_net(rover)
    model = PAlpaca(_of_ground(physics, law_of(soils), prior), net, prior)
    if used_rows:
        names = row_names(rover.axles)
        used = torch.tensor([float(name in used_rows) for name in names], dtype=torch.float64)
        model.every_row.copy_(used)
    return model


def _of_ground(
    physics: Physics, law: str, prior: Prior
) -> Physics | PhysicsByLaw | PhysicsOnVaryingGround:
    """Return the physics of a contact law on even ground, or on ground that varies."""
    if law != WONG_REECE:
        if prior.ground_variation:
            raise ConfigError(
                f"ground_variation {prior.ground_variation:g}: with law {law} the ground has to be"
                f" even: give 0, or soils of law {WONG_REECE}"
            )
        return PhysicsByLaw(physics, ScmStresses() if law == SCM else LinearStresses())
    if prior.ground_variation:
        return PhysicsOnVaryingGround(physics, prior.ground_variation)
    return physics


def _no_net(rover: Rover) -> NetFeatures:
    """Return no columns, with the methods of a net."""
    none = torch.zeros(len(row_names(rover.axles)), 0, dtype=torch.float64)
    return cast("NetFeatures", ConstantColumns(none))


def _net(rover: Rover, columns: int, hidden: int, *, moments: bool) -> NetFeatures:
    torque = 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)
    # scale of a learnt effect in each row
    sizes = [
        0.05 * rover.gravity,
        0.05,
        *([0.05 * torque] * rover.axles),
        *([0.05] * (1 + len(rover.suspension)) if moments else []),
    ]
    return NetFeatures(
        rover.axles,
        columns,
        hidden,
        0.1 * rover.wheel_radius,
        torch.tensor(sizes, dtype=torch.float64),
    )


def law_of(soils: Sequence[Soil]) -> str:
    """Return the contact law of the soils of a model.

    Raises ConfigError where they have several: a model's observations have one.
    """
    laws = sorted({soil.law for soil in soils})
    if len(laws) > 1:
        raise ConfigError(
            f"soils of one model have one contact law, not {' and '.join(laws)}:"
            f" {', '.join(f'{soil.name} has {soil.law}' for soil in soils)}"
        )
    return laws[0]


class _Learnt(nn.Module):
    """Learnt precision of the prior of the net's weights, and noise beyond that of the sensors."""

    def __init__(self, columns: int, rows: int) -> None:
        super().__init__()
        self.log_precision = nn.Parameter(torch.zeros(columns, dtype=torch.float64))
        self.log_noise = nn.Parameter(torch.full((rows,), LEAST_NOISE, dtype=torch.float64).log())


def train(
    model: PAlpaca, data: Regression, recipe: Recipe, device: torch.device | None = None
) -> Iterator[Progress]:
    """Train net, prior and noise of ``model`` in place on ``data``, yielding after every iteration.

    All random numbers are drawn on the CPU, so that a seed means the same on every device. On the
    CPU the same seed gives the same model to the byte. The model is left on the CPU.
    """
    device = device or torch.device("cpu")
    generator = torch.Generator().manual_seed(recipe.seed)
    for parameter in model.net.parameters():
        bound = parameter.shape[-1] ** -0.5
        torch.nn.init.uniform_(parameter, -bound, bound, generator=generator)
    learnt = _Learnt(model.net.columns, data.target.shape[-1])
    for part in (model, learnt):
        part.to(device)
    data = data.to(device)
    groups = [
        {"params": list(model.net.parameters()), "lr": recipe.learning_rate},
        {"params": list(learnt.parameters()), "lr": recipe.prior_rate},
    ]
    optimizer = torch.optim.Adam(groups)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, recipe.iterations)
    tasks, blocks = data.valid.shape
    for iteration in range(recipe.iterations):
        chosen = torch.randperm(tasks, generator=generator)[: recipe.batch]
        context = torch.randint(0, blocks - 1, (recipe.batch,), generator=generator)
        loss, shared, penalties = _losses(
            model, learnt, data.of(chosen.to(device)), context.to(device), recipe
        )
        optimizer.zero_grad()
        (loss + penalties).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
        yield Progress(iteration, loss.item(), shared.item())
    _adopt(model.cpu(), learnt.cpu(), recipe)


def _adopt(model: PAlpaca, learnt: _Learnt, recipe: Recipe) -> None:
    """Set the prior of the net's weights, and drop the gradients of the parameters.

    A scripted module whose parameters have gradients fails in inference mode.
    """
    model.hypotheses.net_precision.copy_(learnt.log_precision.detach().exp() * recipe.caution**2)
    for parameter in model.net.parameters():
        parameter.requires_grad = False


def _losses(
    model: PAlpaca, learnt: _Learnt, data: Regression, context: Tensor, recipe: Recipe
) -> tuple[Tensor, Tensor, Tensor]:
    """Return predictive loss, overlap, and weighted penalties of some tasks."""
    nominal_count = data.nominal.shape[-1]
    columns = model.learnt(data.inputs.flatten(0, 1))[:, distinct_rows(model.axles)].unflatten(
        0, data.valid.shape
    )  # type: ignore[no-untyped-call]
    noise = (learnt.log_noise.exp() * model.net.row_scale).square()
    joined = torch.cat([data.nominal, columns, data.target.unsqueeze(-1)], -1)
    whitened, cost = whiten(joined, data.covariance, noise)
    features, target = whitened[..., :-1], whitened[..., -1]
    others = features.new_zeros(nominal_count - 2)
    prior, unit = model.hypotheses, model.hypotheses.unit
    mean = torch.cat([prior.prior_mean / unit, others, torch.zeros_like(learnt.log_precision)])
    precision = torch.cat(
        [(prior.prior_sd / unit) ** -2.0, others + 1.0, learnt.log_precision.exp()]
    )
    loss = negative_log_predictive(features, target, data.valid, context, mean, precision, cost)
    nominal, net = features[..., :nominal_count], features[..., nominal_count:]
    shared = overlap(nominal[..., :2], net, data.valid)
    penalties = torch.zeros_like(loss)
    if recipe.strength > 0.0:
        if recipe.orthogonality is Orthogonality.PAPER:
            penalty = paper_penalty(joined[..., :-1]) / joined.shape[0]
        else:
            penalty = (
                shared
                if recipe.orthogonality is Orthogonality.WHITENED
                else span_share(nominal, net, data.valid)
            )
        penalties = penalties + recipe.strength * penalty
    if recipe.positivity > 0.0:
        weight = data.valid.unsqueeze(-1)
        flat = (features * weight.unsqueeze(-1)).flatten(1, 2), (target * weight).flatten(1, 2)
        penalties = penalties + recipe.positivity * shortfall(*flat, mean, precision)
    return loss, shared, penalties
