# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The normal equations of one run: orthogonal distance regression on blocks of one second.

Unknowns of a run: c [kPa], tan phi, M soil constants [prior deviations], accelerometer bias, one
velocity at each joint of blocks. Shared by all runs: sizes of effects [units], weights of
discrepancy columns. The objective is

    SUM over blocks of r' (S + D)^-1 r + log det (S + D) - log det S
    + SUM over unknowns of ((x - mean) / sd)^2,   S = G G' + R

with S moving with every unknown. D is diagonal, one excess variance for each row of a run: what the
hypothesis leaves unexplained beyond the sensors' noise, at its most likely value (0 where nothing
is left). So a hypothesis that cannot be right does not fight over residuals of a thousand
deviations, and correlated noise counts as noise. log det S itself is left out on purpose: the load
and moment rows are constraints on inputs and have no scale of their own, so that an effect which
only rescales them (payload) would otherwise gain hundreds of nats by it.
"""

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.doubted_rows import DoubtedRows
from terrain_estimator.discovery.hypotheses.rows import (
    Changes,
    Expansion,
    HypothesisRows,
    LinearizationPoint,
)
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.hypotheses.wheel_rows import WheelChanges, WheelRows
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.block import LINK_VARIANCE, row_weights
from terrain_estimator.model.gaussian import cholesky, log_determinant
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.rows import Rows


@dataclass(frozen=True, slots=True)
class Query:
    """The point and the columns for which the equations of a run are wanted."""

    unknowns: Unknowns
    sizes: tuple[float, ...]  # values of the hypothesis' effects
    weights: Tensor  # [F] of the discrepancy's columns
    columns: Tensor  # [B, Q, F] of a flexible discrepancy
    steps: tuple[float, ...]  # of the differences by each size
    known: Tensor | None  # [B, Q, M] columns of the soil constants where they need not be computed
    around: Expansion | None = None  # of the rows; None: where they agree best


@dataclass(frozen=True, slots=True)
class Averages:
    """Weights of observations in the rows of their block."""

    weight: Tensor  # [B, n, Q]
    measured: Tensor  # [B, 2] mean velocity and its variance

    def of(self, values: Tensor) -> Tensor:
        """Return rows [..., B, n, R] of observations as rows of blocks [..., B, Q]."""
        return (torch.cat([values[..., :1], values], -1) * self.weight).sum(-2)


@dataclass(frozen=True, slots=True)
class Equations:
    """One run's quadratic model around a point; the shared unknowns come last."""

    hessian: Tensor  # [P + K, P + K] J' (S + D)^-1 J, without priors
    gradient: Tensor  # [P + K] J' (S + D)^-1 r, without priors
    misfit: float  # SUM r' (S + D)^-1 r + log det (S + D) - log det S
    by_constant: Tensor  # [B, Q, M] columns of the soil constants
    residual: Tensor  # [B, Q] r
    factor: Tensor  # [B, Q, Q] Cholesky factor of S + D
    covariance: Tensor  # [B, Q, Q] S
    present: Tensor  # [B, Q] 1 where a row is there
    ends: Tensor  # [B, 2] numbers of the velocities before and after
    excess: Tensor  # [Q] diagonal of D
    jacobian: (
        Tensor  # [B, Q, 2 + M + 3 + K] of theta, constants, bias, velocity before and after, shared
    )
    degrees: int  # rows that are present
    around: Expansion  # of the rows
    average: Averages
    error: Tensor  # [B n, E] most likely error of each source of noise
    corrected: Tensor  # [B, n, R] rows less targets at the most likely inputs


def _block_shape(values: Tensor, blocks: int, lead: int) -> Tensor:
    """Return [..., B n, ...] as [..., B, n, ...], with ``lead`` dimensions before."""
    return values.reshape(
        *values.shape[:lead], blocks, values.shape[lead] // blocks, *values.shape[lead + 1 :]
    )


def averages(blocks: Blocks, used: Tensor) -> Averages:
    """Return the weights of observations from ``used`` [B, n, R]."""
    axles = blocks.wheel_rate.shape[-1]
    view, count = view_of(blocks.packed, axles), blocks.packed.shape[1]
    weight = row_weights(used, view.step * used[..., 0])
    return Averages(
        weight,
        torch.stack([view.velocity.mean(1), view.velocity_sd.square().sum(1) / count**2], 1),
    )


