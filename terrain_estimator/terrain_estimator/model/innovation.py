# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How the rows of a block miss what was predicted before it. Scripted with the model.

The row that carries the velocity through the block holds the velocity at its end, which nothing
else knows: it tells nothing about the fit and is left out. What remains is the mean velocity, load,
torques, acceleration and the two moments.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terrain_estimator.model.block import BlockRows, nuisance_columns, row_noise
from terrain_estimator.model.gaussian import cholesky, symmetrize

CARRIED = 1
"""Place of the row that carries the velocity among the rows of a block."""


class Linearised(NamedTuple):
    """R rows of a block at given parameters."""

    residual: Tensor  # [R] measured minus predicted
    noise: Tensor  # [R, R] covariance of the rows' noise there
    jacobian: Tensor  # [R, D]


class Misses(NamedTuple):
    """The innovation of R rows in two forms, each of unit variance where the model is right.

    NaN for a row that was not there.
    """

    # what an error of this row alone shifts most: Baarda 1968, A testing procedure for use in
    # geodetic networks (w-test)
    single: Tensor  # [R]
    white: Tensor  # [R] uncorrelated: of each row, given the rows before it


def without_carried(rows: BlockRows, carried: int = CARRIED) -> BlockRows:
    """Return the rows of a block without the ``carried`` one and the velocity at its end."""
    q, m = rows.target.shape[0], rows.expansion.shape[0]
    kept = torch.cat([torch.arange(carried), torch.arange(carried + 1, q)])
    nuisance = rows.nuisance.view(3, q, m).index_select(1, kept).flatten(1)
    gram = rows.gram.view(3, -1, 3, q, q).index_select(3, kept).index_select(4, kept).flatten(1)
    return BlockRows(
        linear=rows.linear[kept, :-1],
        offset=rows.offset[kept],
        nuisance=nuisance,
        expansion=rows.expansion,
        gram=gram,
        target=rows.target[kept],
        variance=rows.variance[kept],
        present=rows.present[kept],
    )


def linearised(rows: BlockRows, mean: Tensor, first: int) -> Linearised:
    """Return the rows of :func:`without_carried` at ``mean`` [D].

    ``first`` is the place of the first soil constant.
    """
    count = rows.expansion.shape[0]
    theta = torch.cat([mean[:2], torch.ones_like(mean[:1])]).unsqueeze(0)
    shift = mean[first : first + count] - rows.expansion
    _, covariance = row_noise(rows, theta)
    by_theta, by_constant = nuisance_columns(rows, shift.unsqueeze(0), theta)
    # the constants' part is bilinear: counted once in the prediction, in both kinds of columns
    predicted = rows.offset + rows.linear @ mean + by_constant[0] @ shift
    jacobian = torch.cat(
        [
            rows.linear[:, :2] + by_theta[0],
            rows.linear[:, 2:first],
            by_constant[0],
            rows.linear[:, first + count :],
        ],
        1,
    )
    return Linearised(rows.target - predicted, covariance[0], jacobian)


def misses(rows: BlockRows, mean: Tensor, covariance: Tensor, first: int) -> Misses:
    """Return how a block's ``rows`` miss the prediction of ``mean`` [D] and ``covariance`` [D, D].

    ``first`` is the place of the first soil constant. Their covariance is S + J P J', with the
    rows' noise S, the Jacobian J and the covariance P of the parameters.
    """
    own = without_carried(rows)
    residual, noise, jacobian = linearised(own, mean, first)
    factor = cholesky(symmetrize(noise + jacobian @ covariance @ jacobian.transpose(0, 1)))
    weighted = torch.cholesky_solve(residual.unsqueeze(1), factor).squeeze(1)
    single = weighted / torch.cholesky_inverse(factor).diagonal().sqrt()
    white = torch.linalg.solve_triangular(factor, residual.unsqueeze(1), upper=False).squeeze(1)
    missing = torch.full_like(residual, float("nan"))
    there = (own.present > 0.0) & torch.isfinite(single) & torch.isfinite(white)
    return Misses(torch.where(there, single, missing), torch.where(there, white, missing))
