# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One block of observations as a few rows, and the Gauss-Newton solution of its posterior. Scripted with the model."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.gaussian import cholesky, log_determinant, symmetrize
from terrain_estimator.rows import Rows, row_names


class Posterior(NamedTuple):
    """A bank of H Gaussians over D parameters k.

    k = [c (kPa), tan phi, net weights, soil constants, mass, centre of mass, acceleration bias, velocity]
    """

    mean: Tensor  # [H, D]
    precision: Tensor  # [H, D, D]
    log_weight: Tensor  # [H] not normalised


class BlockRows(NamedTuple):
    """Q = R + 1 rows of a block over D + 1 parameters: those of Posterior, then the velocity at the block's end.

    Row 0 is the mean of the measured velocities, row 1 carries the velocity over the block (its target is zero), the
    others are means of the observations' rows. With G_a [Q, S] the change of the rows for the S = n E sources of noise,
    affine in theta = (c, tan phi, 1), their covariance is SUM_ab theta_a theta_b G_a G_b'. C as in Rows.
    """

    linear: Tensor  # [Q, D + 1]; zero for the soil constants, whose columns depend on theta
    offset: Tensor  # [Q]
    nuisance: Tensor  # [3, Q M] change of the columns of theta for one deviation of each of M soil constants
    expansion: Tensor  # [M] soil constants, in deviations, at which the rows were evaluated
    gram: Tensor  # [3, C 3 Q Q] G_a of each of C with the G_b' of the values, for b, then C, a
    target: Tensor  # [Q]
    variance: Tensor  # [Q] of the target
    present: Tensor  # [Q] 1 where at least one observation holds the row


LINK_VARIANCE = 1e-8
"""[m^2/s^2] Of the velocity carried through a block, beside the noise of its features: (0.1 mm/s)^2."""


FIXED = 5
"""Parameters after the soil constants whose columns do not depend on the observation, in the order of fixed_columns."""


def fixed_columns(axles: int, wheelbase: float) -> Tensor:
    """Columns [R + 1, FIXED] of mass, centre of mass, acceleration bias, velocity before and velocity after the block.

    Mass [1] relative to the rover file's and more, centre of mass [m] ahead of the rover file's: what they change in the
    load and in the moment, with 1 for the cosine of the pitch. In the velocity row a wrong mass changes little.
    """
    names = ("mean_velocity", *row_names(axles))
    columns = torch.zeros(len(names), FIXED, dtype=torch.float64)
    columns[names.index("load"), 0] = -1.0
    columns[names.index("moment"), 1] = -1.0 / wheelbase
    columns[names.index("acceleration"), 2] = 1.0
    columns[names.index("mean_velocity"), 3] = 1.0
    columns[names.index("velocity"), 3], columns[names.index("velocity"), 4] = 1.0, -1.0
    return columns


def row_weights(used: Tensor, step: Tensor) -> Tensor:
    """Weight [n, Q] of each of n observations in the rows of their block, from ``used`` [n, R] and ``step`` [n].

    Both may have leading dimensions.
    """
    n = step.shape[-1]
    remaining = torch.arange(n, 0, -1, dtype=step.dtype) / n
    average = used[..., 1:] / used[..., 1:].sum(-2, keepdim=True).clamp(min=1.0)
    return torch.cat([torch.stack([step * remaining, step], -1), average], -1)