def _present(used: Tensor) -> Tensor:
    """Return 1 where a row of a block is there, [B, Q], from ``used`` [B, n, R]."""
    velocities = torch.ones(used.shape[0], 2, dtype=torch.float64)
    return torch.cat([velocities, (used[..., 1:].sum(1) > 0.0).to(torch.float64)], 1)


def _sources(rows: Rows, theta: Tensor, average: Averages) -> Tensor:
    """Return G [B, Q, n E], the change of each row for one deviation of every source of noise."""
    noise = _block_shape(rows.noise[0] @ theta, average.weight.shape[0], 0)  # [B, n, R, E]
    sources = torch.cat([noise[:, :, :1], noise], 2) * average.weight.unsqueeze(-1)
    return sources.transpose(1, 2).flatten(2)


def _spread(rows: Rows, average: Averages, present: Tensor) -> Tensor:
    """Return the diagonal of R [B, Q], the variances of the targets; 1 for an absent row."""
    variance = _block_shape(rows.variance, average.weight.shape[0], 0)
    spread = (torch.cat([variance[..., :1], variance], -1) * average.weight.square()).sum(1) + (
        1.0 - present
    )
    spread[:, 0] += average.measured[:, 1]
    spread[:, 1] += LINK_VARIANCE
    return spread


def _moved(noise: Tensor, error: Tensor, lead: int) -> Tensor:
    """Return the change of rows by the most likely ``error`` of their inputs."""
    count = error.shape[0]
    return (_block_shape(noise, count, lead) @ error.transpose(-1, -2)).squeeze(-1)


def _corrected(rows: Rows, theta: Tensor, error: Tensor) -> Tensor:
    """Return rows less targets [B, n, R] at the most likely inputs."""
    plain = _block_shape(rows.features[0] @ theta - rows.target, error.shape[0], 0)
    return plain + _moved(rows.noise[0] @ theta, error, 0)


def _by_theta(rows: Rows, average: Averages, error: Tensor) -> Tensor:
    """Return the change of the rows by c and tan phi, [B, Q, 2]."""
    columns = [
        average.of(
            _block_shape(rows.features[0, ..., k], error.shape[0], 0)
            + _moved(rows.noise[0, ..., k], error, 0)
        )
        for k in (0, 1)
    ]
    return torch.stack(columns, -1)


def _by_constant(changes: Changes | WheelChanges, average: Averages, error: Tensor) -> Tensor:
    """Return the change of the rows by each soil constant, [B, Q, M]."""
    change = changes.at(error.flatten(0, 2))
    return average.of(_block_shape(change, error.shape[0], 1)).permute(1, 2, 0)


