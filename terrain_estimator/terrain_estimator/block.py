# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One block of observations as a few rows, and the Gauss-Newton solution of its posterior. Scripted with the model."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.gaussian import cholesky, log_determinant, symmetrize
from terrain_estimator.rows import Rows


class Posterior(NamedTuple):
    """A bank of H Gaussians over D parameters k = [c (kPa), tan phi, net weights, acceleration bias, velocity]."""

    mean: Tensor  # [H, D]
    precision: Tensor  # [H, D, D]
    log_weight: Tensor  # [H] not normalised


class BlockRows(NamedTuple):
    """Q = R + 1 rows of a block over D + 1 parameters: those of Posterior, then the velocity at the block's end.

    Row 0 is the mean of the measured velocities, row 1 carries the velocity over the block (its target is zero), the
    others are means of the observations' rows. S = n E sources of noise.
    """

    linear: Tensor  # [Q, D + 1]
    offset: Tensor  # [Q]
    noise: Tensor  # [Q, S, 3] change for one standard deviation, affine in (c, tan phi)
    target: Tensor  # [Q]
    variance: Tensor  # [Q] of the target
    present: Tensor  # [Q] 1 where at least one observation holds the row


LINK_VARIANCE = 1e-8
"""[m^2/s^2] Of the velocity carried through a block, beside the noise of its features: (0.1 mm/s)^2."""


def fixed_columns(rows: int) -> Tensor:
    """Columns [R + 1, 3] of acceleration bias, velocity before and velocity after the block."""
    columns = torch.zeros(rows + 1, 3, dtype=torch.float64)
    columns[-1, 0], columns[0, 1], columns[1, 1], columns[1, 2] = 1.0, 1.0, 1.0, -1.0
    return columns


def block_rows(rows: Rows, columns: Tensor, step: Tensor, velocity: Tensor, fixed: Tensor, link_variance: float) -> BlockRows:
    """Average the rows of n observations.

    ``columns`` [n, R, net] are the learnt features; ``step`` [n] [s] the time that an observation covers, 0 where its
    velocity is not linked to the one before; ``velocity`` [n, 2] measured [m/s] and its variance. With
    v_j = v_start + SUM_(l <= j) step_l a_l the mean over j weights a_l by step_l (n - l) / n, l counted from 0.
    """
    n = step.shape[0]
    remaining = torch.arange(n, 0, -1, dtype=step.dtype) / n
    count = rows.used[:, 1:].sum(0)
    average = rows.used[:, 1:] / count.clamp(min=1.0)
    weight = torch.cat([torch.stack([step * remaining, step], 1), average], 1)

    doubled = [torch.cat([x[:, :1], x], 1) for x in (rows.target, rows.variance)]
    features = torch.cat([rows.features, columns], 2)
    features = (torch.cat([features[:, :1], features], 1) * weight.unsqueeze(-1)).sum(0)
    noise = torch.cat([rows.noise[:, :1], rows.noise], 1) * weight.unsqueeze(-1).unsqueeze(-1)
    measured = velocity.sum(0) / n
    present = torch.cat([torch.ones_like(count[:2]), (count > 0.0).to(step.dtype)])
    target = (doubled[0] * weight).sum(0)
    variance = (doubled[1] * weight**2).sum(0) + (1.0 - present)
    zero = torch.zeros_like(target[2:])
    return BlockRows(
        linear=torch.cat([features[:, :2], features[:, 3:], fixed * present.unsqueeze(-1)], 1),
        offset=features[:, 2],
        noise=noise.transpose(0, 1).flatten(1, 2),
        target=target + torch.cat([measured[:1], zero[:1] * 0.0, zero]),
        variance=variance + torch.cat([measured[1:] / n, zero[:1] + link_variance, zero]),
        present=present,
    )


class Solution(NamedTuple):
    """The posterior after a block, and how well it fits."""

    posterior: Posterior  # over D + 1 parameters
    misfit: Tensor  # [H] (k - k_0)' Lambda_0 (k - k_0) + r' S^-1 r at the minimum
    longest: Tensor  # [] last step of (c, tan phi), in units of ``longest_step``


def gauss_newton(prior: Posterior, mean: Tensor, rows: BlockRows, longest_step: Tensor) -> Solution:
    """One step from ``mean`` [H, D + 1] towards the minimum of (k - k_0)' Lambda_0 (k - k_0) + r' S(theta)^-1 r.

    The sources of noise that explain the residual best are e = G' S^-1 r. The features at the inputs so corrected are
    Phi + G_a e, and with them the gradient is J' S^-1 r exactly, the dependence of S on theta included.
    """
    linear = rows.linear
    theta = torch.cat([mean[:, :2], torch.ones_like(mean[:, :1])], 1)
    spread = torch.matmul(rows.noise, theta.T).permute(2, 0, 1)  # [H, Q, S]
    factor = cholesky(spread @ spread.transpose(1, 2) + torch.diag(rows.variance))
    residual = (rows.target - rows.offset - mean @ linear.T).unsqueeze(-1)
    weighted = torch.cholesky_solve(residual, factor)
    source = (spread.transpose(1, 2) @ weighted).squeeze(-1)  # [H, S]
    by_theta = rows.noise[:, :, :2].transpose(0, 1).flatten(1)  # [S, Q 2]
    corrected = linear[:, :2] + (source @ by_theta).view(-1, linear.shape[0], 2)
    jacobian = torch.cat([corrected, linear[:, 2:].expand(mean.shape[0], -1, -1)], 2)

    precision_before = nn.functional.pad(prior.precision, [0, 1, 0, 1])
    pull = nn.functional.pad(prior.mean - mean[:, :-1], [0, 1]).unsqueeze(-1)
    restoring = precision_before @ pull
    precision = symmetrize(precision_before + jacobian.transpose(1, 2) @ torch.cholesky_solve(jacobian, factor))
    gradient = restoring + jacobian.transpose(1, 2) @ weighted
    root = cholesky(precision)
    step = torch.cholesky_solve(gradient, root)
    misfit = ((residual * weighted).sum(1) + (pull * restoring).sum(1) - (gradient * step).sum(1)).squeeze(-1)
    volume = log_determinant(root) - torch.log(precision[:, -1, -1]) - log_determinant(cholesky(prior.precision))
    longest = (step[:, :2, 0].abs() / longest_step).amax(1, keepdim=True)
    moved = mean + step.squeeze(-1) / longest.clamp(min=1.0)
    return Solution(Posterior(moved, precision, prior.log_weight - 0.5 * (misfit + volume)), misfit, longest.amax())


def solve_block(prior: Posterior, rows: BlockRows, longest_step: Tensor, most: int = 8) -> Solution:
    """Gauss-Newton from the prior mean until no hypothesis moves by 1e-4 of ``longest_step``, ``most`` steps at most."""
    start = torch.cat([prior.mean, prior.mean[:, -1:]], 1)
    solution = gauss_newton(prior, start, rows, longest_step)
    for _ in range(most - 1):
        if bool(solution.longest < 1e-4):
            break
        solution = gauss_newton(prior, solution.posterior.mean, rows, longest_step)
    return solution
