# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training tasks as whitened linear regressions: what the network is trained on.

The nominal features are those of the TRUE slip and sinkage and the noise of the rows, propagated from the sensors, is
added to the target. So the network learns what the physics misses, not the bias that noisy regressors cause, which
the online recursion removes by itself.
"""

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from terrain_estimator.gaussian import cholesky
from terrain_estimator.learning.tasks import Tasks
from terrain_estimator.palpaca import BLOCK, PAlpaca
from terrain_estimator.rows import PA_PER_UNIT, regression_rows


@dataclass(frozen=True, slots=True)
class Regression:
    """Whitened blocks of a batch of tasks: rows velocity, load, torques; Q = A + 2 of them a block."""

    nominal: Tensor  # [tasks, blocks, Q, 2 + M] columns c [kPa], tan phi, uncertain soil constants [prior deviations]
    target: Tensor  # [tasks, blocks, Q] less the constant features
    whitener: Tensor  # [tasks, blocks, Q, Q] inverse Cholesky factor of the rows' noise
    inputs: Tensor  # [tasks, blocks, BLOCK, 8 A + 9] measured observations, inputs of the network
    valid: Tensor  # [tasks, blocks] 1 where every observation of the block is usable


CHUNK = 8
"""Tasks at a time: the rows of an observation take a few kB while they are made."""


def regression(model: PAlpaca, tasks: Tasks, generator: torch.Generator) -> Regression:
    """Average the rows of each second, whiten them with their own noise, and add noise of unit variance."""
    pieces = [_regression(model, chunk, generator) for chunk in tasks.split(CHUNK)]
    return Regression(*(torch.cat([getattr(piece, field.name) for piece in pieces]) for field in fields(Regression)))


def _regression(model: PAlpaca, tasks: Tasks, generator: torch.Generator) -> Regression:
    count, time, size = tasks.true.shape
    blocks, axles = time // BLOCK, model.axles
    packed = tasks.true[:, : blocks * BLOCK].reshape(-1, size)
    rows = regression_rows(packed, packed, model.nominal_contact())
    kept = axles + 2
    theta = tasks.strength / torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
    theta = torch.cat([theta, torch.ones(count, 1, dtype=torch.float64)], 1)
    shape = (count, blocks, BLOCK)
    changes = rows.features[:, :, :kept].reshape(-1, *shape, kept, 3).mean(3)
    features, by_constant = changes[0], torch.einsum("mtbqc,tc->tbqm", changes[1:], theta)
    noise = torch.einsum("tbnqec,tc->tbnqe", rows.noise[0, :, :kept].reshape(*shape, kept, -1, 3), theta) / BLOCK
    noise = noise.transpose(2, 3).flatten(3)  # [tasks, blocks, Q, BLOCK E]
    own = rows.variance[:, :kept].reshape(*shape, kept).sum(2) / BLOCK**2
    target = rows.target[:, :kept].reshape(*shape, kept).mean(2)
    step = packed[:, -2].reshape(shape).sum(2)
    velocity_sd = packed[:, 8 * axles + 1].reshape(shape).mean(2)
    own[..., 0] = 2.0 * (velocity_sd / step) ** 2 / BLOCK  # two means of ten velocities, a block apart
    specific_force = packed[:, 8 * axles + 4].reshape(shape).mean(2)
    target[..., 0] = specific_force  # dv/dt + g sin ab, without noise here
    factor = cholesky(noise @ noise.transpose(2, 3) + torch.diag_embed(own))
    whitener = torch.linalg.solve_triangular(factor, torch.eye(kept, dtype=torch.float64).expand_as(factor), upper=False)
    clean = (whitener @ (target - features[..., 2]).unsqueeze(-1)).squeeze(-1)
    shaken = clean + torch.randn(clean.shape, generator=generator, dtype=torch.float64)
    valid = tasks.usable[:, : blocks * BLOCK].reshape(shape).all(2)
    inputs = tasks.measured[:, : blocks * BLOCK].reshape(*shape, size)
    return Regression(whitener @ torch.cat([features[..., :2], by_constant], -1), shaken, whitener, inputs, valid.to(torch.float64))
