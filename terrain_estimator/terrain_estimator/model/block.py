# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One block of observations as a few rows, and the Gauss-Newton solution of its posterior."""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.model.gaussian import cholesky, log_determinant, symmetrize
from terrain_estimator.model.rows import Rows, balances_of


class Posterior(NamedTuple):
    """A bank of H Gaussians over D parameters k.

    k = [c (kPa), tan phi, net weights, soil constants, mass, centre of mass, acceleration bias,
    velocity]
    """

    mean: Tensor  # [H, D]
    precision: Tensor  # [H, D, D]
    log_weight: Tensor  # [H] not normalised


class BlockRows(NamedTuple):
    """Q = R + 1 rows of a block over D + 1 parameters.

    These are the parameters of Posterior, then the velocity at the block's end. Row 0 is the mean
    of the measured velocities, row 1 carries the velocity over the block (its target is zero), the
    others are means of the observations' rows. With G_a [Q, S] the change of the rows for the S = n
    E sources of noise, affine in theta = (c, tan phi, 1), their covariance is SUM_ab theta_a
    theta_b G_a G_b'. C as in Rows.
    """

    linear: Tensor  # [Q, D + 1]; zero for the soil constants, whose columns depend on theta
    offset: Tensor  # [Q]
    nuisance: Tensor  # [3, Q M] change of the columns of theta by one deviation of each constant
    expansion: Tensor  # [M] soil constants, in deviations, at which the rows were evaluated
    gram: Tensor  # [3, C 3 Q Q] G_a of each of C with the G_b' of the values, for b, then C, a
    target: Tensor  # [Q]
    variance: Tensor  # [Q] of the target
    present: Tensor  # [Q] 1 where at least one observation holds the row


LINK_VARIANCE = 1e-8
"""[m^2/s^2] Variance of the velocity carried through a block, beside its features' noise."""


FIXED = 5
"""Number of parameters whose columns do not depend on the observation, see fixed_columns."""


def fixed_columns(rows: tuple[str, ...], wheelbase: float) -> Tensor:
    """Return the columns [R + 1, FIXED] of the parameters that are the rover's own, in its R rows.

    They are mass, centre of mass, acceleration bias, velocity before and after the block. Mass [1]
    relative to the rover file's and more, centre of mass [m] ahead of the rover file's: what they
    change in the load and in the moment, with 1 for the cosine of the pitch. In the velocity row a
    wrong mass changes little.
    """
    names = ("mean_velocity", *rows)
    columns = torch.zeros(len(names), FIXED, dtype=torch.float64)
    columns[names.index("load"), 0] = -1.0
    columns[names.index("moment"), 1] = -1.0 / wheelbase
    columns[names.index("acceleration"), 2] = 1.0
    columns[names.index("mean_velocity"), 3] = 1.0
    columns[names.index("velocity"), 3], columns[names.index("velocity"), 4] = 1.0, -1.0
    return columns


def row_weights(used: Tensor, step: Tensor) -> Tensor:
    """Return the weight [n, Q] of each of n observations in the rows of their block.

    ``used`` [n, R] and ``step`` [n] may have leading dimensions.
    """
    n = step.shape[-1]
    remaining = torch.arange(n, 0, -1, dtype=step.dtype) / n
    average = used[..., 1:] / used[..., 1:].sum(-2, keepdim=True).clamp(min=1.0)
    return torch.cat([torch.stack([step * remaining, step], -1), average], -1)


