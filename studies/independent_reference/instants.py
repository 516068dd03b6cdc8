# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The inputs of every instant integrated, by importance sampling.

The model of an instant: its true inputs are known before only by their sensors, so they are the
measured ones plus Gaussian errors of the stated deviations (a flat prior). The sinkages follow by
the balances. Measured sinkages and torques then weigh the inputs. Samples come from the Gaussian
around the most likely inputs that Gauss and Newton's approximation gives there.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from studies.independent_reference.equations import (
    FRICTION,
    Balances,
    Equations,
    Inputs,
    Seen,
    excess,
)

STEPS = 4
"""Gauss-Newton steps to the most likely inputs."""
LONGEST = 0.7
"""Change of a log sinkage in such a step at most."""
CHORDS = 1
"""Newton steps of a sample's sinkages, by the Jacobian at the most likely inputs."""
SMALL = 1e-5
"""[1], [rad] Step of the derivatives by log sinkage, slip and contact angle."""


class Likely(NamedTuple):
    """The most likely inputs of P worlds and T instants, and the Gaussian around them."""

    error: Tensor  # [P, T, 1, E] in stated deviations
    log_depth: Tensor  # [P, T, 1, W] log of the sinkages [m] that balance there
    deeper: Tensor  # [P, T, 1, W, E] change of these per error
    slope: Tensor  # [P, T, 1, W, W] change of load and moments by log_depth
    root: Tensor  # [P, T, 1, E, E] of the covariance of the errors: root root'


class Instants(NamedTuple):
    """What the instants tell about P worlds."""

    log_evidence: Tensor  # [P, T]
    acceleration: Tensor  # [P, T] [m/s^2] mean, given all that the instant shows but its velocity
    variance: Tensor  # [P, T] of it
    effective: Tensor  # [P, T] share of effective samples
    imbalance: Tensor  # [P] largest excess of load or moments that a sample is left with
    by_sinkage: Tensor  # [P] sum of log |d (load, moments) / d sinkage|, see posterior.py
    log_volume: Tensor  # [P] sum of the log volumes of the inputs' posteriors, in deviations


class _Slopes(NamedTuple):
    """Derivatives at one place, [P, T, 1, ...]."""

    excess: Tensor  # [..., B]
    by_error: Tensor  # [..., B, E] of the excess
    by_depth: Tensor  # [..., B, W] of the excess by log sinkage
    torque: Tensor  # [..., W] [N m]
    torque_by_slip: Tensor  # [..., W] per deviation
    torque_by_depth: Tensor  # [..., W] by log sinkage


def integrate(
    equations: Equations, world: Tensor, seen: Seen, draws: Tensor, *, torque: bool
) -> Instants:
    """Return what each instant of ``seen`` tells about the worlds [P, 4].

    ``draws`` [T, N, E] are standard normal, the same for all worlds, so that these differ by their
    own merit. ``torque``: whether torques are used.
    """
    likely = most_likely(equations, world, seen, torque=torque)
    offset = torch.einsum("ptnij,tnj->ptni", likely.root, draws)
    error = likely.error + offset
    log_depth, forces, found = _balanced(equations, world, seen, likely, offset)
    missed = misfit(seen, log_depth.exp(), forces[..., 2], torque=torque)
    log_volume = likely.root.diagonal(dim1=-2, dim2=-1).log().sum(-1)
    log_weight = log_volume + 0.5 * (draws.square() - error.square()).sum(-1) - 0.5 * missed
    weight = torch.softmax(log_weight, -1)
    mean = (weight * found[..., 0]).sum(-1)
    variance = (weight * (found[..., 0] - mean.unsqueeze(-1)).square()).sum(-1)
    return Instants(
        torch.logsumexp(log_weight, -1) - math.log(draws.shape[1]),
        mean,
        variance,
        1.0 / (draws.shape[1] * weight.square().sum(-1)),
        found[..., 1:].abs().amax((1, 2, 3)),
        (torch.linalg.slogdet(likely.slope)[1] - likely.log_depth.sum(-1)).sum((1, 2)),
        log_volume.sum((1, 2)),
    )


