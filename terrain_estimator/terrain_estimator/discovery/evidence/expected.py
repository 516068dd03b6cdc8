# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Expected log Bayes factors between effects, from linearised rows.

Where the truth changes the rows by m beside noise of covariance S, a hypothesis that can change
them by C s, with the runs' own unknowns u free under their priors, is expected to be worse, by the
rule of ``equations``, by

    1/2 min over u, s, D of  r' W r + tr(W S) - N + log det (S + D) - log det S + priors,
    r = m - J u - C s,   W = (S + D)^-1

with D the excess variance of each row of a run, which counts as noise under a wrong hypothesis. For
a small r it is the divergence of Kullback and Leibler 1951.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.equations import Equations, positions
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.model.gaussian import cholesky, log_determinant


@dataclass(frozen=True, slots=True)
class Stage:
    """The linearised rows of one run."""

    covariance: Tensor  # [B, Q, Q] S
    present: Tensor  # [B, Q] 1 where a row is there
    own: Tensor  # [B, Q, P] change by the run's own unknowns, then by the rover's constants
    precision: Tensor  # [P] of their priors


def stage(
    equations: Equations, unknowns: Unknowns, excess: Tensor, doubted: int = 0, runs: int = 1
) -> Stage:
    """Return the rows of a fit; ``excess`` [Q] is noise beyond that of the sensors.

    The first shared unknowns are those of the ``doubted`` constants of the rover, which all
    ``runs`` share. They count as each run's own, with priors so wide that one change of all runs
    has its right price.
    """
    noise = equations.covariance + torch.diag_embed(excess * equations.present)
    own, precision = own_columns(equations, unknowns), unknowns.prior_moments()[1]
    if doubted:
        first = 5 + unknowns.kappa.shape[0]
        own = torch.cat([own, equations.jacobian[..., first : first + doubted]], -1)
        shared = torch.full((doubted,), 1.0 / runs, dtype=torch.float64)
        precision = torch.cat([precision, shared])
    return Stage(noise, equations.present, own, precision)


def own_columns(equations: Equations, unknowns: Unknowns) -> Tensor:
    """Return the change of the rows by every unknown of their run, [B, Q, P]."""
    blocks, count = equations.residual.shape
    local = 5 + unknowns.kappa.shape[0]
    index = positions(blocks, local - 2, equations.ends, 0).unsqueeze(1).expand(-1, count, -1)
    own = torch.zeros(blocks, count, unknowns.flat().shape[0], dtype=torch.float64)
    return own.scatter_add_(2, index, equations.jacobian[..., :local])


@dataclass(frozen=True, slots=True)
class Loss:
    """The shortfall of an explanation."""

    nats: float
    excess: tuple[Tensor, ...]  # [Q] of each run: what it takes for noise
    # [1 + K, 1 + K] products of signature and columns, less what the own unknowns explain
    gram: Tensor


def loss(
    stages: Sequence[Stage],
    tables: Sequence[Tensor],
    ends: tuple[float, float] | None,
    excess: Sequence[Tensor] | None = None,
) -> Loss:
    """Return the shortfall of columns against a signature.

    ``tables`` [B, Q, 1 + K] of every run have the signature first.

    The first column has a coefficient inside ``ends``, the others one of deviation 1 that grows
    with it; where ``ends`` is None no column is used. ``excess`` is where to begin.
    """
    spread = list(excess or [table[..., 0].square().mean(0) for table in tables])
    best = Loss(float("inf"), (), torch.zeros(0))
    for _ in range(_ROUNDS):
        found = [
            _eliminated(stage, table, own)
            for stage, table, own in zip(stages, tables, spread, strict=True)
        ]
        gram = torch.stack([each[0] for each in found]).sum(0)
        mix, prior = _mixed(gram, ends)
        nats = 0.5 * prior
        for k, (stage, (_, rest, penalty)) in enumerate(zip(stages, found, strict=True)):
            spread[k] = _excess(stage, rest @ mix, spread[k])
            nats += 0.5 * (_misfit(stage, rest @ mix, spread[k]) + float(mix @ penalty @ mix))
        settled = nats > best.nats - max(_SETTLED, _RELATIVE * nats)
        if nats < best.nats:
            best = Loss(nats, tuple(spread), gram)
        if settled:
            break
    return best


