# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Batch Gauss-Newton over several runs, and the evidence of a hypothesis by Laplace's method.

Given the shared unknowns (sizes of effects, weights of a discrepancy) the runs are independent:
what a run contributes is its normal equations with its own unknowns eliminated (Schur complement),
and contributions add up.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.equations import Equations, Query, linear
from terrain_estimator.discovery.hypotheses.library import Shared
from terrain_estimator.discovery.hypotheses.unknowns import Point
from terrain_estimator.model.gaussian import cholesky, log_determinant

LONGEST_STEP = (1.0, 0.25)
"""Largest change of c [kPa] and tan phi in one step."""
SETTLED = 0.3
"""[1] Predicted decrease of the objective at which a fit ends; it is taken into account."""


Evaluate = Callable[[Sequence[Query]], Sequence[Equations]]
"""The equations of every run under one hypothesis, in the order of the runs."""


@dataclass(frozen=True, slots=True)
class Fit:
    """The most probable point of one hypothesis."""

    point: Point
    origin: Point  # at which the equations were evaluated, a step before
    objective: float  # misfit and priors at the minimum, as the last step predicts it
    log_evidence: float  # [nat] up to a constant of the runs
    given: (
        float  # [nat] the same, were the shared unknowns known to have their values at the minimum
    )
    covariance: Tensor  # [K, K] of the shared unknowns
    equations: tuple[Equations, ...]
    degrees: int  # rows of all blocks
    iterations: int


@dataclass(frozen=True, slots=True)
class _Normal:
    """Equations of all runs with priors, at one point."""

    objective: float
    equations: tuple[Equations, ...]
    factors: tuple[Tensor, ...]  # of each run's own block
    own: tuple[Tensor, ...]  # gradient by each run's own unknowns
    cross: tuple[Tensor, ...]  # own by shared
    schur: Tensor  # [K, K]
    pull: Tensor  # [K] gradient with the runs' own unknowns eliminated
    log_volume: float  # of all own unknowns: log det of precision over prior precision


def _normal(point: Point, equations: Sequence[Equations], shared: Shared) -> _Normal:
    count = point.shared.shape[0]
    precision = shared.sd**-2
    schur, pull = torch.diag(precision), -precision * point.shared
    objective = float((precision * point.shared.square()).sum())
    factors, owns, crosses, volume = [], [], [], 0.0
    for unknowns, equation in zip(point.runs, equations, strict=True):
        mean, own_precision = unknowns.prior_moments()
        size = mean.shape[0]
        values = unknowns.flat()
        objective += equation.misfit + float((own_precision * (values - mean).square()).sum())
        factor = cholesky(equation.hessian[:size, :size] + torch.diag(own_precision))
        gradient = equation.gradient[:size] - own_precision * (values - mean)
        cross = equation.hessian[:size, size:]
        solved = torch.cholesky_solve(torch.cat([cross, gradient.unsqueeze(1)], 1), factor)
        schur = schur + equation.hessian[size:, size:] - cross.T @ solved[:, :count]
        pull = pull + equation.gradient[size:] - cross.T @ solved[:, count]
        volume += float(log_determinant(factor) - torch.log(own_precision).sum())
        factors.append(factor)
        owns.append(gradient)
        crosses.append(cross)
    return _Normal(
        objective,
        tuple(equations),
        tuple(factors),
        tuple(owns),
        tuple(crosses),
        schur,
        pull,
        volume,
    )


def _step(normal: _Normal, point: Point, shared: Shared) -> tuple[list[Tensor], Tensor, float]:
    """Return the steps of own and shared unknowns, and the decrease that they promise."""
    sizes = shared.low.shape[0]
    free = torch.ones_like(point.shared, dtype=torch.bool)
    move = _solved(normal, free)
    for _ in range(sizes):  # a size that would leave its range stays at the end
        after = point.shared + move
        outside = torch.zeros_like(free)
        outside[:sizes] = (after[:sizes] < shared.low) | (after[:sizes] > shared.high)
        at_end = torch.zeros_like(free)
        at_end[:sizes] = (point.shared[:sizes] <= shared.low) | (
            point.shared[:sizes] >= shared.high
        )
        blocked = outside & at_end & free
        if not bool(blocked.any()):
            break
        free = free & ~blocked
        move = _solved(normal, free)
    move = move.clone()
    move[:sizes] = (point.shared[:sizes] + move[:sizes]).clamp(
        shared.low, shared.high
    ) - point.shared[:sizes]
    owns, promised = [], float(2.0 * normal.pull @ move - move @ normal.schur @ move)
    for factor, gradient, cross in zip(normal.factors, normal.own, normal.cross, strict=True):
        owns.append(torch.cholesky_solve((gradient - cross @ move).unsqueeze(1), factor).squeeze(1))
        promised += float(gradient @ torch.cholesky_solve(gradient.unsqueeze(1), factor).squeeze(1))
    return owns, move, promised