def _balanced(
    equations: Equations, world: Tensor, seen: Seen, likely: Likely, offset: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return log sinkages [P, T, N, W] of samples at which the balances hold; forces and excess.

    ``offset`` [P, T, N, E] is that of the samples' errors from the likely ones.
    """
    inputs = equations.at(seen, likely.error + offset)
    balance = equations.balances(world, seen, inputs)
    log_depth = likely.log_depth + torch.einsum("ptmwe,ptne->ptnw", likely.deeper, offset)
    inverse = torch.linalg.inv(likely.slope)
    for _ in range(CHORDS):
        left = excess(balance, equations.forces(world, inputs.slip, log_depth))[..., 1:]
        log_depth = log_depth - torch.einsum("ptmvw,ptnw->ptnv", inverse, left)
    forces = equations.forces(world, inputs.slip, log_depth)
    return log_depth, forces, excess(balance, forces)


def misfit(seen: Seen, sinkage: Tensor, torque_nm: Tensor, *, torque: bool) -> Tensor:
    """Return the squared misfit [P, T, N] of sinkages [m] and torques [N m], in deviations."""
    missed = ((seen.sinkage.unsqueeze(1) - sinkage) / seen.sinkage_sd.unsqueeze(1)).square().sum(-1)
    if torque:
        left = (seen.torque.unsqueeze(1) - torque_nm) / seen.torque_sd.unsqueeze(1)
        missed = missed + left.square().sum(-1)
    return missed


def most_likely(equations: Equations, world: Tensor, seen: Seen, *, torque: bool) -> Likely:
    """Return the most likely inputs of each instant, by Gauss-Newton with the balances held."""
    shape = (len(world), len(seen.velocity), 1, equations.inputs)
    error = torch.zeros(shape, dtype=torch.float64)
    log_depth = seen.sinkage.clamp(min=1e-4).log().unsqueeze(1).expand(*shape[:-1], -1)
    for _ in range(STEPS - 1):
        error, log_depth, *_ = _step(equations, world, seen, error, log_depth, torque=torque)
    return _step(equations, world, seen, error, log_depth, torque=torque)


def _step(
    equations: Equations,
    world: Tensor,
    seen: Seen,
    error: Tensor,
    log_depth: Tensor,
    *,
    torque: bool,
) -> Likely:
    """Return the inputs one Gauss-Newton step after ``error`` and ``log_depth``."""
    slopes = _slopes(equations, world, seen, error, log_depth)
    slope = slopes.by_depth[..., 1:, :]
    deeper = -torch.linalg.solve(slope, slopes.by_error[..., 1:, :])
    home = -torch.linalg.solve(slope, slopes.excess[..., 1:])
    change, left = _residuals(slopes, seen, log_depth, deeper, home, torque=torque)
    wanted = left.unsqueeze(-1) + change @ error.unsqueeze(-1)
    precision = change.mT @ change + torch.eye(equations.inputs, dtype=torch.float64)
    new = torch.linalg.solve(precision, change.mT @ wanted).squeeze(-1)
    moved = home + (deeper @ (new - error).unsqueeze(-1)).squeeze(-1)
    log_depth = log_depth + moved.clamp(-LONGEST, LONGEST)
    root = torch.linalg.cholesky(torch.linalg.inv(precision))
    return Likely(new, log_depth, deeper, slope, root)


def _residuals(
    slopes: _Slopes, seen: Seen, log_depth: Tensor, deeper: Tensor, home: Tensor, *, torque: bool
) -> tuple[Tensor, Tensor]:
    """Return how sinkages and torques change per error, and what they miss, in deviations.

    The shapes are [P, T, 1, O, E] and [P, T, 1, O]. ``home`` [P, T, 1, W] is the change of the log
    sinkages that closes the balances.
    """
    depth, spread = log_depth.exp(), seen.sinkage_sd.unsqueeze(1)
    change = [(depth / spread).unsqueeze(-1) * deeper]
    left = [(seen.sinkage.unsqueeze(1) - depth * (1.0 + home)) / spread]
    if torque:
        spread = seen.torque_sd.unsqueeze(1)
        axles = depth.shape[-1]
        own = torch.diag_embed(slopes.torque_by_slip)
        own = torch.nn.functional.pad(own, [0, deeper.shape[-1] - axles])
        change.append((own + slopes.torque_by_depth.unsqueeze(-1) * deeper) / spread.unsqueeze(-1))
        found = slopes.torque + slopes.torque_by_depth * home
        left.append((seen.torque.unsqueeze(1) - found) / spread)
    return torch.cat(change, -2), torch.cat(left, -1)


def _slopes(
    equations: Equations, world: Tensor, seen: Seen, error: Tensor, log_depth: Tensor
) -> _Slopes:
    """Return the derivatives at ``error`` [P, T, 1, E] and ``log_depth`` [P, T, 1, W]."""
    inputs = equations.at(seen, error)
    balance = equations.balances(world, seen, inputs)
    slips = (inputs.slip - SMALL, inputs.slip + SMALL)
    depths = (log_depth - SMALL, log_depth + SMALL)
    forces = equations.forces(world, inputs.slip, log_depth)
    low, high = (equations.forces(world, slip, log_depth) for slip in slips)
    by_slip = (high - low) / (2.0 * SMALL) * seen.slip_sd.view(1, -1, 1, log_depth.shape[-1], 1)
    low, high = (equations.forces(world, inputs.slip, depth) for depth in depths)
    by_depth = (high - low) / (2.0 * SMALL)
    each = "...bwf,...wf->...bw"
    columns = [
        torch.einsum(each, balance.matrix, by_slip),
        torch.einsum(each, _turned(equations, world, seen, inputs), forces),
        _by_pitch_and_friction(equations, seen, inputs, balance),
    ]
    return _Slopes(
        excess(balance, forces),
        torch.cat(columns, -1),
        torch.einsum(each, balance.matrix, by_depth),
        forces[..., 2],
        by_slip[..., 2],
        by_depth[..., 2],
    )


def _turned(equations: Equations, world: Tensor, seen: Seen, inputs: Inputs) -> Tensor:
    """Return the change of the balances' matrix by one deviation of each contact angle."""
    low, high = (
        equations.balances(world, seen, inputs._replace(angle=inputs.angle + step)).matrix
        for step in (-SMALL, SMALL)
    )
    return (high - low) / (2.0 * SMALL) * seen.angle_sd.view(1, -1, 1, 1, low.shape[-2], 1)


def _by_pitch_and_friction(
    equations: Equations, seen: Seen, inputs: Inputs, balance: Balances
) -> Tensor:
    """Return the change of the excess [P, T, 1, B, 1 + K] by the pitch and by each friction."""
    low, high = (
        equations.balances(torch.zeros(1, 4, dtype=torch.float64), seen, each).target
        for each in (
            inputs._replace(pitch=inputs.pitch - SMALL),
            inputs._replace(pitch=inputs.pitch + SMALL),
        )
    )
    pitch = -(high - low) / (2.0 * SMALL) * seen.pitch_sd.view(1, -1, 1, 1)
    rows, moments = balance.target.shape[-1], inputs.friction.shape[-1]
    friction = torch.zeros(rows, moments, dtype=torch.float64)
    friction[rows - moments :] = -FRICTION * torch.eye(moments, dtype=torch.float64)
    return torch.cat([pitch.unsqueeze(-1), friction.expand(*pitch.shape, -1)], -1)