def block_rows(
    rows: Rows, columns: Tensor, step: Tensor, velocity: Tensor, expansion: Tensor, fixed: Tensor, link_variance: float
) -> BlockRows:
    """Average the rows of n observations.

    ``columns`` [n, R, net] are the learnt features; ``step`` [n] [s] the time that an observation covers, 0 where its
    velocity is not linked to the one before; ``velocity`` [n, 2] measured [m/s] and its variance. With
    v_j = v_start + SUM_(l <= j) step_l a_l the mean over j weights a_l by step_l (n - l) / n, l counted from 0.
    """
    n = step.shape[0]
    count = rows.used[:, 1:].sum(0)
    weight = row_weights(rows.used, step)
    doubled = [torch.cat([x[:, :1], x], 1) for x in (rows.target, rows.variance)]
    wide = weight.unsqueeze(-1)
    features = (torch.cat([rows.features[:, :, :1], rows.features], 2) * wide).sum(1)  # [C, Q, 3]
    learnt = (torch.cat([columns[:, :1], columns], 1) * wide).sum(0)
    noise = torch.cat([rows.noise[:, :, :1], rows.noise], 2) * wide.unsqueeze(-1)
    measured = velocity.sum(0) / n
    present = torch.cat([torch.ones_like(count[:2]), (count > 0.0).to(step.dtype)])
    target = (doubled[0] * weight).sum(0)
    variance = (doubled[1] * weight**2).sum(0) + (1.0 - present)
    zero = torch.zeros_like(target[2:])
    sources = noise.permute(0, 4, 2, 1, 3).flatten(3)  # [C, 3, Q, n E]
    q = weight.shape[1]
    gram = (sources.flatten(0, 2) @ sources[0].flatten(0, 1).T).view(-1, 3, q, 3, q).permute(3, 0, 1, 2, 4).flatten(1)
    return BlockRows(
        linear=torch.cat([features[0, :, :2], learnt, torch.zeros_like(features[1:, :, 0]).T, fixed * present.unsqueeze(-1)], 1),
        offset=features[0, :, 2],
        nuisance=features[1:].permute(2, 1, 0).flatten(1),
        expansion=expansion,
        gram=gram,
        target=target + torch.cat([measured[:1], zero[:1], zero]),
        variance=variance + torch.cat([measured[1:] / n, zero[:1] + link_variance, zero]),
        present=present,
    )


class Step(NamedTuple):
    """One Gauss-Newton step of every hypothesis."""

    mean: Tensor  # [H, D + 1] after the step
    precision: Tensor  # [H, D + 1, D + 1]
    factor: Tensor  # its Cholesky factor
    noise: Tensor  # [H] log det of the covariance of the rows
    misfit: Tensor  # [H] (k - k_0)' Lambda_0 (k - k_0) + r' S^-1 r, as the step foresees it
    decrement: Tensor  # [] largest squared length of the step, in standard deviations of the posterior


class Solution(NamedTuple):
    """The posterior after a block, and how well it fits."""

    posterior: Posterior  # over D + 1 parameters
    misfit: Tensor  # [H] at the minimum
    noise: Tensor  # [H] log det of the covariance of the rows there


def row_noise(rows: BlockRows, theta: Tensor) -> tuple[Tensor, Tensor]:
    """Covariance S(theta) [H, Q, Q] of the rows at ``theta`` [H, 3], and its halves G_a G(theta)' [H, C, 3, Q, Q]."""
    q = rows.target.shape[0]
    half = (theta @ rows.gram).view(theta.shape[0], -1, 3, q, q)
    return half, (half[:, 0] * theta.unsqueeze(-1).unsqueeze(-1)).sum(1) + torch.diag(rows.variance)


def nuisance_columns(rows: BlockRows, mean: Tensor, theta: Tensor, fixed: int = FIXED) -> tuple[Tensor, Tensor]:
    """What the soil constants add to the rows, SUM_m (kappa_m - expansion_m) nuisance_m theta.

    Returns its derivatives by theta [H, Q, 2] and by each constant [H, Q, M].
    """
    q, m = rows.target.shape[0], rows.expansion.shape[0]
    first = mean.shape[1] - fixed - m
    away = mean[:, first : first + m] - rows.expansion
    by_theta = (rows.nuisance[:2].reshape(2 * q, m) @ away.T).view(2, q, -1).permute(2, 1, 0)
    return by_theta, (theta @ rows.nuisance).view(-1, q, m)