_ROUNDS = 12
_SETTLED, _RELATIVE = 0.1, 3e-3


def _eliminated(stage: Stage, table: Tensor, excess: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Eliminate the own unknowns at their best for each column.

    Returns products of the columns, the columns, and the priors' part.
    """
    factor = cholesky(stage.covariance + torch.diag_embed(excess * stage.present))
    size = stage.own.shape[2]
    white = torch.linalg.solve_triangular(
        factor, torch.cat([stage.own, table], 2), upper=False
    ).flatten(0, 1)
    own, rest = white[:, :size], white[:, size:]
    cross = own.T @ rest
    best = torch.cholesky_solve(cross, cholesky(own.T @ own + torch.diag(stage.precision)))
    return (
        rest.T @ rest - cross.T @ best,
        table - stage.own @ best,
        best.T @ (stage.precision.unsqueeze(1) * best),
    )


def _mixed(gram: Tensor, ends: tuple[float, float] | None) -> tuple[Tensor, float]:
    """Return the mix of signature and columns, [1 + K], and the priors' part of all but the first.

    It is 1 for the signature, and the share that each column takes off.
    """
    mix = torch.zeros(gram.shape[0], dtype=torch.float64)
    mix[0], share = 1.0, 1.0
    if ends is None:
        return mix, 0.0
    prior = torch.zeros_like(mix[2:])
    for _ in range(_TIMES):
        prior = torch.full_like(mix[2:], max(abs(share), _SMALLEST) ** -2)
        normal = gram[1:, 1:] + torch.diag(
            torch.cat([torch.full((1,), 1e-12, dtype=torch.float64), prior])
        )
        share = min(max(float(torch.linalg.solve(normal, gram[1:, 0])[0]), ends[0]), ends[1])
    mix[1] = -share
    mix[2:] = -torch.linalg.solve(
        gram[2:, 2:] + torch.diag(prior), gram[2:, 0] - share * gram[2:, 1]
    )
    return mix, float((prior * mix[2:].square()).sum())


_TIMES = 4
_SMALLEST = 1e-3


def _excess(stage: Stage, rest: Tensor, start: Tensor) -> Tensor:
    """Return the most likely D [Q] for a rest beside noise of covariance S.

    Iterated as ``equations.excess_variance``.
    """
    least = 1e-6 * (stage.covariance.diagonal(dim1=1, dim2=2) * stage.present).mean(0)
    excess = torch.maximum(start, least)
    for _ in range(_TIMES):
        weight = torch.cholesky_inverse(
            cholesky(stage.covariance + torch.diag_embed(excess * stage.present))
        )
        pull = (weight @ rest.unsqueeze(-1)).squeeze(-1).square() + (
            weight @ stage.covariance @ weight
        ).diagonal(dim1=1, dim2=2)
        there = (weight.diagonal(dim1=1, dim2=2) * stage.present).sum(0).clamp(min=1e-30)
        excess = torch.maximum(
            excess * ((pull * stage.present).sum(0) / there).clamp(0.05, 20.0), least
        )
    return excess


def _misfit(stage: Stage, rest: Tensor, excess: Tensor) -> float:
    """Return r' W r + tr(W S) - N + log det (S + D) - log det S."""
    factor = cholesky(stage.covariance + torch.diag_embed(excess * stage.present))
    weighted = torch.cholesky_solve(torch.cat([rest.unsqueeze(-1), stage.covariance], 2), factor)
    noise = weighted[..., 1:].diagonal(dim1=1, dim2=2).sum() - rest.numel()
    volume = (log_determinant(factor) - log_determinant(cholesky(stage.covariance))).sum()
    return float((rest * weighted[..., 0]).sum() + noise + volume)