def block_rows(
    rows: Rows,
    columns: Tensor,
    step: Tensor,
    velocity: Tensor,
    expansion: Tensor,
    fixed: Tensor,
    link_variance: float,
) -> BlockRows:
    """Return the mean of the rows of n observations.

    ``columns`` [n, R, net] are the learnt features; ``step`` [n] [s] the time that an observation
    covers, 0 where its velocity is not linked to the one before; ``velocity`` [n, 2] measured [m/s]
    and its variance. With v_j = v_start + SUM_(l <= j) step_l a_l the mean over j weights a_l by
    step_l (n - l) / n, l counted from 0.
    """
    n = step.shape[0]
    weight = row_weights(rows.used, step)
    wide = weight.unsqueeze(-1)
    features = (velocity_twice(rows.features, 2) * wide).sum(1)  # [C, Q, 3]
    learnt = (velocity_twice(columns, 1) * wide).sum(0)
    noise = velocity_twice(rows.noise, 2) * wide.unsqueeze(-1)
    measured = (velocity.sum(0) / n).unsqueeze(1)
    there = (rows.used.sum(0) > 0.0).to(step.dtype)
    present = torch.cat([torch.ones_like(there[:2]), there[1:]])
    q = weight.shape[1]
    target = (velocity_twice(rows.target, 1) * weight).sum(0) + nn.functional.pad(
        measured[0], [0, q - 1]
    )
    carried = torch.cat([measured[1] / n, torch.full_like(measured[1], link_variance)])
    variance = (velocity_twice(rows.variance, 1) * weight**2).sum(0) + nn.functional.pad(
        carried, [0, q - 2]
    )
    sources = noise.permute(0, 4, 2, 1, 3).flatten(3)  # [C, 3, Q, n E]
    gram = (
        (sources.flatten(0, 2) @ sources[0].flatten(0, 1).T)
        .view(-1, 3, q, 3, q)
        .permute(3, 0, 1, 2, 4)
        .flatten(1)
    )
    own = fixed * present.unsqueeze(-1)
    if rows.taken.shape[2] > 0:
        multiples = (velocity_twice(rows.taken, 1) * wide).sum(0)  # [Q, K]
        own = own - multiples @ balances_of(fixed.narrow(0, 1, q - 1), 0, rows.taken.shape[2])
    constants = torch.zeros(q, expansion.shape[0], dtype=step.dtype)
    by_strength, offset = features[0].split_with_sizes([2, 1], 1)
    return BlockRows(
        linear=torch.cat([by_strength, learnt, constants, own], 1),
        offset=offset.squeeze(1),
        nuisance=features[1:].permute(2, 1, 0).flatten(1),
        expansion=expansion,
        gram=gram,
        target=target,
        variance=variance + (1.0 - present),
        present=present,
    )


def velocity_twice(values: Tensor, dim: int) -> Tensor:
    """Return ``values`` of R rows along ``dim``, the velocity row's twice, as in a block."""
    return torch.cat([values.narrow(dim, 0, 1), values], dim)


class GaussNewtonStep(NamedTuple):
    """One Gauss-Newton step of every hypothesis."""

    mean: Tensor  # [H, D + 1] after the step
    precision: Tensor  # [H, D + 1, D + 1]
    factor: Tensor  # its Cholesky factor
    noise: Tensor  # [H, Q, Q] Cholesky factor of the covariance of the rows
    misfit: Tensor  # [H] (k - k_0)' Lambda_0 (k - k_0) + r' S^-1 r, as the step predicts it
    decrement: Tensor  # [] largest squared length of the step, in posterior deviations


class Solution(NamedTuple):
    """The posterior after a block, and how well it fits."""

    posterior: Posterior  # over D + 1 parameters
    misfit: Tensor  # [H] at the minimum


def row_noise(rows: BlockRows, theta: Tensor) -> tuple[Tensor, Tensor]:
    """Return the halves G_a G(theta)' [H, C, 3, Q, Q] and the rows' covariance S(theta) [H, Q, Q].

    ``theta`` is [H, 3].
    """
    q = rows.target.shape[0]
    half = (theta @ rows.gram).view(theta.shape[0], -1, 3, q, q)
    return half, (half[:, 0] * theta.unsqueeze(-1).unsqueeze(-1)).sum(1) + torch.diag(rows.variance)


