# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sinkages that no sensor measures: the balances tell them, and are spent on it.

A rover has as many balances without its velocity as axles: its load, its moment and that of each
joint. Where a sinkage is missing, those of all axles are what these balances ask for, given slips,
contact angles and (c, tan phi). The other rows h then depend on (c, tan phi) through the sinkages,
too: with b the balances and z the sinkages, dz = -(db/dz)^-1 db, so that to first order

    dh + dh/dz dz = dh - T db,    T = dh/dz (db/dz)^-1.

So T times the balances is taken off every other row, with their features, noise, targets and
columns of mass and centre of mass, and the sinkages drop out. This is the elimination of latent
variables that implicit constraints determine (Britt and Luecke 1973). A balance is then used up: it
says nothing else.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.model.gaussian import cholesky
from terrain_estimator.model.packing import view_of, with_sinkage_and_sd
from terrain_estimator.model.rows import ContactModel, Rows, balances_of, frame_of
from terramechanics.contact.stresses import wheel_forces

SEARCHES = 6
"""Newton steps to the sinkages; from the start they need four to 1e-9."""
SMALL = 1e-3
"""[1] Relative change of a sinkage whose effect is measured, and the stand-in of its deviation."""
SHALLOWEST, DEEPEST = 1e-4, 0.9
"""[wheel radii] Sinkages between which the search stays."""


def lacks_sinkage(packed: Tensor, axles: int) -> Tensor:
    """Return which of observations [n, P] lack the sinkage of an axle, bool [n]."""
    return torch.isnan(view_of(packed, axles).sinkage).any(-1)


def times_inverse(left: Tensor, square: Tensor) -> Tensor:
    """Return left square^-1 of [..., R, K] and [..., K, K]; NaN where that is singular."""
    turned = square.transpose(-1, -2)
    factor = cholesky(square @ turned)
    return torch.cholesky_solve(square @ left.transpose(-1, -2), factor).transpose(-1, -2)


def usual_sinkage(contact: ContactModel) -> Tensor:
    """Return the sinkage [...] [m] of a wheel that rolls under an even share of the weight.

    It is Bekker's for a rigid wheel (Wong 2008, eq. 2.64).
    """
    exponent, cohesive, frictional, _, _, _ = contact.constants.unbind(-1)
    load = 1.0 / (contact.body_scale[1] * contact.geometry.axle_x.shape[0])
    diameter = torch.full_like(load, 2.0 * contact.radius)
    stiffness = (cohesive + contact.width * frictional) * torch.sqrt(diameter)
    return torch.pow(3.0 * load / ((3.0 - exponent) * stiffness), 1.0 / (exponent + 0.5))


def with_balanced_sinkage(
    packed: Tensor,
    contact: ContactModel,
    theta: Tensor,
    searches: int = SEARCHES,
    small: float = SMALL,
    shallowest: float = SHALLOWEST,
    deepest: float = DEEPEST,
) -> Tensor:
    """Return observations [n, P] with the sinkages at which the balances hold where one is missing.

    ``theta`` [3] is (c [kPa], tan phi, 1). Where slip or contact angle is missing, so are these.
    """
    axles = contact.geometry.axle_x.shape[0]
    missing, view = lacks_sinkage(packed, axles).unsqueeze(-1), view_of(packed, axles)
    depth = torch.where(missing, usual_sinkage(contact), view.sinkage)
    start = with_sinkage_and_sd(packed, depth, torch.where(missing, depth, view.sinkage_sd))
    frame = frame_of(start, contact)
    slip = frame.measured.slip
    levers = balances_of(frame.levers.select(2, 0), 2, axles)  # [n, A, K, 3]
    target = balances_of(frame.target, 1, axles)
    low, high = shallowest * contact.radius, deepest * contact.radius
    for _ in range(searches):
        both = torch.stack([depth, (1.0 + small) * depth])
        evaluated = wheel_forces(
            slip, both, contact.constants, contact.radius, contact.width, contact.nodes
        )
        acting = (levers @ ((evaluated * contact.column_unit) @ theta).unsqueeze(-1)).squeeze(-1)
        value, deeper = acting.unbind(0)  # [n, A, K]
        by_depth = ((deeper - value) / small).transpose(1, 2)
        lacking = (target - value.sum(1)).unsqueeze(1)
        step = times_inverse(lacking, by_depth.transpose(1, 2)).squeeze(1)
        depth = (depth * torch.exp(step.clamp(-1.0, 1.0))).clamp(low, high)
    sinkage = torch.where(missing, depth, view.sinkage)
    deviation = torch.where(missing, small * depth, view.sinkage_sd)
    return with_sinkage_and_sd(packed, sinkage, deviation)


def without_sinkage(rows: Rows, missing: Tensor, theta: Tensor) -> Rows:
    """Return ``rows`` without the balances, and so without the sinkages, where one is ``missing``.

    ``missing`` is bool [n]. The rows' sinkages hold the balances at ``theta`` [3], which is
    (c [kPa], tan phi, 1).
    """
    n = missing.shape[0]
    axles = (rows.noise.shape[3] - 1) // 3
    by_depth = rows.noise[0].narrow(2, axles, axles) @ theta
    taken = times_inverse(by_depth, balances_of(by_depth, 1, axles))
    taken = torch.where(missing.view(n, 1, 1), taken, 0.0)

    features = rows.features - taken @ balances_of(rows.features, 2, axles)
    noise = rows.noise - (taken @ balances_of(rows.noise, 2, axles).flatten(3)).view(
        rows.noise.shape
    )
    bent = missing.view(1, n, 1, 1)
    features = torch.where(bent, at_once(features, theta), features)
    noise = torch.where(bent.unsqueeze(-1), at_once(noise, theta), noise)
    slips, depths, angles = noise.split_with_sizes([axles, axles, axles + 1], 3)
    depths = torch.where(missing.view(1, n, 1, 1, 1), 0.0, depths)
    target = rows.target - (taken @ balances_of(rows.target, 1, axles).unsqueeze(-1)).squeeze(-1)
    own = balances_of(rows.variance, 1, axles).unsqueeze(-1)
    variance = rows.variance + (taken**2 @ own).squeeze(-1)
    velocity, load, sensed, moments = rows.used.split_with_sizes([1, 1, axles + 1, axles - 1], 1)
    every = balances_of(rows.used, 1, axles).amin(1, keepdim=True)
    spent = torch.cat([velocity, 0.0 * load, sensed, 0.0 * moments], 1) * every
    used = torch.where(missing.unsqueeze(1), spent, rows.used)
    return Rows(features, torch.cat([slips, depths, angles], 3), target, variance, used, taken)


def at_once(columns: Tensor, theta: Tensor) -> Tensor:
    """Return ``columns`` [C, ..., 3] whose changes by a soil constant do not depend on theta.

    A constant moves the sinkages, and these move every column: only the sum at ``theta`` [3] is a
    derivative, its parts by c and tan phi are not.
    """
    changed = (columns[1:] @ theta).unsqueeze(-1)
    return torch.cat([columns[:1], nn.functional.pad(changed, [2, 0])])
