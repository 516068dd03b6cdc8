# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of velocity rows with the velocity as a state, batched over drives.

The noise of slip and sinkage is propagated. A block of n samples has two rows over
(c [kPa], tan phi, velocity before, velocity after), l counted from 0::

    mean of measured v_1..v_n = v_before + SUM_l (n - l) / n dv_l(c, tan phi)
    0                         = v_before - v_after + SUM_l dv_l(c, tan phi)

No noisy velocity is differenced. The rows' covariance S depends on theta = (c, tan phi, 1).
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from studies.baselines.drives import AffineForces, Vehicle, velocity_features

LINK_VARIANCE = 1e-10
"""[m^2/s^2] Of the velocity carried through a block beside the noise of its inputs."""


@dataclass(frozen=True, slots=True)
class SampleFeatures:
    """Features of single samples, and their change by one deviation of each slip and sinkage."""

    features: Tensor  # [batch, time, 3] columns c [kPa], tan phi, 1 of dv [m/s]
    noise: Tensor  # [batch, time, E, 3]


@dataclass(frozen=True, slots=True)
class VelocityBlock:
    """Two rows of every drive, of covariance SUM_ab theta_a theta_b gram_ab + diag(variance)."""

    linear: Tensor  # [batch, 2, 4]
    offset: Tensor  # [batch, 2]
    gram: Tensor  # [batch, 3, 3, 2, 2]
    target: Tensor  # [batch, 2]
    variance: Tensor  # [2]


def propagate(
    slip: Tensor,
    slip_sd: Tensor,
    sinkage: Tensor,
    sinkage_sd: Tensor,
    constants: Tensor,
    vehicle: Vehicle,
    forces: AffineForces,
) -> SampleFeatures:
    """Return features and their changes by the noise of slip and sinkage [batch, time, axles].

    The changes are central differences over plus and minus one deviation of every wheel.
    """

    def features(slips: Tensor, sinkages: Tensor) -> Tensor:
        return velocity_features(
            slips.unsqueeze(-1), sinkages.unsqueeze(-1), constants.unsqueeze(-2), vehicle, forces
        )

    constants = constants.expand(slip.shape[0], 6).view(-1, 1, 1, 6)
    shallow = torch.minimum(sinkage_sd, 0.9 * sinkage).clamp(min=1e-12)
    by_slip = 0.5 * (features(slip + slip_sd, sinkage) - features(slip - slip_sd, sinkage))
    by_depth = (
        0.5
        * (features(slip, sinkage + shallow) - features(slip, sinkage - shallow))
        * (sinkage_sd / shallow).unsqueeze(-1)
    )
    return SampleFeatures(features(slip, sinkage).sum(-2), torch.cat([by_slip, by_depth], -2))


def make_block(
    inputs: SampleFeatures, first: int, count: int, velocity: Tensor, velocity_sd: Tensor
) -> VelocityBlock:
    """Return the block of ``count`` samples from ``first`` on.

    ``velocity`` [batch, time] is measured at their ends.
    """
    chosen = slice(first, first + count)
    remaining = torch.arange(count, 0, -1, dtype=torch.float64) / count
    weight = torch.stack([remaining, torch.ones_like(remaining)])
    features = weight @ inputs.features[:, chosen]
    noise = torch.einsum("ql,blea->bqlea", weight, inputs.noise[:, chosen]).flatten(2, 3)
    states = torch.tensor([[1.0, 0.0], [1.0, -1.0]], dtype=torch.float64).expand(
        features.shape[0], 2, 2
    )
    measured = velocity[:, chosen].mean(1)
    return VelocityBlock(
        linear=torch.cat([features[..., :2], states], -1),
        offset=features[..., 2],
        gram=torch.einsum("bqsa,bpsc->bacqp", noise, noise),
        target=torch.stack([measured, torch.zeros_like(measured)], -1),
        variance=torch.stack([velocity_sd**2 / count, torch.full_like(velocity_sd, LINK_VARIANCE)]),
    )


def halves(block: VelocityBlock, theta: Tensor) -> Tensor:
    """SUM_b theta_b gram_ab [batch, H, 3, 2, 2] at ``theta`` [batch, H, 2]."""
    homogeneous = torch.cat([theta, torch.ones_like(theta[..., :1])], -1)
    return torch.einsum("bhc,bacqp->bhaqp", homogeneous, block.gram)


def row_covariance(block: VelocityBlock, theta: Tensor, half: Tensor) -> Tensor:
    """S(theta) [batch, H, 2, 2] from its halves."""
    homogeneous = torch.cat([theta, torch.ones_like(theta[..., :1])], -1)
    return torch.einsum("bha,bhaqp->bhqp", homogeneous, half) + torch.diag(block.variance)