def nuisance_columns(rows: BlockRows, shift: Tensor, theta: Tensor) -> tuple[Tensor, Tensor]:
    """Return the derivatives of the soil constants' part of the rows.

    That part is SUM_m shift_m nuisance_m theta. ``shift`` [H, M] is from the expansion. The
    derivatives are by theta [H, Q, 2] and by each constant [H, Q, M].
    """
    q, m = rows.target.shape[0], rows.expansion.shape[0]
    by_theta = (
        (rows.nuisance.narrow(0, 0, 2).reshape(2 * q, m) @ shift.T).view(2, q, -1).permute(2, 1, 0)
    )
    return by_theta, (theta @ rows.nuisance).view(theta.shape[0], q, m)


def gauss_newton(
    prior: Posterior, mean: Tensor, rows: BlockRows, longest_step: Tensor, fixed: int = FIXED
) -> GaussNewtonStep:
    """Return one Gauss-Newton step from ``mean`` [H, D + 1].

    It goes towards the minimum of (k - k_0)' Lambda_0 (k - k_0) + r' S(theta)^-1 r. The ``prior``
    has D + 1 parameters, the last of them unknown. The sources of noise that explain
    the residual best are e = G(theta)' S^-1 r. The features at the inputs so corrected are Phi +
    G_a e, and with them the gradient is J' S^-1 r exactly, the dependence of S on theta included.
    """
    hypotheses, size, constants = mean.shape[0], mean.shape[1], rows.expansion.shape[0]
    others = min(fixed, size - 2 - constants)
    sizes = [2, size - 2 - constants - others, constants, others]
    strength, _, known, _ = mean.split_with_sizes(sizes, 1)
    theta, shift = nn.functional.pad(strength, [0, 1], value=1.0), known - rows.expansion
    half, covariance = row_noise(rows, theta)
    factor = cholesky(covariance)
    by_theta, by_constant = nuisance_columns(rows, shift, theta)
    residual = (rows.target - rows.offset - mean @ rows.linear.T).unsqueeze(
        -1
    ) - by_constant @ shift.unsqueeze(-1)
    weighted = torch.cholesky_solve(residual, factor)
    moved = (half @ weighted.unsqueeze(1).unsqueeze(1)).squeeze(-1)  # [H, C, 3, Q] G_a e
    values, changed = moved.split_with_sizes([1, constants], 1)
    by_theta = by_theta + values.squeeze(1).narrow(1, 0, 2).transpose(1, 2)
    by_constant = by_constant + (changed * theta.view(-1, 1, 3, 1)).sum(2).transpose(1, 2)
    linear, learnt, _, unchanging = rows.linear.expand(hypotheses, -1, -1).split_with_sizes(
        sizes, 2
    )
    jacobian = torch.cat([linear + by_theta, learnt, by_constant, unchanging], 2)
    transposed = jacobian.transpose(1, 2)
    pull = (prior.mean - mean).unsqueeze(-1)
    restoring = prior.precision @ pull
    precision = symmetrize(prior.precision + transposed @ torch.cholesky_solve(jacobian, factor))
    gradient = restoring + transposed @ weighted
    root = cholesky(precision)
    step = torch.cholesky_solve(gradient, root)
    longest = (step.narrow(1, 0, 2).squeeze(-1).abs() / longest_step).amax(1, keepdim=True)
    gained = (gradient * step).sum(1)
    misfit = ((residual * weighted).sum(1) + (pull * restoring).sum(1) - gained).squeeze(-1)
    return GaussNewtonStep(
        mean + step.squeeze(-1) / longest.clamp(min=1.0),
        precision,
        root,
        factor,
        misfit,
        gained.amax(),
    )


MOST_APPARENT = 0.5
"""[1] Largest share of the information about (c, tan phi) after a block that counts as apparent."""


