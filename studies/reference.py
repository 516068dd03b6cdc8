# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A reference posterior on a grid over (c, tan phi), given the model's rows.

All else is marginalised exactly. For a fixed (c, tan phi) the rows of a block are linear in
velocity, centre of mass and accelerometer bias with a known covariance, so these are Gaussian and a
Kalman recursion is exact. The reference checks the model's Gauss-Newton in (c, tan phi) and its
bank. The rows are the model's, expanded where it expanded them, so an error of that expansion is in
both; soil constants are exact, the soil is one, and there is no net.
``studies.independent_reference`` shares no rows with the model.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from studies.batched import lay_out, run
from terrain_estimator.model.block import FIXED, BlockRows, block_rows, row_noise
from terrain_estimator.model.gaussian import cholesky, drop, log_determinant
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_with_effects import nominal_of

POINTS, REACH = 49, 6.0
"""Points of the grid along each axis, and its half width in deviations of the model's posterior."""


class Reference(NamedTuple):
    """Moments of the grid posterior, and how much of it lies on the grid's edge."""

    mean: Tensor  # [2] c [Pa], tan phi
    covariance: Tensor  # [2, 2]
    edge: float


class _Bank(NamedTuple):
    """Centre of mass, bias and velocity for every grid point."""

    mean: Tensor  # [P, 3]
    precision: Tensor  # [P, 3, 3]
    log_weight: Tensor  # [P]


def grid_posterior(model: PAlpaca, packed: Tensor, end: int, mask: Tensor) -> Reference:
    """Return the posterior of one drive [T, P] of ``end`` observations.

    The ``model`` has exact constants and no net. The grid lies around the model's own posterior,
    along its axes. Each block's rows are those of the model: expanded at its estimate of that time.
    """
    time = packed.shape[0]
    layout = lay_out(model, packed.unsqueeze(0), torch.tensor([end]))
    closed = layout.closed_at[0][layout.closed_at[0] < time]
    trace = run(model, packed.unsqueeze(0), closed, torch.tensor([end]), mask)
    axis = torch.linspace(-REACH, REACH, POINTS, dtype=torch.float64)
    points = (
        trace.mean[0, -1]
        + torch.cartesian_prod(axis, axis) @ torch.linalg.cholesky(trace.covariance[0, -1]).T
    )
    unit, start = model.hypotheses.unit, model.hypotheses.prior_mean.unsqueeze(0)
    theta, before = points / unit, torch.cat([start, trace.mean[0, :-1]]) / unit
    bank = _start(model, points)
    for first, length, place in zip(
        layout.first[0].tolist(), layout.length[0].tolist(), before, strict=False
    ):
        linked = bool(layout.linked[0, first])
        if not linked:
            bank = _unlink(model, bank)
        bank = _close(
            bank, _rows(model, packed[first : first + length], place, mask, linked=linked), theta
        )
    weight = torch.softmax(bank.log_weight, 0)
    centre = weight @ points
    spread = points - centre
    square = weight.view(POINTS, POINTS)
    inside = float(square[1:-1, 1:-1].sum())
    return Reference(centre, spread.T @ (weight.unsqueeze(-1) * spread), 1.0 - inside)


def _start(model: PAlpaca, points: Tensor) -> _Bank:
    """Return the prior of the model: its mixture, not the Gaussian of the same moments."""
    prior = model.hypotheses
    component = (points.unsqueeze(1) - prior.prior_mean - prior.offsets * prior.prior_sd) / (
        prior.offset_spread * prior.prior_sd
    )
    log_prior = torch.logsumexp(prior.offset_log_weight - 0.5 * component.square().sum(-1), 1)
    count, own = points.shape[0], prior.rover_precision
    return _Bank(
        torch.zeros(count, own.shape[0], dtype=torch.float64),
        torch.diag(own).expand(count, -1, -1),
        log_prior,
    )


def _unlink(model: PAlpaca, bank: _Bank) -> _Bank:
    mean, precision = drop(bank.mean, bank.precision, bank.mean.shape[1] - 1)
    opened = nn.functional.pad(precision, [0, 1, 0, 1])
    opened[:, -1, -1] = model.velocity.open_precision
    return _Bank(nn.functional.pad(mean, [0, 1]), opened, bank.log_weight)


def _rows(
    model: PAlpaca, packed: Tensor, place: Tensor, mask: Tensor, *, linked: bool
) -> BlockRows:
    physics = nominal_of(model.physics)
    theta = torch.cat([place, torch.ones_like(place[:1])])
    rows = physics.rows(packed, physics.nominal_contact(), theta, mask)
    rows = rows._replace(used=rows.used * mask)
    view = view_of(packed, model.axles)
    step = view.step * rows.used[:, 0]
    step = step if linked else torch.cat([torch.zeros_like(step[:1]), step[1:]])
    velocity = torch.stack([view.velocity, view.velocity_sd**2], 1)
    return block_rows(
        rows,
        rows.features[0, ..., :0],
        step,
        velocity,
        step[:0],
        physics.fixed_columns,
        physics.link_variance,
    )


def _close(bank: _Bank, rows: BlockRows, theta: Tensor) -> _Bank:
    """Return the exact update at fixed ``theta`` [P, 2].

    Its misfit is r' S(theta)^-1 r without log det S, as in the model.
    """
    _, covariance = row_noise(rows, torch.cat([theta, torch.ones_like(theta[:, :1])], 1))
    factor = cholesky(covariance)
    jacobian = rows.linear[:, -FIXED:].expand(theta.shape[0], -1, -1)
    start = torch.cat([bank.mean, bank.mean[:, -1:]], 1)
    residual = (rows.target - rows.offset - theta @ rows.linear[:, :2].T).unsqueeze(
        -1
    ) - jacobian @ start.unsqueeze(-1)
    weighted = torch.cholesky_solve(residual, factor)
    precision = nn.functional.pad(
        bank.precision, [0, 1, 0, 1]
    ) + jacobian.mT @ torch.cholesky_solve(jacobian, factor)
    root, gradient = cholesky(precision), jacobian.mT @ weighted
    step = torch.cholesky_solve(gradient, root)
    misfit = (residual * weighted).sum((1, 2)) - (gradient * step).sum((1, 2))
    volume = (
        log_determinant(root)
        - torch.log(precision[:, -1, -1])
        - log_determinant(cholesky(bank.precision))
    )
    mean, kept = drop(start + step.squeeze(-1), precision, FIXED - 2)
    return _Bank(mean, kept, bank.log_weight - 0.5 * (misfit + volume))