def _solved(normal: _Normal, free: Tensor) -> Tensor:
    move = torch.zeros_like(normal.pull)
    if bool(free.any()):
        part = cholesky(normal.schur[free][:, free])
        move[free] = torch.cholesky_solve(normal.pull[free].unsqueeze(1), part).squeeze(1)
    return move


def _moved(point: Point, owns: list[Tensor], move: Tensor, share: float) -> Point:
    runs = []
    for unknowns, step in zip(point.runs, owns, strict=True):
        longest = max(
            float((step[:2].abs() / torch.tensor(LONGEST_STEP, dtype=torch.float64)).max()), 1.0
        )
        runs.append(unknowns.moved(step * (share / longest)))
    return Point(tuple(runs), point.shared + share * move)


def _first_share(move: Tensor, shared: Shared) -> float:
    """Return the largest share of a step, at most 1, that no shared unknown refuses as too long."""
    if shared.longest is None:
        return 1.0
    return 1.0 / max(1.0, float((move.abs() / shared.longest).max()))


def fit(
    evaluate: Evaluate,
    start: Point,
    shared: Shared,
    columns: Sequence[Tensor],
    known: Sequence[Tensor | None],
    *,
    most: int = 8,
    settled: float = SETTLED,
    daring: int = 0,
) -> Fit:
    """Minimise the objective from ``start``.

    ``columns`` [B, Q, F] of each run are those of a discrepancy. ``known`` [B, Q, M] are each run's
    columns of the soil constants where they are known well enough from another fit: they need four
    fifths of the time. A step that does not lower the objective is shortened, but the first
    ``daring`` ones, which may lead over a ridge.
    """
    point, share = start, 1.0
    best: tuple[Point, _Normal, float] | None = None  # from which steps are made
    lowest: tuple[Point, _Normal, float] | None = None
    iteration = 0
    while iteration < most:
        iteration += 1
        equations = evaluate(_asks(point, shared, columns, known))
        normal = _normal(point, equations, shared)
        worse = best is not None and not normal.objective < best[1].objective + _TOLERANCE
        if worse and iteration > daring and best is not None and share > _SHORTEST:
            share *= 0.4
            owns, move, _ = _step(best[1], best[0], shared)
            point = _moved(best[0], owns, move, share)
            continue
        owns, move, promised = _step(normal, point, shared)
        best, share = (point, normal, promised), _first_share(move, shared)
        if lowest is None or normal.objective < lowest[1].objective + _TOLERANCE:
            lowest = best
        if promised < settled + _RELATIVE * max(
            normal.objective - sum(each.degrees for each in equations), 0.0
        ):
            break
        point = _moved(point, owns, move, share)
    assert lowest is not None
    return _finished(lowest, shared, iteration)


_TOLERANCE = 0.5
_RELATIVE = (
    1e-3  # [1] of the misfit in excess of the noise: what a wrong hypothesis need not settle
)
_SHORTEST = 0.05


def _asks(
    point: Point, shared: Shared, columns: Sequence[Tensor], known: Sequence[Tensor | None]
) -> list[Query]:
    """Return the queries of every run at a point."""
    sizes = shared.low.shape[0]
    values = tuple(point.shared[:sizes].tolist())
    weights, steps = point.shared[sizes:], _inward(values, shared)
    return [
        Query(own, values, weights, own_columns, steps, kept)
        for own, own_columns, kept in zip(point.runs, columns, known, strict=True)
    ]


Spreads = Callable[[Tensor, Tensor], Tensor]
"""Prior deviations [K] of the shared unknowns for their values [K] and variances [K]."""