def without_apparent(
    step: GaussNewtonStep, rows: BlockRows, most: float = MOST_APPARENT
) -> GaussNewtonStep:
    """Return the step without the information that noise in the columns of (c, tan phi) mimics.

    Of the noise G_a in a column the residual shows the part G_a G' S^-1 r, by which the columns are
    corrected. The rest adds N_ab = tr S^-1 (G_a G_b' - G_a G' S^-1 G G_b') to J' S^-1 J on
    average, also where the columns are nothing but noise: the second derivative of the sum has it
    with the other sign, Gauss and Newton's approximation leaves it out (Nakamura 1990, corrected
    scores). S is that before the step, so N is indefinite where a step is long. What it takes off
    is bounded there, too: the root of the sum of the squared eigenvalues of C N is at least the
    largest, with C the covariance of (c, tan phi).
    """
    hypotheses, size, q = step.mean.shape[0], step.mean.shape[1], rows.target.shape[0]
    theta = nn.functional.pad(step.mean.narrow(1, 0, 2), [0, 1], value=1.0)
    half = row_noise(rows, theta)[0].select(1, 0).narrow(1, 0, 2)  # [H, 2, Q, Q] G_a G'
    both = (
        rows.gram.view(3, -1, 3, q, q).select(1, 0).narrow(0, 0, 2).narrow(1, 0, 2)
    )  # [2, 2, Q, Q] G_b G_a'
    inverse = torch.cholesky_solve(
        torch.eye(q, dtype=theta.dtype).expand(hypotheses, q, q), step.noise
    ).unsqueeze(1)
    told = inverse @ half @ inverse
    whole = (inverse.unsqueeze(1) * both).sum((-1, -2))
    apparent = symmetrize(whole - (told.unsqueeze(2) * half.unsqueeze(1)).sum((-1, -2)))
    directions = torch.eye(size, 2, dtype=theta.dtype).expand(hypotheses, size, 2)
    covariance = torch.cholesky_solve(directions, step.factor).narrow(1, 0, 2)
    product = covariance @ apparent
    share = torch.maximum(
        (covariance * apparent).sum((-1, -2)),
        (product * product.transpose(1, 2)).sum((-1, -2)).sqrt(),
    )  # at least the largest part of the variance that it takes off in any direction
    apparent = apparent * (most / share.clamp(min=most)).view(-1, 1, 1)
    precision = step.precision - nn.functional.pad(apparent, [0, size - 2, 0, size - 2])
    return GaussNewtonStep(
        step.mean, precision, cholesky(precision), step.noise, step.misfit, step.decrement
    )


KNOWN_LATER = 0.5
"""[1] Share of the variance of a block's last velocity that the blocks after it take away.

What follows tells about it as much as what came before, by symmetry in time.
"""
LONGEST_CORRECTION = 0.25
"""[1] Largest squared length of that correction, in posterior deviations.

Honest blocks need less than 0.02 (40 drives); where no ground fits, it has no meaning.
"""


