# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Gaussians in information form, batched over hypotheses; every function can be scripted.

``mean`` [H, D] and ``precision`` [H, D, D] describe H Gaussians. Nothing is ever inverted: Cholesky
throughout.
"""

import torch
from torch import Tensor

from terramechanics.numerics.batching import any_of


def symmetrize(matrix: Tensor) -> Tensor:
    """Return the symmetric part of [..., D, D]."""
    return 0.5 * (matrix + matrix.transpose(-1, -2))


def cholesky(matrix: Tensor) -> Tensor:
    """Return the lower Cholesky factor of [..., D, D].

    Where rounding made a matrix indefinite, 1e-12 to 1e-6 of its diagonal is added.
    A matrix with NaN, or one that stays indefinite, gives NaN: a model never raises for its
    numbers, so callers check their result with ``isfinite``.
    """
    factor, info = torch.linalg.cholesky_ex(matrix)
    if not any_of(info):
        return factor
    failed = info > 0
    jitter = 1e-12
    while any_of(failed) and jitter < 1e-5:
        diagonal = torch.abs(torch.diagonal(matrix, dim1=-2, dim2=-1))
        matrix = matrix + torch.diag_embed(
            torch.where(failed.unsqueeze(-1), jitter * diagonal, torch.zeros_like(diagonal))
        )
        factor, info = torch.linalg.cholesky_ex(matrix)
        failed = info > 0
        jitter *= 100.0
    if any_of(failed):
        return torch.where(
            failed.unsqueeze(-1).unsqueeze(-1), torch.full_like(factor, float("nan")), factor
        )
    return factor


def log_determinant(factor: Tensor) -> Tensor:
    """Return log det of L L' from its Cholesky factor [..., D, D]."""
    return 2.0 * torch.log(torch.diagonal(factor, dim1=-2, dim2=-1)).sum(-1)


def project(mean: Tensor, precision: Tensor, directions: Tensor) -> tuple[Tensor, Tensor]:
    """Return means [H, K] and covariances [H, K, K] of K linear functions ``directions`` [K, D]."""
    columns = directions.T.expand(mean.shape[0], -1, -1)
    covariance = directions @ torch.cholesky_solve(columns, cholesky(precision))
    return mean @ directions.T, symmetrize(covariance)


def mixture(log_weight: Tensor, mean: Tensor, covariance: Tensor) -> tuple[Tensor, Tensor]:
    """Return means [..., K] and covariances [..., K, K] of mixtures.

    Their weights are softmax(log_weight [..., H]).
    """
    weight = torch.softmax(log_weight, -1)
    centre = weight @ mean
    spread = mean - centre.unsqueeze(-2)
    within = (weight @ covariance.flatten(1)).view(weight.shape[:-1] + covariance.shape[1:])
    return centre, within + spread.transpose(-1, -2) @ (weight.unsqueeze(-1) * spread)


def drop(mean: Tensor, precision: Tensor, index: int) -> tuple[Tensor, Tensor]:
    """Marginalise parameter ``index`` out by Schur complement: [H, D - 1] and [H, D - 1, D - 1]."""
    size = mean.shape[-1]
    keep = torch.cat([torch.arange(index), torch.arange(index + 1, size)])
    cross = precision.select(2, index)
    explained = cross.unsqueeze(-1) * cross.unsqueeze(-2) / cross.narrow(1, index, 1).unsqueeze(-1)
    return mean.index_select(1, keep), (precision - explained).index_select(1, keep).index_select(
        2, keep
    )


def random_walk(precision: Tensor, variance: Tensor) -> Tensor:
    """Return the precision [H, D, D] after a random step of the first K parameters.

    Each is of ``variance`` [K], which may be zero.
    (Lambda^-1 + E Q E')^-1 = Lambda - Lambda E (Q^-1 + E' Lambda E)^-1 E' Lambda, written so that Q
    may be singular.
    """
    size = variance.shape[0]
    root = variance.sqrt()
    cross = precision[:, :, :size] * root
    inner = torch.eye(size, dtype=precision.dtype) + cross[:, :size] * root.unsqueeze(-1)
    return symmetrize(
        precision - cross @ torch.cholesky_solve(cross.transpose(1, 2), cholesky(inner))
    )
