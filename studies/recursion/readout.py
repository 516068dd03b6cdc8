# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimates from the accumulated statistic: Gauss-Newton over (c, tan phi, kappa, body).

Ways to use the MOMENTS scores m(k), of variance V(k), beside the prior (k_0, Lambda_0):

- "moments": minimise m' V^-1 m + (k - k_0)' Lambda_0 (k - k_0) (generalised method of moments,
  Hansen 1982). Its information D' V^-1 D is never indefinite.
- "combined": the same with the SIZE scores J' m, J = d psi / d k, and their variance J' V J.
- "scores": J' m + Lambda_0 (k_0 - k) = 0, and the sandwich covariance
  P^-1 (J' V J + Lambda_0) P^-1, P = J' (A - C) J + Lambda_0 clamped to at least Lambda_0.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from studies.recursion.lift import BODY, CONSTANTS, FIRST, LIFTED, LiftedPoint, lift
from studies.recursion.statistic import PRODUCTS, Statistic

SIZE = 2 + CONSTANTS + BODY
STARTS = ((-0.8, -0.8), (-0.8, 0.8), (0.8, -0.8), (0.8, 0.8))
"""[prior deviations] of c and tan phi, at which the search starts."""
STEPS = 8
LONGEST = (1.0, 0.25)
"""Longest step of c [kPa] and of tan phi."""


class PriorOf(NamedTuple):
    """Mean and precision of k."""

    mean: Tensor  # [SIZE]
    precision: Tensor  # [SIZE]


class ReadOut(NamedTuple):
    """Estimates of G drives."""

    k: Tensor  # [G, SIZE]
    covariance: Tensor  # [G, SIZE, SIZE]
    misfit: Tensor  # [G] m' V^-1 m and the distance to the prior
    clamped: Tensor  # [G] share of the information that was below zero and was left out


class _Step(NamedTuple):
    k: Tensor
    covariance: Tensor
    misfit: Tensor  # before the step
    clamped: Tensor


def score_variance(statistic: Statistic, k: Tensor) -> Tensor:
    """Return the variance of the scores at k [G, SIZE], [G, MOMENTS, MOMENTS]."""
    theta = torch.cat([k[:, :2], torch.ones_like(k[:, :1])], 1)
    products = torch.stack([theta[:, a] * theta[:, b] for a, b in PRODUCTS], 1)
    parts = statistic.variance
    whole = parts[:, 0] + (parts[:, 1:] * products[..., None, None]).sum(1)
    return 0.5 * (whole + whole.transpose(1, 2))


def root_of(variance: Tensor) -> Tensor:
    """Return a Cholesky factor of a variance [G, n, n] that is singular while blocks are few.

    The least part of the diagonal is added that makes it definite.
    """
    scale = torch.diagonal(variance, dim1=1, dim2=2).clamp(min=1e-30).sqrt()
    unit = variance / (scale.unsqueeze(2) * scale.unsqueeze(1))
    eye = torch.eye(unit.shape[1], dtype=unit.dtype)
    factor, info = torch.linalg.cholesky_ex(unit + JITTERS[0] * eye)
    for jitter in JITTERS[1:]:
        failed = (info > 0).view(-1, 1, 1)
        if not bool(failed.any()):
            break
        factor, info = torch.linalg.cholesky_ex(
            torch.where(failed, unit + jitter * eye, unit + JITTERS[0] * eye)
        )
    return scale.unsqueeze(2) * factor


JITTERS = (1e-7, 1e-5, 1e-3, 1e-1, 10.0)
"""[1] Parts of the diagonal that are added until a variance is definite."""


def scores_at(statistic: Statistic, point: LiftedPoint) -> tuple[Tensor, Tensor]:
    """Return the scores [G, MOMENTS] and minus their derivatives [G, MOMENTS, SIZE]."""
    net = statistic.information - statistic.correction
    value = statistic.score - (net @ point.psi.unsqueeze(2)).squeeze(2)
    return value, net @ point.jacobian


def instruments_at(point: LiftedPoint) -> Tensor:
    """Return J' [G, SIZE, MOMENTS], which combines the scores as least squares would at a point."""
    return torch.cat([point.jacobian[:, :FIRST], point.jacobian[:, LIFTED:]], 1).transpose(1, 2)


def _minimise(value: Tensor, slope: Tensor, factor: Tensor, k: Tensor, prior: PriorOf) -> _Step:
    """Return the Gauss-Newton step of m' V^-1 m and the prior's term; ``factor`` is V's."""
    white = torch.linalg.solve_triangular(
        factor, torch.cat([slope, value.unsqueeze(2)], 2), upper=False
    )
    told, surprise = white[..., :-1], white[..., -1:]
    pull = ((prior.mean - k) * prior.precision).unsqueeze(2)
    information = told.transpose(1, 2) @ told + torch.diag(prior.precision)
    root = torch.linalg.cholesky(information)
    step = torch.cholesky_solve(told.transpose(1, 2) @ surprise + pull, root).squeeze(2)
    misfit = (surprise**2).sum((1, 2)) + (prior.precision * (prior.mean - k) ** 2).sum(1)
    return _Step(k + step, torch.cholesky_inverse(root), misfit, torch.zeros_like(misfit))


def _by_moments(statistic: Statistic, k: Tensor, prior: PriorOf) -> _Step:
    value, slope = scores_at(statistic, lift(k))
    return _minimise(value, slope, root_of(score_variance(statistic, k)), k, prior)


def _by_combined(statistic: Statistic, k: Tensor, prior: PriorOf) -> _Step:
    point = lift(k)
    value, slope = scores_at(statistic, point)
    kept = instruments_at(point)
    variance = kept @ score_variance(statistic, k) @ kept.transpose(1, 2)
    return _minimise(
        (kept @ value.unsqueeze(2)).squeeze(2), kept @ slope, root_of(variance), k, prior
    )


def _by_scores(statistic: Statistic, k: Tensor, prior: PriorOf) -> _Step:
    point = lift(k)
    value, slope = scores_at(statistic, point)
    kept = instruments_at(point)
    variance = score_variance(statistic, k)
    noise = kept @ variance @ kept.transpose(1, 2)
    pull = (prior.mean - k) * prior.precision
    gradient = (kept @ value.unsqueeze(2)).squeeze(2) + pull
    raw = kept @ slope
    # in the metric of the prior and the scores' variance, which is positive definite
    root = root_of(noise + torch.diag(prior.precision))
    turned = torch.linalg.solve_triangular(root, 0.5 * (raw + raw.transpose(1, 2)), upper=False)
    turned = torch.linalg.solve_triangular(root, turned.transpose(1, 2), upper=False)
    values, vectors = torch.linalg.eigh(0.5 * (turned + turned.transpose(1, 2)))
    basis = root @ vectors
    information = basis * values.clamp(min=0.0).unsqueeze(1) @ basis.transpose(1, 2)
    information = information + torch.diag(prior.precision)
    inverse = torch.linalg.inv(information)
    misfit = (value * torch.cholesky_solve(value.unsqueeze(2), root_of(variance)).squeeze(2)).sum(1)
    misfit = misfit + (prior.precision * (prior.mean - k) ** 2).sum(1)
    clamped = (-values).clamp(min=0.0).sum(1) / values.abs().sum(1).clamp(min=1e-30)
    covariance = inverse @ (noise + torch.diag(prior.precision)) @ inverse
    return _Step(k + (inverse @ gradient.unsqueeze(2)).squeeze(2), covariance, misfit, clamped)


WAYS = {"moments": _by_moments, "combined": _by_combined, "scores": _by_scores}


def _limited(before: Tensor, after: Tensor) -> Tensor:
    """Return the step's end, nearer where it moves c or tan phi too far."""
    step = after - before
    most = (step[:, :2].abs() / step.new_tensor(LONGEST)).amax(1, keepdim=True)
    return before + step / most.clamp(min=1.0)


def refine(
    statistic: Statistic, k: Tensor, prior: PriorOf, way: str, steps: int = STEPS
) -> ReadOut:
    """Return the estimates after this many Gauss-Newton steps from k [G, SIZE]."""
    for _ in range(steps):
        k = _limited(k, WAYS[way](statistic, k, prior).k)
    last = WAYS[way](statistic, k, prior)
    return ReadOut(k, last.covariance, last.misfit, last.clamped)


def read_out(statistic: Statistic, prior: PriorOf, way: str) -> ReadOut:
    """Return the best of the estimates that the fixed starts lead to."""
    drives = statistic.score.shape[0]
    spread = prior.precision[:2] ** -0.5
    found = []
    for corner in STARTS:
        start = prior.mean.repeat(drives, 1)
        start[:, :2] += spread * spread.new_tensor(corner)
        found.append(refine(statistic, start, prior, way))
    misfit = torch.stack([torch.nan_to_num(each.misfit, nan=torch.inf) for each in found])
    best = misfit.argmin(0)
    every = torch.arange(drives)
    return ReadOut(*(torch.stack(fields)[best, every] for fields in zip(*found, strict=True)))
