# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A held-out run in two halves, each predicted with the ground that the other half gives.

c, tan phi, the soil constants and the accelerometer's bias are a run's own, so they have to be
fitted to something: to the half that is not being judged. The sizes of effects are never fitted
here, they come from other runs.
"""

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.fit import Fit
from terrain_estimator.discovery.evidence.search import Study
from terrain_estimator.discovery.hypotheses.contributions import ContributionTask
from terrain_estimator.discovery.hypotheses.equations import Equations, Query, assembled
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.leftover.flexible import no_columns
from terrain_estimator.discovery.runs import PIECE, Blocks, RunError
from terrain_estimator.model.gaussian import cholesky

SHORTEST_HALF = 8
"""[blocks] of a half of a run: eight seconds."""


@dataclass(frozen=True, slots=True)
class Model:
    """A hypothesis with the sizes that other runs gave."""

    hypothesis: Hypothesis
    values: Tensor  # [K] as ``Fit.point.shared``
    covariance: Tensor  # [K, K]


@dataclass(frozen=True, slots=True)
class GroundEstimate:
    """The ground of a half of a run, under one model."""

    unknowns: Unknowns  # the velocities are that half's
    # [P + K, P + K] of theta, soil constants, bias and sizes, by the sensors' stated noise
    covariance: Tensor


@dataclass(frozen=True, slots=True)
class Half:
    """A half of a run, and the ground that the other half gives under each model."""

    blocks: Blocks
    grounds: tuple[GroundEstimate, ...]


def long_enough(run: Blocks) -> Blocks:
    """Return the run where it can be halved.

    Raises:
        RunError: it is too short, or a half has no piece without a gap that is long enough for a
            rollout.
    """
    count = len(run.packed)
    if count < 2 * SHORTEST_HALF:
        raise RunError(
            f"{run.name}: {count} whole seconds, a held-out run needs at least {2 * SHORTEST_HALF}"
        )
    if not all(half.pieces(PIECE) for half in _halved(run)):
        raise RunError(
            f"{run.name}: a held-out run needs {PIECE} s in one piece in each half, there are gaps"
            " everywhere"
        )
    return run


def _halved(run: Blocks) -> tuple[Blocks, Blocks]:
    count = len(run.packed)
    return run.between(0, count // 2), run.between(count // 2, count)


@torch.inference_mode()
def halves(nominal: Nominal, models: tuple[Model, ...], run: Blocks) -> tuple[Half, Half]:
    """Return both halves of a held-out run; the same procedure for every model.

    Raises:
        RunError: see ``long_enough``.
    """
    parts = _halved(long_enough(run))
    grounds = [_grounds(Study(nominal, [part]), models) for part in parts]
    return Half(parts[0], grounds[1]), Half(parts[1], grounds[0])


def _grounds(study: Study, models: tuple[Model, ...]) -> tuple[GroundEstimate, ...]:
    fits = _fits(study, models)
    return tuple(
        GroundEstimate(fit.point.runs[0], _covariance(fit.point.runs[0], fit.equations[0], model))
        for fit, model in zip(fits, models, strict=True)
    )


def _fits(study: Study, models: tuple[Model, ...]) -> list[Fit]:
    return [
        (
            study.given(model.hypothesis, model.values)
            if model.hypothesis.effects
            else study.nothing
        ).fit
        for model in models
    ]


@torch.inference_mode()
def evidences(nominal: Nominal, models: tuple[Model, ...], run: Blocks) -> list[float]:
    """Return the log evidence [nat] of a held-out run under each model, up to a constant."""
    return [fit.given for fit in _fits(Study(nominal, [run]), models)]


def _covariance(unknowns: Unknowns, equations: Equations, model: Model) -> Tensor:
    """Return the covariance of a run's own unknowns but the velocities, then of the sizes.

    Misfit beyond the sensors' noise counts for nothing.
    """
    sizes = model.values.shape[0]
    weighted = torch.zeros_like(equations.residual).unsqueeze(-1)
    hessian, _ = assembled(
        equations.jacobian, cholesky(equations.covariance), weighted, equations.ends, sizes
    )
    _, precision = unknowns.prior_moments()
    size, own = precision.shape[0], 3 + unknowns.kappa.shape[0]
    covariance = torch.cholesky_inverse(cholesky(hessian[:size, :size] + torch.diag(precision)))
    parts = covariance[:own, :own], model.covariance
    return torch.block_diag(*parts)  # type: ignore[no-untyped-call]


def equations_of(nominal: Nominal, half: Half, number: int, model: Model) -> Equations:
    """Return the equations of a half at the ground of the other one, with all velocities at zero.

    ``number`` is that of the ``model``.
    """
    other = half.grounds[number].unknowns
    columns = no_columns([half.blocks]).columns[0]
    mask = torch.ones(columns.shape[1] - 1, dtype=torch.float64)
    velocity = torch.zeros(half.blocks.velocities, dtype=torch.float64)
    there = dataclasses.replace(other, velocity=velocity)
    none = torch.zeros(0, dtype=torch.float64)
    query = Query(
        there, tuple(model.values.tolist()), none, columns, model.hypothesis.shared().step, None
    )
    return ContributionTask(nominal, model.hypothesis.effects, mask)(half.blocks, query)
