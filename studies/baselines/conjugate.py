# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bayesian linear regression with shared parameters, all time steps at once.

    Lambda_t = Phi_t' Sigma_eps^-1 Phi_t + Lambda_(t-1)
    q_t = q_(t-1) + Phi_t' Sigma_eps^-1 (x_t - phi_t)
    kbar_t = Lambda_t^-1 q_t
    x_(t+1) ~ N(Phi kbar_t + phi, Phi Lambda_t^-1 Phi' + Sigma_eps)

(Banerjee et al. eqs. 20 to 23). The sums over time are running sums, so that no loop over time is
needed.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.model.gaussian import cholesky


@dataclass(frozen=True, slots=True)
class RunningPosterior:
    """After 0, 1, ... T rows: one more than there are rows."""

    mean: Tensor  # [batch, T + 1, D]
    factor: Tensor  # [batch, T + 1, D, D] Cholesky factor of the precision


def regress(features: Tensor, target: Tensor, mean: Tensor, precision: Tensor) -> RunningPosterior:
    """Return the posterior after every row.

    ``features`` [batch, T, D] and ``target`` [batch, T] are in units of the noise.
    The prior is k ~ N(``mean`` [D], ``precision`` [D, D]^-1).
    """
    batch, _, size = features.shape
    start = precision.expand(batch, 1, size, size)
    gathered = torch.cat(
        [start, start + (features.unsqueeze(-1) * features.unsqueeze(-2)).cumsum(1)], 1
    )
    pull = (precision @ mean).expand(batch, 1, size)
    pull = torch.cat([pull, pull + (features * target.unsqueeze(-1)).cumsum(1)], 1)
    factor = cholesky(gathered)
    return RunningPosterior(torch.cholesky_solve(pull.unsqueeze(-1), factor).squeeze(-1), factor)


def marginal_deviation(posterior: RunningPosterior, count: int) -> Tensor:
    """Return deviations of the first ``count`` parameters after every row [batch, T + 1, count]."""
    size = posterior.mean.shape[-1]
    directions = torch.eye(size, count, dtype=torch.float64).expand(
        *posterior.mean.shape[:2], size, count
    )
    return (
        torch.linalg.solve_triangular(posterior.factor, directions, upper=False)
        .square()
        .sum(-2)
        .sqrt()
    )


def predict(posterior: RunningPosterior, features: Tensor) -> tuple[Tensor, Tensor]:
    """Return mean and variance [batch, T] of every row given the rows before it.

    ``features`` [batch, T, D]; the variance is without the noise.
    """
    mean = (features * posterior.mean[:, :-1]).sum(-1)
    half = torch.linalg.solve_triangular(
        posterior.factor[:, :-1], features.unsqueeze(-1), upper=False
    )
    return mean, half.square().sum((-2, -1))
