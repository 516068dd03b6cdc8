# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a fit leaves, as a white series: the recursive residuals of a run.

A fit absorbs part of what is missing, and residuals of one fit are correlated over blocks. With the
run's own unknowns spread as their priors have them the rows of a run have the covariance V = S + D
+ J Lambda^-1 J'. In the order of time its Cholesky factor turns them into innovations: each row
less what everything before it says of it (Brown, Durbin and Evans 1975). They are independent and
of unit variance where nothing is missing, and a column g regressed on them gives the score test g'
V^-1 r, in which what the fit can absorb does not count.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.expected import own_columns
from terrain_estimator.discovery.hypotheses.equations import Equations, Unknowns
from terrain_estimator.discovery.hypotheses.point import own_prior
from terrain_estimator.model.gaussian import cholesky


@dataclass(frozen=True, slots=True)
class Whitening:
    """Turns rows of a run [B, Q] into innovations [B, Q]."""

    factor: Tensor  # [B Q, B Q] Cholesky factor of V
    own: Tensor  # [B Q, P] columns of the run's own unknowns
    present: Tensor  # [B, Q] 1 where a row is there

    def of(self, rows: Tensor) -> Tensor:
        """Innovations [B, Q, K] of columns [B, Q, K]; rows that are not there count as zero."""
        blocks, count, columns = rows.shape
        there = (rows * self.present.unsqueeze(-1)).reshape(blocks * count, columns)
        return torch.linalg.solve_triangular(self.factor, there, upper=False).view(
            blocks, count, columns
        )


def whitening(equations: Equations, unknowns: Unknowns) -> Whitening:
    """For the rows at these ``equations``."""
    _, precision = own_prior(unknowns)
    own = own_columns(equations, unknowns).flatten(0, 1)
    noise = equations.covariance + torch.diag_embed(equations.excess * equations.present)
    covariance = torch.block_diag(*noise.unbind()) + (own / precision) @ own.T  # type: ignore[no-untyped-call]
    return Whitening(cholesky(covariance), own, equations.present)


def innovations(white: Whitening, equations: Equations, unknowns: Unknowns) -> Tensor:
    """The residuals of a fit at ``unknowns``, [B, Q], each of unit variance where nothing is missing."""
    mean, _ = own_prior(unknowns)
    before = (white.own @ (unknowns.flat() - mean)).view_as(equations.residual)
    return white.of((equations.residual + before).unsqueeze(-1)).squeeze(-1)
