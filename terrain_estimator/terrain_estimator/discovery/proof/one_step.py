# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every row of a held-out second, predicted from the second before it.

The velocity row is the mean velocity of a second, predicted from that of the second before and the
forces in between; the others are those of the estimator. The covariance has the sensors' stated
noise and what is not known of the ground and of sizes.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.equations import Equations
from terrain_estimator.discovery.proof.held_out import GroundEstimate
from terrain_estimator.discovery.proof.scores import Predicted
from terrain_estimator.model.gaussian import cholesky, log_determinant


def one_step(equations: Equations, ground: GroundEstimate, follows: Tensor) -> Predicted:
    """Return the errors of the R rows of B blocks.

    ``equations`` have velocities at zero; ``follows`` [B] as ``Blocks.follows``.
    """
    residual, covariance, present = equations.residual, equations.covariance, equations.present
    own = ground.covariance.shape[0]
    sizes = equations.jacobian.shape[-1] - 5 - ground.unknowns.kappa.shape[0]
    columns = torch.cat(
        [equations.jacobian[..., : own - sizes], equations.jacobian[..., own - sizes + 2 :]], -1
    )
    # Row 0 is the velocity at the start of a block, row 0 less row 1 that at its end: both
    # measured, with an error.
    end = residual[:, 0] - residual[:, 1]
    end_variance = covariance[:, 0, 0] + covariance[:, 1, 1] - 2.0 * covariance[:, 0, 1]
    kept = torch.tensor([0, *range(2, residual.shape[1])])
    error, change, spread, there = (
        residual[:, kept],
        columns[:, kept].clone(),
        covariance[:, kept][:, :, kept].clone(),
        present[:, kept],
    )
    error = error.clone()
    error[1:, 0] -= end[:-1]
    change[1:, 0] -= columns[:-1, 0] - columns[:-1, 1]
    spread[1:, 0, 0] += end_variance[:-1]
    there = torch.cat([follows.to(there.dtype).unsqueeze(1), there[:, 1:]], 1)
    spread = spread + change @ ground.covariance @ change.transpose(1, 2)
    pairs = there.unsqueeze(1) * there.unsqueeze(2)
    spread = spread * pairs + torch.diag_embed(1.0 - there)
    factor = cholesky(spread)
    white = torch.linalg.solve_triangular(
        factor, (error * there).unsqueeze(-1), upper=False
    ).squeeze(-1)
    misfit, count = white.square().sum(1), there.sum(1)
    holds = there > 0.0
    return Predicted(
        error=torch.where(holds, error, math.nan),
        sd=torch.where(holds, spread.diagonal(dim1=1, dim2=2).sqrt(), math.nan),
        misfit=misfit,
        expected=count,
        count=count,
        surprise=0.5 * (misfit + log_determinant(factor) + count * math.log(2.0 * math.pi)),
    )


def names(rows: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Return name and unit of each row."""
    units = {
        "velocity": "m/s",
        "load": "1",
        "acceleration": "m/s^2",
        "lateral_velocity": "m/s^2",
    }
    return tuple(
        (name, "N m" if name.startswith("torque") else units.get(name, "1")) for name in rows
    )
