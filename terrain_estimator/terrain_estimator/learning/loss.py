# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The meta-learning loss of P-ALPaCA and its orthogonality penalty."""

import math

import torch
from torch import Tensor

from terrain_estimator.gaussian import cholesky, log_determinant


def log_marginal(features: Tensor, target: Tensor, weight: Tensor, mean: Tensor, precision: Tensor) -> Tensor:
    """log p(target) of tasks with unit noise under k ~ N(mean, diag(precision)^-1), shape [tasks].

    ``features`` [tasks, n, D], ``target`` [tasks, n], ``weight`` [tasks, n] 1 where the row counts, ``mean`` and
    ``precision`` [D]. For the conjugate recursion (Banerjee et al. eqs. 20 and 21) the sum of the one-step log
    predictives is this log marginal likelihood, so that one Cholesky replaces the recursion.
    """
    features, residual = features * weight.unsqueeze(-1), (target - features @ mean) * weight
    gathered = features.transpose(1, 2) @ features + torch.diag(precision)
    factor = cholesky(gathered)
    pull = (features.transpose(1, 2) @ residual.unsqueeze(-1)).squeeze(-1)
    explained = (pull * torch.cholesky_solve(pull.unsqueeze(-1), factor).squeeze(-1)).sum(-1)
    misfit = residual.square().sum(-1) - explained
    volume = log_determinant(factor) - torch.log(precision).sum()
    return -0.5 * (misfit + volume + weight.sum(-1) * math.log(2.0 * math.pi))


def negative_log_predictive(features: Tensor, target: Tensor, valid: Tensor, context: Tensor, mean: Tensor, precision: Tensor) -> Tensor:
    """Mean negative log predictive density of a row after a context, a scalar [nat].

    ``features`` [tasks, blocks, Q, D]; the first ``context`` [tasks] blocks are given, the rest is predicted:
    -[log p(x_1..T) - log p(x_1..C)] / (rows predicted).
    """
    tasks, blocks, rows, size = features.shape
    every = valid.unsqueeze(-1).expand(tasks, blocks, rows).reshape(tasks, -1)
    given = (torch.arange(blocks) < context.unsqueeze(-1)).to(valid.dtype)
    before = (valid * given).unsqueeze(-1).expand(tasks, blocks, rows).reshape(tasks, -1)
    flat, values = features.reshape(tasks, -1, size), target.reshape(tasks, -1)
    gained = log_marginal(flat, values, every, mean, precision) - log_marginal(flat, values, before, mean, precision)
    return -gained.sum() / (every.sum() - before.sum()).clamp(min=1.0)


def overlap(nominal: Tensor, learnt: Tensor, valid: Tensor) -> Tensor:
    """Squared cosines between nominal and learnt features, averaged over tasks, a scalar in [0, 1].

    The cross terms of the paper's orthogonality penalty (eq. 24) after whitening by the rows' noise and scaling each
    feature to unit length: as written in the paper they vanish beside the unscaled diagonal.
    """
    shape = (nominal.shape[0], -1)
    weight = valid.view(*valid.shape, 1, 1)
    a = (nominal * weight).reshape(*shape, nominal.shape[-1])
    b = (learnt * weight).reshape(*shape, learnt.shape[-1])
    a = a / a.norm(dim=1, keepdim=True).clamp(min=1e-12)
    b = b / b.norm(dim=1, keepdim=True).clamp(min=1e-12)
    return (a.transpose(1, 2) @ b).square().mean()
