# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Mean and covariance of (c, tan phi) by a sum over a grid, not by a Gaussian at the minimum.

The density is exp(-q / 2), q = m' V(theta)^-1 m + (k - k_0)' Lambda_0 (k - k_0), with V at every
point of the grid (continuous updating: Hansen, Heaton and Yaron 1996). Its curvature leaves out
what noise in the derivatives of m adds to the Gauss-Newton information. The constants and the body
are integrated by Laplace at each point.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from studies.recursion.lift import lift
from studies.recursion.readout import (
    PriorOf,
    ReadOut,
    instruments_at,
    root_of,
    score_variance,
)
from studies.recursion.statistic import Statistic

POINTS, REACH = 25, 5.0
"""Points along each axis, and half the grid's width in deviations of the Gaussian."""
_STEPS = 3


class GridMoments(NamedTuple):
    """Moments of G drives."""

    mean: Tensor  # [G, 2] c [kPa], tan phi
    covariance: Tensor  # [G, 2, 2]
    edge: Tensor  # [G] mass on the edge of the grid


def integrate(statistic: Statistic, estimate: ReadOut, prior: PriorOf) -> GridMoments:
    """Return the moments of the density around the estimates, with the scores J' m at these."""
    axis = torch.linspace(-REACH, REACH, POINTS, dtype=torch.float64)
    unit = torch.cartesian_prod(axis, axis)
    axes = torch.linalg.cholesky(estimate.covariance[:, :2, :2])
    places = estimate.k[:, None, :2] + unit @ axes.transpose(1, 2)
    kept = instruments_at(lift(estimate.k))
    drives = range(places.shape[0])
    log_density = torch.stack(
        [
            _log_density(
                Statistic(*(field[g : g + 1] for field in statistic)),
                torch.cat([places[g], estimate.k[g, 2:].expand(unit.shape[0], -1)], 1),
                kept[g],
                prior,
            )
            for g in drives
        ]
    )
    weight = torch.softmax(log_density, 1)
    mean = (weight.unsqueeze(2) * places).sum(1)
    spread = places - mean.unsqueeze(1)
    covariance = spread.transpose(1, 2) @ (weight.unsqueeze(2) * spread)
    square = weight.view(-1, POINTS, POINTS)
    return GridMoments(mean, covariance, 1.0 - square[:, 1:-1, 1:-1].sum((1, 2)))


def _log_density(statistic: Statistic, k: Tensor, kept: Tensor, prior: PriorOf) -> Tensor:
    """Return the log density [P] of one drive at (c, tan phi) of k [P, SIZE], by Laplace."""
    net = kept @ (statistic.information - statistic.correction)[0]
    score = kept @ statistic.score[0]
    factor = root_of(kept @ score_variance(statistic, k) @ kept.T)
    others = torch.diag(prior.precision[2:])

    def step_of(k: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the Gauss-Newton step of all but (c, tan phi), its root and the surprise."""
        point = lift(k)
        value, slope = score - point.psi @ net.T, net @ point.jacobian[:, :, 2:]
        both = torch.cat([slope, value.unsqueeze(2)], 2)
        white = torch.linalg.solve_triangular(factor, both, upper=False)
        told, surprise = white[..., :-1], white[..., -1:]
        root = torch.linalg.cholesky(told.transpose(1, 2) @ told + others)
        pull = ((prior.mean - k) * prior.precision)[:, 2:].unsqueeze(2)
        step = torch.cholesky_solve(told.transpose(1, 2) @ surprise + pull, root).squeeze(2)
        return step, root, surprise

    for _ in range(_STEPS):
        k = torch.cat([k[:, :2], k[:, 2:] + step_of(k)[0]], 1)
    _, root, surprise = step_of(k)
    distance = (surprise**2).sum((1, 2)) + ((k - prior.mean) ** 2 * prior.precision).sum(1)
    volume = torch.log(torch.diagonal(root, dim1=1, dim2=2)).sum(1)
    return -0.5 * distance - volume
