# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Regression with the velocity as a state and propagated noise of the regressors.

A block's posterior minimises (k - k_0)' Lambda_0 (k - k_0) + r' S(theta)^-1 r by Gauss-Newton, with
S at the current theta: orthogonal distance regression (Boggs, Byrd and Schnabel 1987). A bank of
nine posteriors starts from a grid over the prior.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from studies.baselines.blocks import (
    SampleFeatures,
    VelocityBlock,
    halves,
    make_block,
    propagate,
    row_covariance,
)
from studies.baselines.drives import (
    PA_PER_UNIT,
    AffineForces,
    LevelDrives,
    Vehicle,
    closed_form_forces,
)
from studies.baselines.interface import BaselinePrior, Estimates
from terrain_estimator.model.gaussian import cholesky, drop, log_determinant, symmetrize

BLOCK = 10
"""Samples in a block."""
STEPS = 8
"""Gauss-Newton steps a block."""
LONGEST_STEP = (1.0, 0.25)
"""[kPa, 1] of one Gauss-Newton step."""
_PLACE, _WEIGHT = (-1.2, 0.0, 1.2), (0.2, 0.6, 0.2)  # the grid, in deviations of the prior


@dataclass(frozen=True, slots=True)
class GaussianBank:
    """H Gaussians a drive over (c [kPa], tan phi, velocity [m/s])."""

    mean: Tensor  # [batch, H, 3]
    precision: Tensor  # [batch, H, 3, 3]
    log_weight: Tensor  # [batch, H] not normalised


@dataclass(frozen=True, slots=True)
class IntegratedRegression:
    """Bayesian regression on blocks of a second; a scalar Kalman filter of the velocity between."""

    vehicle: Vehicle
    constants: Tensor  # [6] of the soil, as assumed
    prior: BaselinePrior
    forces: AffineForces = closed_form_forces
    name: str = "integrated"

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Run over all drives; the parameters are those of the last complete block."""
        measured = (drives.slip, drives.slip_sd, drives.sinkage, drives.sinkage_sd)
        inputs = propagate(*measured, self.constants, self.vehicle, self.forces)
        bank = start_bank(self.prior, drives.velocity[:, 0], drives.velocity_sd)
        mixed = mix(bank)
        parameters, deviations, predictions, spreads = [], [], [], []
        for first in range(0, drives.slip.shape[1], BLOCK):
            count = min(BLOCK, drives.slip.shape[1] - first)
            before = mixed
            velocity, spread = follow(inputs, first, count, drives, before)
            bank = solve(
                bank, make_block(inputs, first, count, drives.velocity[:, 1:], drives.velocity_sd)
            )
            mixed = mix(bank)
            known = [before] * (count - 1) + [mixed]
            parameters += [mean[:, :2] for mean, _ in known]
            deviations += [
                covariance.diagonal(dim1=1, dim2=2)[:, :2].sqrt() for _, covariance in known
            ]
            predictions.append(velocity)
            spreads.append(spread)
        unit = torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
        return Estimates(
            torch.stack(parameters, 1) * unit,
            torch.stack(deviations, 1) * unit,
            torch.cat(predictions, 1),
            torch.cat(spreads, 1),
        )


def start_bank(prior: BaselinePrior, velocity: Tensor, velocity_sd: Tensor) -> GaussianBank:
    """Return a grid over the prior, of its mean and variance; ``velocity`` [batch] is measured."""
    place, weight = (
        torch.tensor(_PLACE, dtype=torch.float64),
        torch.tensor(_WEIGHT, dtype=torch.float64),
    )
    offsets, log_weight = (
        torch.cartesian_prod(place, place),
        torch.cartesian_prod(weight, weight).log().sum(1),
    )
    left = 1.0 - (weight * place**2).sum()
    theta = prior.mean() + offsets * prior.precision() ** -0.5
    batch, count = velocity.shape[0], theta.shape[0]
    mean = torch.cat(
        [theta.expand(batch, count, 2), velocity.view(-1, 1, 1).expand(batch, count, 1)], -1
    )
    precision = torch.diag(torch.cat([prior.precision() / left, velocity_sd.view(1) ** -2.0]))
    return GaussianBank(mean, precision.expand(batch, count, 3, 3), log_weight.expand(batch, count))


def solve(bank: GaussianBank, block: VelocityBlock) -> GaussianBank:
    """Return the posteriors after a block, over the velocity at its end."""
    start = torch.cat([bank.mean, bank.mean[..., -1:]], -1)
    prior = nn.functional.pad(bank.precision, [0, 1, 0, 1])
    mean, longest = start, torch.tensor(LONGEST_STEP, dtype=torch.float64)
    for _ in range(STEPS - 1):
        mean = mean + _limited(_gauss_newton(start, prior, mean, block)[0], longest)
    step, precision, misfit = _gauss_newton(start, prior, mean, block)
    mean = mean + _limited(step, longest)
    gained = (
        log_determinant(cholesky(precision))
        - precision[..., -1, -1].log()
        - log_determinant(cholesky(bank.precision))
    )
    flat, rest = drop(mean.flatten(0, 1), precision.flatten(0, 1), 2)
    return GaussianBank(
        flat.view_as(bank.mean),
        rest.view_as(bank.precision),
        bank.log_weight - 0.5 * (misfit + gained),
    )


def _limited(step: Tensor, longest: Tensor) -> Tensor:
    """Shorten a step [batch, H, 4] until c and tan phi move by at most ``longest`` [2]."""
    return step / (step[..., :2].abs() / longest).amax(-1, keepdim=True).clamp(min=1.0)


def _gauss_newton(
    start: Tensor, prior: Tensor, mean: Tensor, block: VelocityBlock
) -> tuple[Tensor, Tensor, Tensor]:
    """Return step [batch, H, 4], precision there, and the step's predicted misfit [batch, H]."""
    half = halves(block, mean[..., :2])
    factor = cholesky(row_covariance(block, mean[..., :2], half))
    residual = (block.target - block.offset).unsqueeze(1) - torch.einsum(
        "bqd,bhd->bhq", block.linear, mean
    )
    weighted = torch.cholesky_solve(residual.unsqueeze(-1), factor)
    # The inputs that explain the residual best are shifted by e = G' S^-1 r: so shifted, the
    # features are Phi + G_a e.
    shift = (half[:, :, :2].transpose(-1, -2) @ weighted.unsqueeze(2)).squeeze(-1).transpose(-1, -2)
    jacobian = block.linear.unsqueeze(1) + nn.functional.pad(shift, [0, 2])
    transposed = jacobian.transpose(-1, -2)
    pull = (start - mean).unsqueeze(-1)
    precision = symmetrize(prior + transposed @ torch.cholesky_solve(jacobian, factor))
    gradient = prior @ pull + transposed @ weighted
    step = torch.cholesky_solve(gradient, cholesky(precision))
    misfit = (
        (residual.unsqueeze(-1) * weighted).sum((-2, -1))
        + (pull * (prior @ pull)).sum((-2, -1))
        - (gradient * step).sum((-2, -1))
    )
    return step.squeeze(-1), precision, misfit


