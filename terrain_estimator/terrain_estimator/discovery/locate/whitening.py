# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The recursive residuals of a run: a white series from those of a fit.

A fit absorbs part of what is missing, and residuals of one fit are correlated over blocks. With the
run's own unknowns spread as their priors have them the rows of a run have the covariance V = S + D
+ J Lambda^-1 J'. In the order of time its Cholesky factor turns them into innovations: each row
less its prediction from everything before it (Brown, Durbin and Evans 1975). They are independent,
and of unit variance where nothing is missing, and a column g regressed on them gives the score test
g' V^-1 r, in which what the fit can absorb does not count.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.expected import own_columns
from terrain_estimator.discovery.hypotheses.equations import Equations
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.model.gaussian import cholesky


@dataclass(frozen=True, slots=True)
class Whitening:
    """A map from rows of a run [B, Q] to innovations [B, Q]."""

    factor: Tensor  # [B Q, B Q] Cholesky factor of V
    own: Tensor  # [B Q, P] columns of the run's own unknowns
    present: Tensor  # [B, Q] 1 where a row is there

    def of(self, rows: Tensor) -> Tensor:
        """Return innovations [B, Q, K] of columns [B, Q, K]; absent rows count as zero."""
        blocks, count, columns = rows.shape
        there = (rows * self.present.unsqueeze(-1)).reshape(blocks * count, columns)
        return torch.linalg.solve_triangular(self.factor, there, upper=False).view(
            blocks, count, columns
        )


def whitening(equations: Equations, unknowns: Unknowns) -> Whitening:
    """Return the whitening of the rows at these ``equations``."""
    _, precision = unknowns.prior_moments()
    own = own_columns(equations, unknowns).flatten(0, 1)
    noise = equations.covariance + torch.diag_embed(equations.excess * equations.present)
    blocks: Tensor = torch.block_diag(*noise.unbind())  # type: ignore[no-untyped-call]
    covariance = blocks + (own / precision) @ own.T
    return Whitening(cholesky(covariance), own, equations.present)


def innovations(white: Whitening, equations: Equations, unknowns: Unknowns) -> Tensor:
    """Return the innovations of a fit at ``unknowns``, [B, Q].

    Each has unit variance where nothing is missing.
    """
    mean, _ = unknowns.prior_moments()
    before = (white.own @ (unknowns.flat() - mean)).view_as(equations.residual)
    return white.of((equations.residual + before).unsqueeze(-1)).squeeze(-1)