def gauss_newton(prior: Posterior, mean: Tensor, rows: BlockRows, longest_step: Tensor, fixed: int = FIXED) -> Step:
    """One step from ``mean`` [H, D + 1] towards the minimum of (k - k_0)' Lambda_0 (k - k_0) + r' S(theta)^-1 r.

    ``prior`` has D + 1 parameters, of the last it knows nothing. The sources of noise that explain the residual best
    are e = G(theta)' S^-1 r. The features at the inputs so corrected are Phi + G_a e, and with them the gradient is
    J' S^-1 r exactly, the dependence of S on theta included.
    """
    theta = torch.cat([mean[:, :2], torch.ones_like(mean[:, :1])], 1)
    half, covariance = row_noise(rows, theta)
    factor = cholesky(covariance)
    residual = (rows.target - rows.offset - mean @ rows.linear.T).unsqueeze(-1)
    constants = rows.expansion.shape[0]
    first = mean.shape[1] - fixed - constants
    shift, by_constant = torch.zeros_like(residual), torch.zeros_like(residual[:, :, :0])
    if constants > 0:
        shift, by_constant = nuisance_columns(rows, mean, theta)
        residual = residual - by_constant @ (mean[:, first:-fixed] - rows.expansion).unsqueeze(-1)
    weighted = torch.cholesky_solve(residual, factor)
    moved = (half @ weighted.unsqueeze(1).unsqueeze(1)).squeeze(-1)  # [H, C, 3, Q] G_a e
    shift = shift + moved[:, 0, :2].transpose(1, 2)
    jacobian = rows.linear + nn.functional.pad(shift, [0, mean.shape[1] - 2])
    if constants > 0:
        by_constant = by_constant + (moved[:, 1:] * theta.view(-1, 1, 3, 1)).sum(2).transpose(1, 2)
        jacobian = jacobian + nn.functional.pad(by_constant, [first, fixed])
    transposed = jacobian.transpose(1, 2)
    pull = (prior.mean - mean).unsqueeze(-1)
    restoring = prior.precision @ pull
    precision = symmetrize(prior.precision + transposed @ torch.cholesky_solve(jacobian, factor))
    gradient = restoring + transposed @ weighted
    root = cholesky(precision)
    step = torch.cholesky_solve(gradient, root)
    longest = (step[:, :2, 0].abs() / longest_step).amax(1, keepdim=True)
    gained = (gradient * step).sum(1)
    misfit = ((residual * weighted).sum(1) + (pull * restoring).sum(1) - gained).squeeze(-1)
    after = mean + step.squeeze(-1) / longest.clamp(min=1.0)
    return Step(after, precision, root, log_determinant(factor), misfit, gained.amax())


MOST_STEPS = 8
CONVERGED = 1e-3
"""[1] Squared length of a step, in standard deviations, after which no other is made."""


def solve_block(prior: Posterior, rows: BlockRows, longest_step: Tensor, most: int = MOST_STEPS, converged: float = CONVERGED) -> Solution:
    """Gauss-Newton from the prior mean until every hypothesis moved by less than 3 % of a standard deviation.

    The step after that would be an order of magnitude shorter. None is longer than ``longest_step`` [2] in (c, tan phi).
    """
    start = torch.cat([prior.mean, prior.mean[:, -1:]], 1)
    padded = Posterior(start, nn.functional.pad(prior.precision, [0, 1, 0, 1]), prior.log_weight)
    step = gauss_newton(padded, start, rows, longest_step)
    for _ in range(most - 1):
        if bool(step.decrement < converged):
            break
        step = gauss_newton(padded, step.mean, rows, longest_step)
    before = log_determinant(cholesky(prior.precision))
    volume = log_determinant(step.factor) - torch.log(step.precision[:, -1, -1]) - before
    log_weight = prior.log_weight - 0.5 * (step.misfit + volume)
    return Solution(Posterior(step.mean, step.precision, log_weight), step.misfit, step.noise)