def mix(bank: GaussianBank) -> tuple[Tensor, Tensor]:
    """Return mean [batch, 3] and covariance [batch, 3, 3] of the mixture."""
    weight = torch.softmax(bank.log_weight, -1)
    mean = torch.einsum("bh,bhd->bd", weight, bank.mean)
    directions = torch.eye(3, dtype=torch.float64).expand_as(bank.precision)
    spread = bank.mean - mean.unsqueeze(1)
    covariance = torch.cholesky_solve(directions, cholesky(bank.precision)) + spread.unsqueeze(
        -1
    ) * spread.unsqueeze(-2)
    return mean, symmetrize(torch.einsum("bh,bhde->bde", weight, covariance))


def follow(
    inputs: SampleFeatures,
    first: int,
    count: int,
    drives: LevelDrives,
    known: tuple[Tensor, Tensor],
) -> tuple[Tensor, Tensor]:
    """Return predicted velocity and its deviation of every sample of a block [batch, count].

    The deviation includes the noise of the measurement.
    """
    expected, covariance = known
    theta = torch.cat([expected[:, :2], torch.ones_like(expected[:, :1])], -1)
    mean, variance = expected[:, 2], covariance[:, 2, 2]
    noise = drives.velocity_sd**2
    means, deviations = [], []
    for index in range(first, first + count):
        features = inputs.features[:, index]
        mean = mean + (features * theta).sum(-1)
        uncertain = torch.einsum(
            "bi,bij,bj->b", features[:, :2], covariance[:, :2, :2], features[:, :2]
        )
        shaken = torch.einsum("bea,ba->be", inputs.noise[:, index], theta).square().sum(-1)
        variance = variance + uncertain + shaken
        means.append(mean)
        deviations.append((variance + noise).sqrt())
        gain = variance / (variance + noise)
        mean = mean + gain * (drives.velocity[:, index + 1] - mean)
        variance = gain * noise
    return torch.stack(means, 1), torch.stack(deviations, 1)


def cramer_rao(
    drives: LevelDrives, vehicle: Vehicle, prior: BaselinePrior, forces: AffineForces
) -> Tensor:
    """Return the bound on the deviations of (c [Pa], tan phi) after every drive, [batch, 2].

    It is that of velocity, slip and sinkage alone: rows of single samples at the true inputs,
    constants and parameters. The prior counts as a measurement.
    """
    true = (drives.true_slip, drives.slip_sd, drives.true_sinkage, drives.sinkage_sd)
    inputs = propagate(*true, drives.true_constants, vehicle, forces)
    batch, time = drives.true_slip.shape[:2]
    theta = (drives.strength / torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)).unsqueeze(1)
    precision = torch.diag(
        torch.cat([prior.precision(), drives.velocity_sd.view(1) ** -2.0])
    ).expand(batch, 3, 3)
    for index in range(time):
        block = make_block(inputs, index, 1, drives.true_velocity[:, 1:], drives.velocity_sd)
        covariance = row_covariance(block, theta, halves(block, theta))[:, 0]
        added = block.linear.transpose(1, 2) @ torch.linalg.solve(covariance, block.linear)
        _, precision = drop(
            torch.zeros(batch, 4, dtype=torch.float64),
            nn.functional.pad(precision, [0, 1, 0, 1]) + added,
            2,
        )
    directions = torch.eye(3, 2, dtype=torch.float64).expand(batch, 3, 2)
    covariance = torch.cholesky_solve(directions, cholesky(precision))[:, :2]
    return covariance.diagonal(dim1=1, dim2=2).sqrt() * torch.tensor(
        [PA_PER_UNIT, 1.0], dtype=torch.float64
    )
