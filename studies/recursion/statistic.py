# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Corrected scores of blocks, accumulated in the lifted parameters, of constant size.

With r(psi) = y - Phi psi the residual of a block, noise N in its columns and a fixed weight W, the
instruments Z = Phi + G_a G' W r(psi_0) are the columns at the inputs that explain the residual
best at a fixed psi_0, as orthogonal distance regression has them. Their noise correlates with that
of r(psi), by

    E[(Z_a - E Z_a)' W r(psi)] = -tr W G_a G(psi)' + tr B_a (R + G(psi_0) G(psi)'),
    B_a = W G_a G(psi_0)' W

which is linear in psi: less that, Z' W r has mean zero at the true psi for any W and psi_0 that the
block's own noise did not move (corrected scores: Nakamura 1990). With Z = Phi alone, B = 0.

The velocity is eliminated by a Kalman filter whose mean is a linear form in psi. Its coefficients
carry noise of past columns, whose covariance K goes through the filter with it.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from studies.recursion.blocks import LiftedRows
from studies.recursion.lift import BODY, FIRST, LIFTED

MOMENTS = FIRST + BODY
"""Scores that are kept: of lifted parameters up to first order in the constants, and of body."""
OPEN_VARIANCE = 100.0
"""[m^2/s^2] Variance of an unknown velocity."""


class Velocity(NamedTuple):
    """The velocity at a block's end, v = target - columns psi, of G drives."""

    target: Tensor  # [G]
    columns: Tensor  # [G, P]
    noise: Tensor  # [G, LIFTED, LIFTED] covariance K of the columns' noise
    variance: Tensor  # [G]


class Statistic(NamedTuple):
    """Sums over blocks: the score at psi is score - (information - correction) psi."""

    score: Tensor  # [G, MOMENTS]
    information: Tensor  # [G, MOMENTS, P] Z' W Phi
    correction: Tensor  # [G, MOMENTS, P]
    # variance of the score: of parts that do not move with (c, tan phi, 1), then by the six
    # products of these
    variance: Tensor  # [G, 7, MOMENTS, MOMENTS]
    squares: Tensor  # [G, MOMENTS, MOMENTS] sum of the outer products of the blocks' scores


class Sources(NamedTuple):
    """The covariance of the noise of one block's rows."""

    noise: Tensor  # [G, Q, E, LIFTED]
    overlap: Tensor  # [G, Q, Q]
    covariance: Tensor  # [G, Q, Q] of the targets
    present: Tensor  # [G, Q]


def empty_statistic(drives: int) -> Statistic:
    """Return the statistic before the first block."""
    size = LIFTED + BODY
    shapes = ((), (size,), (size,), (MOMENTS,))
    score, information, correction, squares = (
        torch.zeros(drives, MOMENTS, *shape, dtype=torch.float64) for shape in shapes
    )
    variance = torch.zeros(drives, 7, MOMENTS, MOMENTS, dtype=torch.float64)
    return Statistic(score, information, correction, variance, squares)


def open_velocity(drives: int) -> Velocity:
    """Return the unknown velocity before the first block."""
    zero = torch.zeros(drives, dtype=torch.float64)
    return Velocity(
        zero,
        zero.new_zeros(drives, LIFTED + BODY),
        zero.new_zeros(drives, LIFTED, LIFTED),
        zero + OPEN_VARIANCE,
    )


def half(noise: Tensor, overlap: Tensor, psi: Tensor) -> Tensor:
    """Return G_a G(psi)' for every lifted column a, [G, LIFTED, Q, Q]."""
    along = noise @ psi[:, None, :LIFTED, None]  # [G, Q, E, 1]
    crossed = noise.permute(0, 3, 1, 2) @ along.squeeze(3).transpose(1, 2).unsqueeze(1)
    return crossed * overlap.unsqueeze(1)


def noise_of(sources: Sources, psi: Tensor) -> Tensor:
    """Return the covariance [G, Q, Q] of the rows at psi [G, P]."""
    along = (sources.noise @ psi[:, None, :LIFTED, None]).squeeze(3)
    return along @ along.transpose(1, 2) * sources.overlap + sources.covariance


class Weights(NamedTuple):
    """The fixed weights of a block: all follow from earlier blocks."""

    rows: Tensor  # [G, Q, Q] W of all rows but the link's, whose row and column are zero
    gain: Tensor  # [G, Q] of the velocity at the block's end, zero for the link's row
    variance: Tensor  # [G] of that velocity


def weights_of(sources: Sources, psi: Tensor, velocity: Velocity, present: Tensor) -> Weights:
    """Return the weights that the noise of ``sources`` at ``psi`` gives to ``present`` rows."""
    spread = noise_of(sources, psi)
    kept = present.clone()
    kept[:, 1] = 0.0
    both = kept.unsqueeze(2) * kept.unsqueeze(1)
    first = torch.zeros_like(kept)
    first[:, 0] = kept[:, 0]
    before = velocity.variance.unsqueeze(1)
    whole = (spread + torch.diag_embed(before * first)) * both + torch.diag_embed(1.0 - kept)
    weight = torch.linalg.inv(whole) * both
    cross = before * first + spread[:, 1] * kept
    gain = (weight @ cross.unsqueeze(2)).squeeze(2)
    after = velocity.variance + spread[:, 1, 1] - (gain * cross).sum(1)
    linked = present[:, 1] > 0.0
    return Weights(
        weight,
        torch.where(linked.unsqueeze(1), gain, 0.0),
        torch.where(linked, after, OPEN_VARIANCE),
    )


def sources_of(rows: LiftedRows) -> Sources:
    """Return the sources of noise of a block."""
    return Sources(rows.noise, rows.overlap, rows.covariance, rows.present)


def masked(rows: LiftedRows, mask: Tensor) -> LiftedRows:
    """Return the rows of which only those in ``mask`` [Q] (1 or 0) hold."""
    return rows._replace(
        columns=rows.columns * mask.unsqueeze(1),
        target=rows.target * mask,
        noise=rows.noise * mask[:, None, None],
        present=rows.present * mask,
    )


def block_score(
    rows: LiftedRows, weights: Weights, velocity: Velocity, psi: Tensor, told: float
) -> Statistic:
    """Return the statistic of one block.

    ``psi`` [G, P] is the estimate before the block. ``told`` is 1 where the instruments are
    corrected by the residual, 0 where they are the columns.
    """
    first = torch.zeros_like(rows.target)
    first[:, 0] = rows.present[:, 0]
    columns = rows.columns - first.unsqueeze(2) * velocity.columns.unsqueeze(1)
    target = rows.target - first * velocity.target.unsqueeze(1)
    weight, kernel = weights.rows, velocity.noise
    lifted = psi[:, :LIFTED]
    crossed = half(rows.noise, rows.overlap, psi)  # G_a G(psi_0)'
    carried = (kernel @ lifted.unsqueeze(2)).squeeze(2)
    corner = first.unsqueeze(2) * first.unsqueeze(1)
    crossed = crossed + carried[..., None, None] * corner.unsqueeze(1)
    residual = (target.unsqueeze(2) - columns @ psi.unsqueeze(2)).squeeze(2)
    weighted = (weight @ residual.unsqueeze(2)).squeeze(2)
    spread = (crossed * lifted[..., None, None]).sum(1)  # G(psi_0) G(psi_0)'
    own_velocity = (velocity.variance - (lifted * carried).sum(1)).clamp(min=0.0)
    own = rows.covariance + own_velocity[:, None, None] * corner
    whole_own = rows.covariance + velocity.variance[:, None, None] * corner
    moved = torch.einsum("gaqp,gp->gaq", crossed[:, :FIRST], weighted)
    instruments = columns.transpose(1, 2)[:, :MOMENTS].clone()  # [G, MOMENTS, Q]
    instruments[:, FIRST:] = columns.transpose(1, 2)[:, LIFTED:]
    instruments[:, :FIRST] += told * moved
    by_weight = instruments @ weight
    known = weight.unsqueeze(1) @ crossed[:, :FIRST] @ weight.unsqueeze(1)  # B_a
    doubled = rows.noise.flatten(1, 2)
    q, sources = rows.noise.shape[1:3]
    left = torch.einsum("gqp,gpea->gqea", weight * rows.overlap, rows.noise[..., :FIRST])
    correction = left.reshape(-1, q * sources, FIRST).transpose(1, 2) @ doubled
    correction = correction + weight[:, 0, 0, None, None] * kernel[:, :FIRST]
    turned = told * known.flatten(2) @ crossed.flatten(2).transpose(1, 2)
    constant = told * (known * own.unsqueeze(1)).sum((2, 3))
    whole = torch.zeros_like(by_weight @ columns)
    whole[:, :FIRST, :LIFTED] = correction - turned
    score = (by_weight @ target.unsqueeze(2)).squeeze(2)
    # the mean of the product is B_a R - (correction - turned) psi
    score[:, :FIRST] -= constant
    information = by_weight @ columns
    at_psi = score - ((information - whole) @ psi.unsqueeze(2)).squeeze(2)
    return Statistic(
        score,
        information,
        whole,
        _variance(rows, weights, by_weight, crossed, spread + own, whole_own, psi, told),
        at_psi.unsqueeze(2) * at_psi.unsqueeze(1),
    )


def _variance(
    rows: LiftedRows,
    weights: Weights,
    by_weight: Tensor,
    crossed: Tensor,
    spread: Tensor,
    own: Tensor,
    psi: Tensor,
    told: float,
) -> Tensor:
    """Return the variance of a block's score [G, 7, MOMENTS, MOMENTS], see Statistic."""
    weight = weights.rows.unsqueeze(1)
    joint = told * crossed[:, :FIRST] @ weight @ spread.unsqueeze(1) - crossed[:, :FIRST]
    joint = weight @ joint
    mutual = joint.flatten(2) @ joint.transpose(2, 3).flatten(2).transpose(1, 2)
    still = by_weight @ own @ by_weight.transpose(1, 2)
    still[:, :FIRST, :FIRST] += mutual
    powers = psi[:, 2:LIFTED:3]  # of the constants: the products with 1
    along = (rows.noise.unflatten(3, (-1, 3)) * powers[:, None, None, :, None]).sum(3)  # type: ignore[no-untyped-call]
    parts = [still]
    for a, b in PRODUCTS:
        gram = along[..., a] @ along[..., b].transpose(1, 2) * rows.overlap
        each = by_weight @ (gram + gram.transpose(1, 2)) @ by_weight.transpose(1, 2)
        parts.append(each if a != b else 0.5 * each)
    return torch.stack(parts, 1)


PRODUCTS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Pairs of (c, tan phi, 1)."""


def velocity_after(rows: LiftedRows, weights: Weights, velocity: Velocity) -> Velocity:
    """Return the velocity at the end of a block."""
    gain, linked = weights.gain, rows.present[:, 1] > 0.0
    mixed = gain.clone()
    mixed[:, 1] = -1.0
    kept = (1.0 - gain[:, 0]).unsqueeze(1)
    target = kept[:, 0] * velocity.target + (mixed * rows.target).sum(1)
    columns = kept * velocity.columns + (mixed.unsqueeze(1) @ rows.columns).squeeze(1)
    scaled = torch.einsum("gq,gp,gqp,gpea->gqea", mixed, mixed, rows.overlap, rows.noise)
    added = scaled.flatten(1, 2).transpose(1, 2) @ rows.noise.flatten(1, 2)
    kernel = kept.unsqueeze(2) ** 2 * velocity.noise + added
    return Velocity(
        torch.where(linked, target, 0.0),
        torch.where(linked.unsqueeze(1), columns, 0.0),
        torch.where(linked[:, None, None], kernel, 0.0),
        weights.variance,
    )


def added(whole: Statistic, block: Statistic) -> Statistic:
    """Return the sums."""
    return Statistic(*(a + b for a, b in zip(whole, block, strict=True)))