def without_velocity_bias(
    step: GaussNewtonStep,
    rows: BlockRows,
    later: float = KNOWN_LATER,
    longest: float = LONGEST_CORRECTION,
    fixed: int = FIXED,
) -> GaussNewtonStep:
    """Return the step without the bias of a last velocity that will be known better.

    With u = S^-1 r the score of column a is Phi_a' u + u' G_a G' u. Its second part cancels what
    noise in the column has in common with the residual. ``gauss_newton`` keeps one of these two u
    as it is now. But the blocks that follow move r by -B d, where B are the columns of the
    velocities and d, of variance D, is what they tell about the last one; the first moves with it
    by its regression. On average the score then lacks D v' G_a G' v with v = S^-1 B, in every block
    with the same sign. The squared length of the correction is ``longest`` at most.
    """
    size, q, constants = step.mean.shape[1], rows.target.shape[0], rows.expansion.shape[0]
    others = min(fixed, size - 2 - constants)
    theta = nn.functional.pad(step.mean.narrow(1, 0, 2), [0, 1], value=1.0)
    half = row_noise(rows, theta)[0]  # [H, C, 3, Q, Q] G_a G'
    start, last = step.precision.narrow(1, size - 2, 1), step.precision.narrow(1, size - 1, 1)
    regression = last.narrow(2, size - 2, 1) / start.narrow(2, size - 2, 1)  # [H, 1, 1]
    variance = 1.0 / (last.narrow(2, size - 1, 1) - regression * last.narrow(2, size - 2, 1))
    moved = rows.linear.narrow(1, size - 1, 1) - regression * rows.linear.narrow(1, size - 2, 1)
    weighted = torch.cholesky_solve(moved, step.noise).view(-1, 1, 1, q, 1)
    lacking = later * variance * (weighted * (half @ weighted)).sum((-1, -2))  # [H, C, 3]
    by_theta, by_constant = lacking.split_with_sizes([1, constants], 1)
    score = torch.cat(
        [
            by_theta.squeeze(1).narrow(1, 0, 2),
            torch.zeros_like(step.mean.narrow(1, 0, size - 2 - constants - others)),
            (by_constant * theta.unsqueeze(1)).sum(2),
            torch.zeros_like(step.mean.narrow(1, 0, others)),
        ],
        1,
    )
    correction = torch.cholesky_solve(score.unsqueeze(-1), step.factor).squeeze(-1)
    length = (score * correction).sum(1, keepdim=True)
    mean = step.mean + correction * (longest / length.clamp(min=longest)).sqrt()
    return GaussNewtonStep(
        mean, step.precision, step.factor, step.noise, step.misfit, step.decrement
    )


MOST_STEPS = 8
"""Gauss-Newton steps of a block at most."""
CONVERGED = 1e-3
"""[1] Squared length of a step, in standard deviations, after which no other is made."""


def extended(prior: Posterior) -> Posterior:
    """Return ``prior`` over D parameters with an unknown velocity at the block's end behind them.

    All may have leading dimensions.
    """
    start = torch.cat([prior.mean, prior.mean[..., -1:]], -1)
    return Posterior(start, nn.functional.pad(prior.precision, [0, 1, 0, 1]), prior.log_weight)


def has_converged(step: GaussNewtonStep, converged: float = CONVERGED) -> Tensor:
    """Return whether every hypothesis moved by less than 3 % of a standard deviation, bool [].

    The step after that would be an order of magnitude shorter.
    """
    return step.decrement < converged


def solve_block(
    prior: Posterior, rows: BlockRows, longest_step: Tensor, most: int = MOST_STEPS
) -> Solution:
    """Return the posterior after a block, by Gauss-Newton until every hypothesis has converged.

    It starts from the prior mean. No step is longer than ``longest_step`` [2] in (c, tan phi).
    """
    start = extended(prior)
    step = gauss_newton(start, start.mean, rows, longest_step)
    for _ in range(most - 1):
        if bool(has_converged(step)):
            break
        step = gauss_newton(start, step.mean, rows, longest_step)
    return solution_of(prior, step, rows)


def solution_of(prior: Posterior, last: GaussNewtonStep, rows: BlockRows) -> Solution:
    """Return the posteriors after the ``last`` step from ``prior`` over D parameters.

    Their evidence has no log det S of the rows' covariance. What the inputs' noise moves is
    r = (true misfit) - G(theta) e, of covariance S(theta) on every ground, also a wrong one: so
    r' S^-1 r, with e at its most probable value, compares grounds fairly. log det S would add half
    of log(det S_1 / det S_2) a block in favour of the one on which the same errors move less.
    """
    step = without_velocity_bias(without_apparent(last, rows), rows)
    before = log_determinant(cholesky(prior.precision))
    velocity = step.precision.select(-1, -1).select(-1, -1)
    log_weight = prior.log_weight - 0.5 * (
        step.misfit + log_determinant(step.factor) - torch.log(velocity) - before
    )
    return Solution(Posterior(step.mean, step.precision, log_weight), step.misfit)