def predict(
    evaluate: Evaluate,
    start: Point,
    shared: Shared,
    columns: Sequence[Tensor],
    before: Sequence[Equations],
    spreads: Spreads | None = None,
) -> Fit:
    """Predict the minimum from one evaluation at ``start``.

    The rows count as linear; weights and ``spreads`` follow.

    A fraction of the time of :func:`fit`, good enough to choose the hypotheses for it.
    ``before`` are the equations of a fit from which the start was taken: columns of the soil
    constants and inputs around which to expand are theirs.
    """
    queries = _asks(start, shared, columns, [each.by_constant for each in before])
    equations = evaluate(
        [
            dataclasses.replace(query, around=each.around)
            for query, each in zip(queries, before, strict=True)
        ]
    )
    return predict_from(equations, start, shared, spreads)


def predict_from(
    equations: Sequence[Equations], start: Point, shared: Shared, spreads: Spreads | None = None
) -> Fit:
    """Predict the minimum from the equations of every run at ``start``, as :func:`predict`."""
    count = start.shared.shape[0]
    normal = _normal(start, equations, shared)
    for _ in range(_REWEIGHTED):
        owns, move, _ = _step(normal, start, shared)
        if spreads is not None:
            shared = dataclasses.replace(
                shared, sd=spreads(start.shared + move, _covariance(normal).diagonal())
            )
        equations = [
            linear(each, torch.cat([own, move]), count)
            for each, own in zip(equations, owns, strict=True)
        ]
        normal = _normal(start, equations, shared)
    owns, move, promised = _step(normal, start, shared)
    objective, degrees = normal.objective - promised, sum(each.degrees for each in equations)
    evidence = -0.5 * (objective + _volume(normal, shared))
    found = _moved(start, owns, move, 1.0)
    return Fit(
        found,
        start,
        objective,
        evidence,
        _given(objective, normal, found, shared),
        _covariance(normal),
        tuple(equations),
        degrees,
        1,
    )


def _covariance(normal: _Normal) -> Tensor:
    """Return the covariance [K, K] of the shared unknowns."""
    return torch.cholesky_inverse(cholesky(normal.schur))


_REWEIGHTED = 4


def _volume(normal: _Normal, shared: Shared) -> float:
    """Return log det of the posterior's precision over the prior's."""
    return normal.log_volume + float(
        log_determinant(cholesky(normal.schur)) + 2.0 * torch.log(shared.sd).sum()
    )


def _inward(values: tuple[float, ...], shared: Shared) -> tuple[float, ...]:
    """Return steps of differences that stay inside the physical range."""
    return tuple(
        -step if value + step > high else step
        for value, step, high in zip(values, shared.step, shared.high.tolist(), strict=True)
    )


def _finished(best: tuple[Point, _Normal, float], shared: Shared, iterations: int) -> Fit:
    point, normal, promised = best
    owns, move, _ = _step(normal, point, shared)
    objective = normal.objective - min(max(promised, 0.0), 10.0)
    factor = cholesky(normal.schur)
    final = _moved(point, owns, move, 1.0)
    evidence = -0.5 * (objective + _volume(normal, shared)) + _log_inside(
        final.shared, factor, shared
    )
    degrees = sum(equation.degrees for equation in normal.equations)
    covariance = torch.cholesky_inverse(factor)
    return Fit(
        final,
        point,
        objective,
        evidence,
        _given(objective, normal, final, shared),
        covariance,
        normal.equations,
        degrees,
        iterations,
    )


def _given(objective: float, normal: _Normal, point: Point, shared: Shared) -> float:
    """Return the log evidence with the shared unknowns known, see :class:`Fit`."""
    return -0.5 * (objective - float((point.shared / shared.sd).square().sum()) + normal.log_volume)


def _log_inside(values: Tensor, factor: Tensor, shared: Shared) -> float:
    """Return the log mass of the posterior in the physical range over that of the prior.

    Each size by itself.
    """
    sizes = shared.low.shape[0]
    if sizes == 0:
        return 0.0
    sd = torch.cholesky_inverse(factor).diagonal()[:sizes].sqrt()
    after = _mass(values[:sizes], sd, shared)
    before = _mass(torch.zeros_like(sd), shared.sd[:sizes], shared)
    return float((torch.log(after.clamp(min=1e-6)) - torch.log(before)).sum())


def _mass(mean: Tensor, sd: Tensor, shared: Shared) -> Tensor:
    upper, lower = (shared.high - mean) / sd, (shared.low - mean) / sd
    return 0.5 * (
        torch.special.erf(upper / math.sqrt(2.0)) - torch.special.erf(lower / math.sqrt(2.0))
    )
