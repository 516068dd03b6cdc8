# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Cramer-Rao bound of (c, tan phi): what no unbiased estimator can beat on a drive, whatever its method.

The information of all rows of every single observation at the true parameters and true inputs, the noise of slip,
sinkage and angles propagated into the rows, velocity and accelerometer bias unknown, and the prior added.
"""

import torch
from torch import Tensor

from terrain_estimator.block import block_rows, row_noise
from terrain_estimator.gaussian import cholesky, drop, symmetrize
from terrain_estimator.learning.tasks import Tasks
from terrain_estimator.palpaca import PAlpaca
from terrain_estimator.rows import PA_PER_UNIT, Rows, regression_rows


def cramer_rao(model: PAlpaca, tasks: Tasks) -> Tensor:
    """Bound on the covariance of (c [Pa], tan phi) after each whole drive, shape [batch, 2, 2].

    Takes physics, noise and prior from ``model``, not its learnt columns, and the rows from ``tasks.true``.
    """
    batch, time, size = tasks.true.shape
    flat = regression_rows(tasks.true.reshape(-1, size), model.contact())
    series = [x.unflatten(0, (batch, time)) for x in flat]
    unit = torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
    theta = tasks.strength / unit
    precision = torch.diag(torch.cat([(model.prior_sd / unit) ** -2.0, model.other_precision]))  # c, tan phi, bias, velocity
    precision = precision.expand(batch, -1, -1)
    for index in range(time):
        added = torch.vmap(lambda *fields: _information(model, fields))(
            *(x[:, index : index + 1] for x in series), tasks.true[:, index : index + 1], theta
        )
        extended = torch.nn.functional.pad(precision, [0, 1, 0, 1]) + added
        _, precision = drop(torch.zeros_like(extended[..., 0]), extended, 3)
    directions = torch.eye(2, 4, dtype=torch.float64).T.expand(batch, -1, -1)
    covariance = torch.cholesky_solve(directions, cholesky(precision))[:, :2]
    return symmetrize(covariance) * unit * unit.unsqueeze(-1)


def _information(model: PAlpaca, fields: tuple[Tensor, ...]) -> Tensor:
    """J' S^-1 J [5, 5] of one observation at the true ``theta`` [2], the last of ``fields``."""
    *rows, packed, theta = fields
    measured = packed[:, 8 * model.axles :]
    velocity = torch.stack([measured[:, 0], measured[:, 1] ** 2], 1)
    nothing = packed.new_zeros(1, model.axles + 3, 0)
    averaged = block_rows(Rows(*rows), nothing, measured[:, 6] * measured[:, 7], velocity, model.fixed_columns, model.link_variance)
    _, covariance = row_noise(averaged, theta.unsqueeze(0))
    return averaged.linear.T @ torch.linalg.solve(covariance[0], averaged.linear)
