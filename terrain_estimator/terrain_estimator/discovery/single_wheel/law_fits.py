# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Two fits of the contact law: its constants free, and its constants as measured.

With constants free the law shows how well it can fit at all. With constants as measured, a model
error stands beside the law and c and tan phi follow (Kennedy and O'Hagan 2001)::

    y ~ N(f(x) + d, C),   d of a row a Gaussian process of covariance s^2 exp(-distance)

C is of repeatability and errors of reading, the distance that of :mod:`model_error`. x, and s of
each row, are integrated over: x from the deviations of the constants and of the zeros, c and tan
phi from no more than their physical range, log s from a tenth of the row's deviation in C to the
root mean square of the row.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import least_squares
from scipy.stats import norm

from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.single_wheel.cells import ROWS, Cells, Rig
from terrain_estimator.discovery.single_wheel.free_law import MEASURED, FreeLaw
from terrain_estimator.discovery.single_wheel.importance import Draws, draws, mode
from terrain_estimator.discovery.single_wheel.model_error import correlation
from terrain_estimator.model.rows import PA_PER_UNIT
from terrain_estimator.observation import Floats

REJECTED = 0.0027
"""[1] Probability, over all constants together, of calling a right measured constant rejected."""
ENDS = (0.025, 0.5, 0.975)
"""[1] Shares below the ends and the middle of a 95 % interval."""
ENOUGH = 2000.0
"""Effective draws that are aimed at: the ends of an interval are then known to 0.06 deviations."""
RELIABLE = 100.0
"""Effective draws without which an interval is not reported."""
_SMALLEST = 0.1
_STARTS, _FEW, _MOST = 12, 60, 400
_STEP = 1e-5

Interval = tuple[float, float, float]
"""Lower end, median and upper end of a 95 % interval."""


@dataclass(frozen=True, slots=True)
class ConstantsFree:
    """How well the law can fit, everything in it free."""

    rms: dict[str, float]  # of each measured row, in its unit
    unknowns: int
    measurements: int


@dataclass(frozen=True, slots=True)
class Rejected:
    """A measured constant that the data contradict when it is free."""

    name: str
    measured: float
    measured_sd: float
    fitted: Interval
    deviations: float  # between both, in units of both deviations together


@dataclass(frozen=True, slots=True)
class ConstantsMeasured:
    """c and tan phi with the constants as measured and a model error beside the law."""

    cohesion_pa: Interval
    tan_phi: Interval
    model_error: dict[str, Interval]  # deviation of each measured row, in its unit
    effective: float  # draws

    @property
    def reliable(self) -> bool:
        """Whether the draws suffice for intervals."""
        return self.effective >= RELIABLE


@dataclass(frozen=True, slots=True)
class LawFits:
    """Both fits of the law with the effects that act in it."""

    effects: tuple[str, ...]  # besides the contact law
    free: ConstantsFree
    measured: ConstantsMeasured | None  # None without a torque, which c and tan phi need
    rejected: tuple[Rejected, ...]  # measured constants; none are looked for without a torque


def law_fits(
    bed: Rig,
    cells: Cells,
    given: Hypothesis,
    added: Hypothesis,
    progress: ProgressCallback,
    seed: int = 0,
) -> LawFits:
    """Fit the law with ``given`` effects in all cells, and ``added`` ones where they may act."""
    law = FreeLaw(bed, given, added)
    progress(0.0, "constants free")
    free = constants_free(law, cells, seed)
    progress(0.2, "constants as measured")
    torque = bool(cells.seen[:, ROWS.index("torque")].any())
    effects = (*given.names, *added.names)
    if not torque:
        return LawFits(effects, free, None, ())
    measured = constants_measured(law, cells, seed)
    progress(0.4, "each constant free")
    return LawFits(effects, free, measured, rejected_constants(law, cells, seed))


def constants_free(law: FreeLaw, cells: Cells, seed: int = 0) -> ConstantsFree:
    """Return the best of fits from the soil file's constants and from random places."""
    seen = cells.seen.numpy().ravel()
    noise = np.tile(law.bed.deviations, len(cells.slip))[seen]
    measured = cells.measured.numpy().ravel()[seen]

    def short(x: Floats) -> Floats:
        return np.asarray((law.of(cells, x[None])[0].ravel()[seen] - measured) / noise)

    def slope(x: Floats) -> Floats:
        steps = np.where(x + _STEP > law.high, -_STEP, _STEP)
        moved = np.vstack([x[None], x + np.diag(steps)])
        rows = law.of(cells, moved).reshape(len(moved), -1)[:, seen] / noise
        return np.asarray(((rows[1:] - rows[0]) / steps[:, None]).T)

    def fitted(start: Floats, most: int) -> tuple[float, Floats]:
        found = least_squares(
            short, start, slope, (law.low, law.high), x_scale=law.high - law.low, max_nfev=most
        )
        return float(found.cost), found.x

    generator = np.random.default_rng(seed)
    shares = generator.uniform(0.2, 0.8, (_STARTS, len(law.low)))
    begins = [law.start(), *(law.low + (law.high - law.low) * shares)]
    _, best = min((fitted(begin, _FEW) for begin in begins), key=lambda each: each[0])
    _, best = fitted(best, _MOST)
    errors = np.full(cells.seen.shape, math.nan)
    errors.ravel()[seen] = short(best) * noise
    rms = np.sqrt(np.nanmean(errors[:, _kinds(cells)] ** 2, 0)).tolist()
    return ConstantsFree(dict(zip(_names(cells), rms, strict=True)), len(best), int(seen.sum()))


def constants_measured(law: FreeLaw, cells: Cells, seed: int = 0) -> ConstantsMeasured:
    """Return c and tan phi with the constants as measured."""
    found = _Posterior(law, cells).draws(ENOUGH, seed)
    scales = np.array([law.bed.deviations[row] for row in _kinds(cells)])
    errors = np.exp(found.values[:, len(law.low) :]) * scales
    return ConstantsMeasured(
        _interval(found, PA_PER_UNIT * found.values[:, 0]),
        _interval(found, found.values[:, 1]),
        {name: _interval(found, errors[:, k]) for k, name in enumerate(_names(cells))},
        found.effective,
    )


def rejected_constants(law: FreeLaw, cells: Cells, seed: int) -> tuple[Rejected, ...]:
    """Free each measured constant alone; return those too far from where they were measured."""
    names = [each.name for each in law.coordinates]
    most = float(norm.isf(0.5 * REJECTED / len(MEASURED)))
    rejected = []
    for name in MEASURED:
        place = names.index(name)
        known = law.coordinates[place]
        found = _Posterior(law, cells, free=place).draws(RELIABLE, seed)
        mean, covariance = found.moments()
        apart = abs(float(mean[place]) - known.mean)
        deviations = apart / math.hypot(known.sd, math.sqrt(covariance[place, place]))
        if found.effective >= RELIABLE and deviations > most:
            fitted = _interval(found, law.constant(name, found.values[:, place]))
            measured = float(law.constant(name, np.array(known.mean)))
            rejected.append(
                Rejected(name, measured, law.deviation(name), fitted, float(deviations))
            )
    return tuple(rejected)


class _Posterior:
    """Density of the law's unknowns and of log s of each measured row, in deviations of C."""

    def __init__(self, law: FreeLaw, cells: Cells, free: int | None = None) -> None:
        """``free`` is the place of a coordinate of which the range alone is known."""
        self._law, self._cells = law, cells
        self._mean = np.array([each.mean for each in law.coordinates])
        self._sd = np.array([each.sd for each in law.coordinates])
        if free is not None:
            self._sd[free] = math.inf
        self._seen = cells.seen.numpy().ravel()
        self._noise = np.tile(law.bed.deviations, len(cells.slip))[self._seen]
        self._measured = cells.measured.numpy().ravel()[self._seen] / self._noise
        self._known = self._noise_at(law.start())
        kind = np.tile(np.arange(len(ROWS)), len(cells.slip))[self._seen]
        cell = np.repeat(np.arange(len(cells.slip)), len(ROWS))[self._seen]
        near = correlation(cells)[np.ix_(cell, cell)]
        rows = [kind == row for row in _kinds(cells)]
        self._shared = np.array([np.where(own[:, None] & own, near, 0.0) for own in rows])
        largest = [max(math.sqrt((self._measured[own] ** 2).mean()), 1.0) for own in rows]
        self.low = np.concatenate([law.low, np.full(len(rows), math.log(_SMALLEST))])
        self.high = np.concatenate([law.high, np.log(largest)])

    def draws(self, enough: float, seed: int) -> Draws:
        """Return draws of all unknowns."""
        count = len(self._law.low)
        middle = np.concatenate([self._law.start(), 0.5 * (self.low + self.high)[count:]])
        if self._law.bed.slip_sd > 0.0:
            near = mode(self.log_density, middle, self.low, self.high, seed)
            self._known = self._noise_at(near[:count])
        return draws(self.log_density, middle, self.low, self.high, enough, seed)

    def _noise_at(self, values: Floats) -> Floats:
        """Return C [M, M], the error of slip linearised."""
        found = self._law.bed.slip_errors(
            self._cells, lambda each: torch.from_numpy(self._law.of(each, values[None])[0])
        )
        whole = np.eye(len(self._seen)) + found.numpy()
        return np.asarray(whole[np.ix_(self._seen, self._seen)])

    def log_density(self, values: Floats) -> Floats:
        """Return the log density [V] up to a constant."""
        own = values[:, : len(self._law.low)]
        rows = self._law.of(self._cells, own).reshape(len(values), -1)[:, self._seen]
        short = self._measured - rows / self._noise
        squares = np.exp(2.0 * values[:, own.shape[1] :])
        covariance = self._known + np.tensordot(squares, self._shared, 1)
        factor = np.linalg.cholesky(covariance)
        white = np.linalg.solve(factor, short[..., None])[..., 0]
        volume = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(1)
        before = (((own - self._mean) / self._sd) ** 2).sum(1)
        return np.asarray(-0.5 * ((white**2).sum(1) + before) - volume)


def _kinds(cells: Cells) -> list[int]:
    """Return the rows that were measured at all."""
    return [row for row, seen in enumerate(cells.seen.any(0).tolist()) if seen]


def _names(cells: Cells) -> list[str]:
    return [ROWS[row] for row in _kinds(cells)]


def _interval(found: Draws, of: Floats) -> Interval:
    low, middle, high = found.quantiles(of, ENDS).tolist()
    return low, middle, high