class RunEquations:
    """The equations of one run under one hypothesis, at any point."""

    def __init__(
        self, blocks: Blocks, rows: HypothesisRows | WheelRows | DoubtedRows, mask: Tensor
    ) -> None:
        """Take the run and its rows; ``mask`` [R] is 1 for rows that may be used."""
        self._blocks, self._rows, self._mask = blocks, rows, mask

    def at(self, query: Query) -> Equations:
        """Return the equations at a point."""
        unknowns, count = query.unknowns, self._blocks.packed.shape[0]
        point = LinearizationPoint(unknowns.theta, unknowns.kappa, query.sizes)
        around = query.around or self._rows.expansion(point, self._mask)
        if query.known is None:
            rows, changes = self._rows.rows_and_changes(point, around)
        else:
            rows, changes = self._rows.rows(point, around), None
        used = _block_shape(rows.used * self._mask, count, 0)
        average, present = averages(self._blocks, used), _present(used)
        theta = torch.cat([unknowns.theta, torch.ones(1, dtype=torch.float64)])

        sources = _sources(rows, theta, average)
        spread = _spread(rows, average, present)
        covariance = sources @ sources.transpose(1, 2) + torch.diag_embed(spread)
        fixed, columns = self._fixed(present), query.columns * present.unsqueeze(-1)
        residual = self._residual(rows, theta, average, fixed, unknowns) - columns @ query.weights
        excess, factor, surplus = unexplained(covariance, residual, present)
        weighted = torch.cholesky_solve(residual.unsqueeze(-1), factor)
        error = (sources.transpose(1, 2) @ weighted).view(count, rows.used.shape[0] // count, 1, -1)

        known = query.known if changes is None else _by_constant(changes, average, error)
        assert known is not None
        own = [_by_theta(rows, average, error), known, fixed]
        corrected = _corrected(rows, theta, error)
        by_size = self._by_size(query, around, average, error, corrected)
        jacobian = torch.cat([*own, *(column.unsqueeze(-1) for column in by_size), columns], -1)
        shared = len(query.sizes) + query.weights.shape[0]
        hessian, gradient = assembled(jacobian, factor, weighted, self._blocks.ends, shared)
        return Equations(
            hessian=hessian,
            gradient=gradient,
            misfit=float((residual * weighted.squeeze(-1)).sum()) + surplus,
            by_constant=known,
            residual=residual,
            factor=factor,
            covariance=covariance,
            present=present,
            ends=self._blocks.ends,
            excess=excess,
            jacobian=jacobian,
            degrees=int(present.sum()),
            around=around,
            average=average,
            error=error.flatten(0, 2),
            corrected=corrected,
        )

    def shortfall(self, unknowns: Unknowns, sizes: tuple[float, ...], around: Expansion) -> Tensor:
        """Return targets less rows, [B, Q], without bias and velocities.

        Differences by ``sizes`` are an effect's signature.
        """
        count = self._blocks.packed.shape[0]
        rows = self._rows.rows(
            LinearizationPoint(unknowns.theta, unknowns.kappa, sizes),
            around,
        )
        average = averages(self._blocks, _block_shape(rows.used * self._mask, count, 0))
        theta = torch.cat([unknowns.theta, torch.ones(1, dtype=torch.float64)])
        return average.of(_block_shape(rows.target - rows.features[0] @ theta, count, 0))

    def _residual(
        self, rows: Rows, theta: Tensor, average: Averages, fixed: Tensor, unknowns: Unknowns
    ) -> Tensor:
        """Return targets less rows, bias and velocities, [B, Q]."""
        count = self._blocks.packed.shape[0]
        short = average.of(_block_shape(rows.target - rows.features[0] @ theta, count, 0))
        short[:, 0] += average.measured[:, 0]
        velocities = unknowns.velocity[self._blocks.ends].unbind(1)
        joined = torch.stack([unknowns.bias.expand(count), *velocities], -1)
        return short - (fixed @ joined.unsqueeze(-1)).squeeze(-1)

    def _by_size(
        self, query: Query, around: Expansion, average: Averages, error: Tensor, base: Tensor
    ) -> list[Tensor]:
        """Return the change of the rows [B, Q] by each size, from ``base`` at likely inputs."""
        unknowns, found = query.unknowns, []
        for k, step in enumerate(query.steps):
            sizes = tuple(size + step * (n == k) for n, size in enumerate(query.sizes))
            moved = LinearizationPoint(unknowns.theta, unknowns.kappa, sizes)
            varied = self._rows.corrected(moved, around, error.flatten(0, 2))
            found.append(average.of((varied.view(base.shape) - base) / step))
        return found

    def _fixed(self, present: Tensor) -> Tensor:
        """Return the columns of accelerometer bias and of both velocities, [B, Q, 3]."""
        columns = torch.zeros(*present.shape, 3, dtype=torch.float64)
        axles = self._blocks.wheel_rate.shape[-1]
        columns[:, axles + 3, 0] = present[:, axles + 3]
        columns[:, 0, 1] = columns[:, 1, 1] = 1.0
        columns[:, 1, 2] = -1.0
        return columns


def assembled(
    jacobian: Tensor, factor: Tensor, weighted: Tensor, ends: Tensor, shared: int
) -> tuple[Tensor, Tensor]:
    """Assemble J' W J and J' W r of a whole run from those of its blocks.

    ``weighted`` [B, Q, 1] is W r; ``shared`` unknowns come last.
    """
    count, _, local = jacobian.shape
    index = positions(count, local - 2 - shared, ends, 0)
    size = local - 1 - shared + int(ends.max())
    white = torch.linalg.solve_triangular(factor, jacobian, upper=False)
    own, common = white.split([local - shared, shared], 2)
    pairs = index.unsqueeze(2) * size + index.unsqueeze(1)
    alone = torch.zeros(size * size, dtype=torch.float64)
    alone.index_add_(0, pairs.flatten(), (own.transpose(1, 2) @ own).flatten())
    cross = torch.zeros(size, shared, dtype=torch.float64)
    cross.index_add_(0, index.flatten(), (own.transpose(1, 2) @ common).flatten(0, 1))
    together = common.flatten(0, 1).T @ common.flatten(0, 1)
    pull = (jacobian.transpose(1, 2) @ weighted).squeeze(-1)
    gradient = torch.zeros(size, dtype=torch.float64)
    gradient.index_add_(0, index.flatten(), pull[:, : local - shared].flatten())
    hessian = torch.cat(
        [
            torch.cat([alone.view(size, size), cross], 1),
            torch.cat([cross.T, together], 1),
        ]
    )
    return hessian, torch.cat([gradient, pull[:, local - shared :].sum(0)])


def positions(count: int, first: int, ends: Tensor, shared: int) -> Tensor:
    """Return the positions of each block's unknowns in its run: [B, first + 2 + shared]."""
    own = first + int(ends.max()) + 1
    return torch.cat(
        [
            torch.arange(first).expand(count, -1),
            first + ends,
            torch.arange(own, own + shared).expand(count, -1),
        ],
        1,
    )


def linear(equations: Equations, step: Tensor, shared: int) -> Equations:
    """Return the equations with the residuals that ``step`` [P + K] leaves to first order.

    The excess is the one that explains those.

    Gradient and misfit are those of the point from which the step starts, under the new weights.
    """
    local = equations.jacobian.shape[-1]
    index = positions(equations.jacobian.shape[0], local - 2 - shared, equations.ends, shared)
    left = equations.residual - (equations.jacobian @ step[index].unsqueeze(-1)).squeeze(-1)
    excess, factor, surplus = unexplained(equations.covariance, left, equations.present)
    weighted = torch.cholesky_solve(equations.residual.unsqueeze(-1), factor)
    hessian, gradient = assembled(equations.jacobian, factor, weighted, equations.ends, shared)
    misfit = float((equations.residual * weighted.squeeze(-1)).sum()) + surplus
    return dataclasses.replace(
        equations, hessian=hessian, gradient=gradient, misfit=misfit, factor=factor, excess=excess
    )


def unexplained(
    covariance: Tensor, residual: Tensor, present: Tensor
) -> tuple[Tensor, Tensor, float]:
    """Return D [Q], the factor of S + D, and log det (S + D) - log det S over all blocks."""
    excess = excess_variance(covariance, residual, present)
    factor = cholesky(covariance + torch.diag_embed(excess * present))
    return (
        excess,
        factor,
        float((log_determinant(factor) - log_determinant(cholesky(covariance))).sum()),
    )


ROUNDS = 8
LEAST_EXCESS = 1e-4
"""[1] Smallest excess variance of a row, in units of the mean variance of its noise."""


def excess_variance(covariance: Tensor, residual: Tensor, present: Tensor) -> Tensor:
    """Return the most likely D [Q] of all blocks, 0 or more.

    ``residual`` [B, Q] has the noise ``covariance`` [B, Q, Q].

    At it SUM w_q^2 = SUM W_qq with W = (S + D)^-1 and w = W r; iterated as a ratio, which keeps D
    positive.
    """
    count = present.sum(0).clamp(min=1.0)
    noise = (covariance.diagonal(dim1=1, dim2=2) * present).sum(0) / count
    least = LEAST_EXCESS * noise
    excess = torch.maximum((residual.square() * present).sum(0) / count - noise, 0.1 * noise)
    for _ in range(ROUNDS):
        weight = torch.cholesky_inverse(cholesky(covariance + torch.diag_embed(excess * present)))
        pull = (weight @ residual.unsqueeze(-1)).squeeze(-1)
        ratio = (pull.square() * present).sum(0) / (weight.diagonal(dim1=1, dim2=2) * present).sum(
            0
        ).clamp(min=1e-30)
        excess = torch.maximum(excess * ratio.clamp(0.05, 20.0), least)
    return torch.where(count > 0.0, excess, 0.0)
