# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training tasks as linear regressions: what the network is trained on.

The nominal features are those of the TRUE slip and sinkage and the noise of the rows, propagated
from the sensors, is added to the target. So the network learns what the physics misses, not the
bias that noisy regressors cause, which the online recursion removes by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from terrain_estimator.learning.tasks import Tasks
from terrain_estimator.model.gaussian import cholesky
from terrain_estimator.model.packed_observation import BLOCK
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_by_law import PhysicsByLaw
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.rows import (
    PA_PER_UNIT,
    ContactModel,
    Rows,
    frame_of,
    regression_rows,
)


@dataclass(frozen=True, slots=True)
class Regression:
    """Blocks of a batch of tasks, zero where a block is not valid.

    Each has Q = A + 3 + J rows for J joints: velocity, load, torques, moments; M uncertain soil
    constants, in prior deviations.
    """

    nominal: Tensor  # [tasks, blocks, Q, 2 + M] columns c [kPa], tan phi, soil constants
    target: Tensor  # [tasks, blocks, Q] less the constant features
    covariance: Tensor  # [tasks, blocks, Q, Q] of the rows' noise
    inputs: Tensor  # [tasks, blocks, P] mean measured observations, inputs of the network
    valid: Tensor  # [tasks, blocks] 1 where every observation of the block is usable

    @classmethod
    def join(cls, pieces: Sequence["Regression"]) -> "Regression":
        """Return the tasks of all ``pieces``."""
        return cls(
            *(torch.cat([getattr(piece, field.name) for piece in pieces]) for field in fields(cls))
        )

    def of(self, chosen: Tensor) -> "Regression":
        """Return the tasks with the indices ``chosen``."""
        return Regression(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def to(self, device: torch.device) -> "Regression":
        """Return the tasks on a device."""
        return Regression(*(getattr(self, field.name).to(device) for field in fields(self)))


def distinct_rows(axles: int) -> list[int]:
    """Return the places of the rows that the net learns from.

    These are all but the imu's, which is the velocity row once more.
    """
    return [place for place, name in enumerate(row_names(axles)) if name != "acceleration"]


CHUNK = 8
"""Tasks at a time: the rows of an observation take a few kB while they are made."""


def regression(model: PAlpaca, tasks: Tasks, generator: torch.Generator) -> Regression:
    """Average the rows of each second and add noise of their covariance."""
    return Regression.join([_regression(model, chunk, generator) for chunk in tasks.split(CHUNK)])


def _regression(model: PAlpaca, tasks: Tasks, generator: torch.Generator) -> Regression:
    count, time, size = tasks.true.shape
    blocks, axles = time // BLOCK, model.axles
    packed = tasks.true[:, : blocks * BLOCK].reshape(-1, size)
    contact, chosen = nominal_of(model.physics).nominal_contact(), distinct_rows(axles)
    rows, view = _rows(model, packed, contact), view_of(packed, axles)
    kept = len(chosen)
    theta = tasks.strength / torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
    theta = torch.cat([theta, torch.ones(count, 1, dtype=torch.float64)], 1)
    shape = (count, blocks, BLOCK)
    changes = rows.features[:, :, chosen].reshape(-1, *shape, kept, 3).mean(3)
    features, by_constant = changes[0], torch.einsum("mtbqc,tc->tbqm", changes[1:], theta)
    noise = (
        torch.einsum(
            "tbnqec,tc->tbnqe", rows.noise[0, :, chosen].reshape(*shape, kept, -1, 3), theta
        )
        / BLOCK
    )
    noise = noise.transpose(2, 3).flatten(3)  # [tasks, blocks, Q, BLOCK E]
    own = rows.variance[:, chosen].reshape(*shape, kept).sum(2) / BLOCK**2
    target = rows.target[:, chosen].reshape(*shape, kept).mean(2)
    step = view.step.reshape(shape).sum(2)
    velocity_sd = view.velocity_sd.reshape(shape).mean(2)
    # two means of ten velocities, a block apart
    own[..., 0] = 2.0 * (velocity_sd / step) ** 2 / BLOCK
    # the specific force: dv/dt + g sin ab, without noise here
    target[..., 0] = view.acceleration.reshape(shape).mean(2)
    covariance = noise @ noise.transpose(2, 3) + torch.diag_embed(own)
    shaken = (
        cholesky(covariance)
        @ torch.randn(*target.shape, 1, generator=generator, dtype=torch.float64)
    ).squeeze(-1)
    in_range = (rows.used[:, chosen].reshape(*shape, kept) > 0.0).flatten(2).all(2)
    return _only_valid(
        Regression(
            nominal=torch.cat([features[..., :2], by_constant], -1),
            target=target - features[..., 2] + shaken,
            covariance=covariance,
            inputs=tasks.measured[:, : blocks * BLOCK].reshape(*shape, size).mean(2),
            valid=(tasks.usable[:, : blocks * BLOCK].reshape(shape).all(2) & in_range).to(
                torch.float64
            ),
        )
    )


def _rows(model: PAlpaca, packed: Tensor, contact: ContactModel) -> Rows:
    """Return the rows of observations [n, P] by the contact law of the model."""
    physics = model.physics
    if isinstance(physics, PhysicsByLaw):
        return physics.rows_at(frame_of(packed, contact), packed, contact, None)
    return regression_rows(packed, packed, contact)


def _only_valid(data: Regression) -> Regression:
    """Harmless numbers where a block is not valid, so that no NaN enters a gradient."""
    there = data.valid > 0.0
    column, square = there.unsqueeze(-1), there.unsqueeze(-1).unsqueeze(-1)
    unit = torch.eye(data.target.shape[-1], dtype=torch.float64)
    return Regression(
        nominal=torch.where(square, data.nominal, 0.0),
        target=torch.where(column, data.target, 0.0),
        covariance=torch.where(square, data.covariance, unit),
        inputs=torch.where(column, data.inputs, 0.0),
        valid=data.valid,
    )
