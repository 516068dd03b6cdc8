# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Residuals of a closed block's rows, at the posterior and as innovations, with covariances."""

from typing import NamedTuple

import torch
from torch import Tensor

from studies.foreign.watch import Closed
from terrain_estimator.model.block import BlockRows
from terrain_estimator.model.gaussian import cholesky, symmetrize
from terrain_estimator.model.innovation import linearised, without_carried
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.state import State


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
    rows = without_carried(rows)
    innovation, noise, jacobian = linearised(rows, known, first)
    spread = symmetrize(noise + jacobian @ before["covariance"] @ jacobian.transpose(0, 1))
    # the posterior holds the velocity at the block's end; that at its start follows from the fit
    start = torch.cat([after["expected"][:-1], known[-1:]])
    residual, noise, jacobian = linearised(rows, start, first)
    column = jacobian[:, -1:]
    weighted = torch.cholesky_solve(column, cholesky(noise)).squeeze(1)
    information = (column.squeeze(1) * weighted).sum() + 1.0 / before["covariance"][-1, -1]
    moved = (weighted * residual).sum() / information
    return BlockResiduals(residual - column.squeeze(1) * moved, noise, innovation, spread)


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
