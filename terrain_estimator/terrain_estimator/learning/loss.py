# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The meta-learning loss of P-ALPaCA, its orthogonality penalties and its positivity term."""

import math
from enum import Enum

import torch
from torch import Tensor

from terrain_estimator.model.gaussian import cholesky, log_determinant


def log_marginal(
    features: Tensor, target: Tensor, weight: Tensor, mean: Tensor, precision: Tensor
) -> Tensor:
    """Return log p(target) [tasks] with unit noise under k ~ N(mean, diag(precision)^-1).

    ``features`` [tasks, n, D], ``target`` [tasks, n], ``weight`` [tasks, n] 1 where the row counts,
    ``mean`` and ``precision`` [D]. For the conjugate recursion (Banerjee et al. eqs. 20 and 21) the
    sum of the one-step log predictives is this log marginal likelihood, so that one Cholesky
    replaces the recursion.
    """
    features, residual = features * weight.unsqueeze(-1), (target - features @ mean) * weight
    gathered = features.transpose(1, 2) @ features + torch.diag(precision)
    factor = cholesky(gathered)
    pull = (features.transpose(1, 2) @ residual.unsqueeze(-1)).squeeze(-1)
    explained = (pull * torch.cholesky_solve(pull.unsqueeze(-1), factor).squeeze(-1)).sum(-1)
    misfit = residual.square().sum(-1) - explained
    volume = log_determinant(factor) - torch.log(precision).sum()
    return -0.5 * (misfit + volume + weight.sum(-1) * math.log(2.0 * math.pi))


def negative_log_predictive(
    features: Tensor,
    target: Tensor,
    valid: Tensor,
    context: Tensor,
    mean: Tensor,
    precision: Tensor,
    cost: Tensor | None = None,
) -> Tensor:
    """Return the mean negative log predictive density of a row after a context, a scalar [nat].

    ``features`` [tasks, blocks, Q, D] in units of the noise; the first ``context`` [tasks] blocks
    are given, the rest is predicted: -[log p(x_1..T) - log p(x_1..C)] / (rows predicted). ``cost``
    [tasks, blocks] is the cost of the units for each block.
    """
    tasks, blocks, rows, size = features.shape
    given = (torch.arange(blocks, device=context.device) < context.unsqueeze(-1)).to(valid.dtype)
    every, before = (
        (here.unsqueeze(-1).expand(tasks, blocks, rows)).reshape(tasks, -1)
        for here in (valid, valid * given)
    )
    flat, values = features.reshape(tasks, -1, size), target.reshape(tasks, -1)
    gained = log_marginal(flat, values, every, mean, precision) - log_marginal(
        flat, values, before, mean, precision
    )
    lost = gained.new_zeros(()) if cost is None else (cost * valid * (1.0 - given)).sum()
    return (lost - gained.sum()) / (every.sum() - before.sum()).clamp(min=1.0)


class Orthogonality(Enum):
    """Penalty that keeps the learnt features from replacing those of c and tan phi."""

    PAPER = "the paper's penalty, on features as they are, divided by the number of tasks"
    WHITENED = "squared cosines between nominal and learnt features"
    SPAN = "share of the learnt features that lies in the span of the nominal ones"


def whiten(columns: Tensor, covariance: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """Return columns [..., Q, D] in units of their rows' noise, and the cost in log density [...].

    The rows have the ``covariance`` [..., Q, Q] of the sensors and a learnt variance ``noise`` [Q]
    in addition. The cost is the log of the volume that the latter adds: 0 where nothing is learnt.
    """
    factor = cholesky(covariance + torch.diag(noise))
    cost = 0.5 * (log_determinant(factor) - log_determinant(cholesky(covariance)))
    return torch.linalg.solve_triangular(factor, columns, upper=False), cost


def span_share(nominal: Tensor, learnt: Tensor, valid: Tensor) -> Tensor:
    """Return the share of the learnt features that lies in the span of the nominal ones.

    A scalar in [0, 1]: the share of the squared length of ``learnt`` [tasks, blocks, Q, K], in each
    task by itself, over all its valid blocks. Where it is zero the marginal posterior of
    the nominal parameters is that of the physics alone.
    """
    weight = valid.view(*valid.shape, 1, 1)
    # detached: the span is given, and a task without blocks has no gradient
    basis = torch.linalg.qr((nominal * weight).flatten(1, 2).detach()).Q
    columns = (learnt * weight).flatten(1, 2)
    inside = (basis.transpose(1, 2) @ columns).square().sum(1)
    return (inside / columns.square().sum(1).clamp(min=1e-12)).mean()


def paper_penalty(features: Tensor) -> Tensor:
    """Return SUM_tasks SUM_rows || I - 1/T SUM_t phi phi' ||_F^2 (Banerjee et al. eq. 24).

    ``features`` [tasks, T, rows, D]: c in kPa, learnt features as they leave the net.
    """
    steps, size = features.shape[1], features.shape[-1]
    second = torch.einsum("btri,btrj->brij", features, features) / steps
    return (torch.eye(size, dtype=features.dtype, device=features.device) - second).square().sum()


def shortfall(features: Tensor, target: Tensor, mean: Tensor, precision: Tensor) -> Tensor:
    """Return the mean amount by which posterior means of c [kPa] and tan phi lie below zero.

    A scalar, of the posteriors after every whole task. ``features`` [tasks, T, D] and ``target``
    [tasks, T] are in units of the noise.
    """
    gathered = features.transpose(1, 2) @ features + torch.diag(precision)
    pull = (features.transpose(1, 2) @ target.unsqueeze(-1)) + (precision * mean).unsqueeze(-1)
    estimate = torch.cholesky_solve(pull, cholesky(gathered)).squeeze(-1)
    return torch.relu(-estimate[:, :2]).sum(-1).mean()


def overlap(nominal: Tensor, learnt: Tensor, valid: Tensor) -> Tensor:
    """Return the mean squared cosine between nominal and learnt features, a scalar in [0, 1].

    The cross terms of the paper's orthogonality penalty (eq. 24) after whitening by the rows' noise
    and scaling each feature to unit length: as written in the paper they vanish beside the unscaled
    diagonal.
    """
    shape = (nominal.shape[0], -1)
    weight = valid.view(*valid.shape, 1, 1)
    a = (nominal * weight).reshape(*shape, nominal.shape[-1])
    b = (learnt * weight).reshape(*shape, learnt.shape[-1])
    a = a / a.norm(dim=1, keepdim=True).clamp(min=1e-12)
    b = b / b.norm(dim=1, keepdim=True).clamp(min=1e-12)
    return (a.transpose(1, 2) @ b).square().mean()
