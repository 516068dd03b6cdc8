# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Cramer-Rao bound of (c, tan phi), which no unbiased estimator can beat on a drive.

The information of all rows of every single observation at the true parameters and true inputs, the
noise of slip, sinkage and angles propagated into the rows, velocity and accelerometer bias unknown,
and the prior added. Soil constants that are not known exactly are unknowns with a prior of their
own.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.learning.tasks import Tasks
from terrain_estimator.model.block import block_rows, row_noise
from terrain_estimator.model.gaussian import cholesky, drop, symmetrize
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.rows import (
    PA_PER_UNIT,
    ContactModel,
    Rows,
    features_of,
    frame_of,
    regression_rows,
    values_alone,
)
from terramechanics.contact.stresses import wheel_forces
from terramechanics.terrain.soil import CONSTANTS

CHUNK = 500
"""Observations whose information is computed at once; they stay in the processor's cache."""
_STEP = 1e-4  # [1] relative, of the differences with respect to the soil constants


@dataclass(frozen=True, slots=True)
class Known:
    """The knowledge of an estimator beside the observations."""

    # [S, R] 1 for the rows that each of S estimators may use, 0 for others; None: every row
    rows: Tensor | None = None
    ends: Tensor | None = None  # [batch] observations of a drive that count
    constants: Tensor | None = None  # [batch, 6] true soil constants, those of the model where None
    constants_sd: float = 0.0  # [1] relative standard deviation of what is known of each constant


def cramer_rao(model: PAlpaca, tasks: Tasks) -> Tensor:
    """Return the bound on the covariance of (c [Pa], tan phi) after each drive [batch, 2, 2].

    Takes physics, noise and prior from ``model``, not its learnt columns and with exact soil
    constants, and the rows from ``tasks.true``.
    """
    return cramer_rao_at(model, tasks, torch.tensor([tasks.true.shape[1] - 1]), Known())[0, :, 0]


def cramer_rao_at(model: PAlpaca, tasks: Tasks, times: Tensor, known: Known) -> Tensor:
    """Return the bounds [S, batch, K, 2, 2] after the observations ``times`` with each set of rows.

    ``times`` [K] are counted from 0 and rise.
    """
    batch, time, _ = tasks.true.shape
    sets = (
        torch.ones(1, len(row_names(model.axles)), dtype=torch.float64)
        if known.rows is None
        else known.rows
    )
    information = _information_of_all(model, tasks, known, sets).flatten(0, 1)
    unit = torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
    loose = (
        [torch.full((6,), max(known.constants_sd, 1e-6) ** -2.0, dtype=torch.float64)]
        if known.constants_sd
        else []
    )
    prior = model.hypotheses
    precision = torch.diag(
        torch.cat([(prior.prior_sd / unit) ** -2.0, *loose, prior.rover_precision])
    )
    ends = (torch.full((batch,), time) if known.ends is None else known.ends).repeat(sets.shape[0])
    precision = precision.expand(ends.shape[0], -1, -1)
    size, found = precision.shape[-1], []
    for index in range(int(times[-1]) + 1):
        extended = torch.nn.functional.pad(precision, [0, 1, 0, 1]) + information[:, index]
        _, after = drop(torch.zeros_like(extended[..., 0]), extended, size - 1)
        precision = torch.where((index < ends).view(-1, 1, 1), after, precision)
        if index in times:
            directions = torch.eye(2, size, dtype=torch.float64).T.expand_as(precision[..., :2])
            found.append(torch.cholesky_solve(directions, cholesky(precision))[:, :2])
    covariances = symmetrize(torch.stack(found, 1)) * unit * unit.unsqueeze(-1)
    return covariances.view(sets.shape[0], batch, *covariances.shape[1:])


def _information_of_all(model: PAlpaca, tasks: Tasks, known: Known, sets: Tensor) -> Tensor:
    """Return J' S^-1 J of every observation at the true parameters [S, batch, time, D + 1, D + 1].

    It is by the rows of ``sets`` [S, R].
    """
    batch, time, size = tasks.true.shape
    packed = tasks.true.reshape(-1, size)
    theta = tasks.strength / torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
    theta = theta.repeat_interleave(time, 0)
    contact = values_alone(nominal_of(model.physics).nominal_contact())
    constants = contact.constants.expand(batch, 6) if known.constants is None else known.constants
    constants = constants.repeat_interleave(time, 0).unsqueeze(1)  # [n, 1, 6], for every axle
    pieces = []
    for start in range(0, packed.shape[0], CHUNK):
        here = slice(start, start + CHUNK)
        local = contact._replace(constants=constants[here])
        rows = regression_rows(packed[here], packed[here], local)
        columns = (
            _by_constants(packed[here], local, theta[here])
            if known.constants_sd
            else rows.features[0, ..., :0]
        )
        alike = (
            (rows.features[0], rows.noise[0], rows.target, rows.variance),
            (rows.taken, columns, packed[here], theta[here]),
        )
        each = torch.vmap(lambda *fields: _information(model, fields))
        pieces.append(torch.stack([each(*alike[0], rows.used * mask, *alike[1]) for mask in sets]))
    return torch.cat(pieces, 1).view(sets.shape[0], batch, time, *pieces[0].shape[2:])


def _by_constants(packed: Tensor, contact: ContactModel, theta: Tensor) -> Tensor:
    """Return the change of the rows for a relative change of each soil constant [n, R, 6].

    ``theta`` [n, 2] is the true one.
    """
    frame = frame_of(packed, contact)
    homogeneous = torch.cat([theta, torch.ones_like(theta[:, :1])], 1).view(-1, 1, 3, 1)

    def at(index: int, factor: float) -> Tensor:
        changed = contact.constants.clone()
        changed[..., index] *= factor
        forces = wheel_forces(
            frame.measured.slip,
            frame.measured.sinkage,
            changed,
            contact.radius,
            contact.width,
            contact.nodes,
        )
        return features_of(frame, (forces * contact.column_unit) @ homogeneous).squeeze(-1)

    return torch.stack(
        [(at(k, 1.0 + _STEP) - at(k, 1.0 - _STEP)) / (2.0 * _STEP) for k in range(len(CONSTANTS))],
        -1,
    )


def _information(model: PAlpaca, fields: tuple[Tensor, ...]) -> Tensor:
    """Return J' S^-1 J of one observation.

    ``fields`` are its rows, columns of unknown constants, packed [P] and ``theta`` [2].
    """
    features, noise, *others, columns, packed, theta = fields
    alone = Rows(features[None, None], noise[None, None], *(field.unsqueeze(0) for field in others))
    view, physics = view_of(packed, model.axles), nominal_of(model.physics)
    velocity = torch.stack([view.velocity, view.velocity_sd**2]).unsqueeze(0)
    step = (view.step * view.linked * alone.used[0, 0]).unsqueeze(0)
    nothing = packed.new_zeros(0)
    averaged = block_rows(
        alone,
        columns.unsqueeze(0),
        step,
        velocity,
        nothing,
        physics.fixed_columns,
        physics.link_variance,
    )
    _, covariance = row_noise(averaged, torch.cat([theta, torch.ones_like(theta[:1])]).unsqueeze(0))
    return averaged.linear.T @ torch.linalg.solve(covariance[0], averaged.linear)
