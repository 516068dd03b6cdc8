# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Residuals of the rows of a closed block, at the posterior and as innovations, with covariances.

The row that carries the velocity through the block holds the velocity at its end, which nothing
else knows: it tells nothing about the fit and is left out. What remains is the mean velocity, load,
torques, acceleration and the two moments.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from studies.foreign.watch import Closed
from terrain_estimator.model.block import BlockRows, nuisance_columns, row_noise
from terrain_estimator.model.gaussian import cholesky, symmetrize
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.rows import row_names
from terrain_estimator.model.state import State

CARRIED = 1
"""Place of the row that carries the velocity among the rows of a block."""


class BlockResiduals(NamedTuple):
    """One closed block; Q rows as in :func:`kinds`."""

    residual: Tensor  # [Q] at the posterior that the estimator kept, SI units of the rows
    noise: Tensor  # [Q, Q] covariance S of the rows there
    innovation: Tensor  # [Q] at the posterior before the block
    spread: Tensor  # [Q, Q] covariance of the innovation: S + J P J'


def kinds(axles: int) -> tuple[str, ...]:
    """Return the names of the rows of :class:`BlockResiduals`, in order."""
    return ("velocity", *row_names(axles)[1:])


def block_residuals(model: PAlpaca, closed: Closed, *, kept: bool) -> BlockResiduals:
    """Return the residuals of a block; ``kept`` where the estimator took it into the posterior."""
    before = closed.before
    state = closed.after if kept else before
    soil = int(state["soils"].argmax())
    with torch.inference_mode():
        learnt = model.learnt(closed.packed)
        rows = model.physics.average(
            closed.packed, learnt, soil, before["expansion"][soil], model.every_row
        ).rows
        return residuals_of(model, rows, before, state)


def residuals_of(model: PAlpaca, rows: BlockRows, before: State, after: State) -> BlockResiduals:
    """Return the residuals of a block's ``rows``; the state ``after`` holds the posterior kept."""
    first, known = model.layout.first_constant, before["expected"]
    rows = _without_carried(rows)
    innovation, noise, jacobian = _linearised(rows, known, first)
    spread = symmetrize(noise + jacobian @ before["covariance"] @ jacobian.transpose(0, 1))
    # the posterior holds the velocity at the block's end; that at its start follows from the fit
    start = torch.cat([after["expected"][:-1], known[-1:]])
    residual, noise, jacobian = _linearised(rows, start, first)
    column = jacobian[:, -1:]
    weighted = torch.cholesky_solve(column, cholesky(noise)).squeeze(1)
    information = (column.squeeze(1) * weighted).sum() + 1.0 / before["covariance"][-1, -1]
    moved = (weighted * residual).sum() / information
    return BlockResiduals(residual - column.squeeze(1) * moved, noise, innovation, spread)


def _without_carried(rows: BlockRows) -> BlockRows:
    """Return the rows of a block without CARRIED and the velocity at its end."""
    q, m = rows.target.shape[0], rows.expansion.shape[0]
    kept = torch.tensor([place for place in range(q) if place != CARRIED])
    nuisance = rows.nuisance.view(3, q, m)[:, kept].flatten(1)
    gram = rows.gram.view(3, -1, 3, q, q)[..., kept, :][..., kept].flatten(1)
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


def _linearised(rows: BlockRows, mean: Tensor, first: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return residual [Q], covariance [Q, Q] and Jacobian [Q, D] of the rows at ``mean`` [D].

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
    return rows.target - predicted, covariance[0], jacobian


def whitened(residual: Tensor, covariance: Tensor) -> Tensor:
    """Return residuals [..., Q] as unit-variance numbers that keep their rows' names.

    They are C^-1/2 D^-1 r with the rows' deviations D and the symmetric root of their correlation C
    (ZCA-cor of Kessy, Lewin and Strimmer 2018): of all whitenings the one whose components
    correlate most with the rows themselves.
    """
    deviation = torch.diagonal(covariance, dim1=-2, dim2=-1).sqrt()
    correlation = covariance / (deviation.unsqueeze(-1) * deviation.unsqueeze(-2))
    values, vectors = torch.linalg.eigh(correlation)
    root = vectors @ (values.clamp(min=1e-12).rsqrt().unsqueeze(-1) * vectors.mT)
    return (root @ (residual / deviation).unsqueeze(-1)).squeeze(-1)
