# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The most probable parameters of a hypothesis about one wheel, and its evidence.

Parameters in prior deviations: c, tan phi, the uncertain soil constants, the errors of sensors
that are not known (gains, and zeros with the datum of the sinkage among them), sizes of effects
that are known to act in all tables, sizes of those that are looked for. With J their Jacobian the
measurements are Gaussian,

    y ~ N(f(x), C),   C = R + excess of each row (+ s^2 G of each row),

R of repeatability and errors of reading, G that of the model error (:mod:`model_error`): a
discrepancy without a name. Excess and s are at their most likely values, with x integrated out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from scipy.optimize import least_squares, minimize
from scipy.stats import norm
from torch import Tensor

from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel.cells import ROWS, Cells, Rig
from terrain_estimator.discovery.single_wheel.model_error import correlation
from terrain_estimator.model.physics import uncertain_constants
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.model.rows import PA_PER_UNIT
from terramechanics.effects.simulated import SimulatedEffect

Floats = npt.NDArray[np.float64]

STRENGTH = (
    (DEFAULT_PRIOR.cohesion_pa / PA_PER_UNIT, DEFAULT_PRIOR.cohesion_sd_pa / PA_PER_UNIT),
    (DEFAULT_PRIOR.tan_phi, DEFAULT_PRIOR.tan_phi_sd),
)
"""Prior mean and deviation of c [kPa] and tan phi: a testbed has no model."""
PER_SIGNAL = 3
"""Functions of one signal in a discrepancy without a name."""
_STEP = 1e-4
"""[1] Prior deviations by which a parameter is varied for differences."""
_ROUNDS = 4
_LEAST = 1e-6


@dataclass(frozen=True, slots=True)
class Explained:
    """A hypothesis at its most probable parameters."""

    hypothesis: Hypothesis
    values: Floats  # [P] in prior deviations
    covariance: Floats  # [P, P]
    log_evidence: float  # [nat]
    model_error: Floats  # [R] deviation of the model error of each row, in units of ROWS
    left: tuple[
        str, str
    ]  # row and signal on which the discrepancy without a name depends most, where there is one

    def sizes(self, first: int) -> list[tuple[str, float, float]]:
        """Return the sizes of the effects that are looked for, see :meth:`Hypothesis.sizes`.

        ``first`` is the number of their first parameter.
        """
        scale = self.hypothesis.shared().sd.numpy()
        deviations = np.sqrt(np.diag(self.covariance))[first:]
        return self.hypothesis.sizes(
            (self.values[first:] * scale).tolist(), (deviations * scale).tolist()
        )


class WheelModel:
    """The contact model's rows of cells under a hypothesis; ``given`` effects act in all tables."""

    def __init__(self, bed: Rig, given: Hypothesis, hypothesis: Hypothesis) -> None:
        """Take the wheel and soil of one testbed, known effects and the hypothesis."""
        self.bed, self._given, self.hypothesis = bed, given, hypothesis
        nominal = bed.soil.constants()
        shares = torch.tensor(bed.constants_sd, dtype=torch.float64).unsqueeze(1)
        whole = uncertain_constants(nominal.unsqueeze(0), 1.0, bed.rover.wheel_width)[0]
        self._uncertain = shares * whole
        self._error_sd = torch.tensor([each.sd for each in bed.sensor_errors], dtype=torch.float64)
        self.own = 2 + self._uncertain.shape[0] + len(self._error_sd)
        self.first = self.own + given.shared().sd.shape[0]
        self.low, self.high = self._limits(nominal)
        self._near = NearBy()

    def start(self) -> Floats:
        """Return the parameters at which a fit begins."""
        return np.clip(
            np.concatenate([np.zeros(self.own), *map(_begin, (self._given, self.hypothesis))]),
            self.low,
            self.high,
        )

    def of(self, cells: Cells, values: Floats) -> Floats:
        """Return the rows [B, R]."""
        return self._several(cells, values[None])[0]

    def slip_errors(self, cells: Cells, values: Floats) -> Floats:
        """Return the covariance of the error of slip, see :meth:`Rig.slip_errors`."""
        found = self.bed.slip_errors(cells, lambda each: torch.from_numpy(self.of(each, values)))
        return np.asarray(found.numpy())

    def jacobian(self, cells: Cells, values: Floats) -> tuple[Floats, Floats]:
        """Return the rows [B, R], and their changes with each parameter [B, R, P]."""
        steps = np.where(values + _STEP > self.high, -_STEP, _STEP)
        rows = self._several(cells, np.vstack([values[None], values + np.diag(steps)]))
        return rows[0], np.moveaxis((rows[1:] - rows[0]) / steps[:, None, None], 0, -1)

    def _several(self, cells: Cells, values: Floats) -> Floats:
        """Return the rows [V, B, R] for values [V, P]."""
        table = torch.from_numpy(np.ascontiguousarray(values))
        theta = torch.tensor([[mean, sd] for mean, sd in STRENGTH], dtype=torch.float64)
        strength = (theta[:, 0] + table[:, :2] * theta[:, 1]) * torch.tensor(
            [PA_PER_UNIT, 1.0], dtype=torch.float64
        )
        constants_end = self.own - len(self._error_sd)
        constants = self.bed.soil.constants() + table[:, 2:constants_end] @ self._uncertain
        given, sought = table[:, self.own : self.first], table[:, self.first :]
        effects = [
            *acting(self._given, given * self._given.shared().sd, cells),
            *acting(self.hypothesis, sought * self.hypothesis.shared().sd, cells, sought=True),
        ]
        found = self._near.states(self.bed, cells, strength, constants, effects)
        return self.bed.read(found, table[:, constants_end : self.own] * self._error_sd).numpy()

    def _limits(self, nominal: Tensor) -> tuple[Floats, Floats]:
        """Return the physical ranges.

        Strength and soil constants stay positive, and the largest stress stays in the contact.
        """
        low, high = np.full(self.own, -4.0), np.full(self.own, 4.0)
        for k, (mean, sd) in enumerate(STRENGTH):
            low[k] = -mean / sd * (1.0 - 1e-3)
        for k, change in enumerate(self._uncertain):
            at = int(change.abs().argmax())
            low[2 + k] = max(low[2 + k], -0.9 * abs(float(nominal[at] / change[at])))
        ranges = [
            (each.shared().low / each.shared().sd[: len(each.shared().low)], each)
            for each in (self._given, self.hypothesis)
        ]
        lows = [ends.numpy() for ends, _ in ranges]
        highs = [
            (each.shared().high / each.shared().sd[: len(each.shared().high)]).numpy()
            for _, each in ranges
        ]
        return np.concatenate([low, *lows]), np.concatenate([high, *highs])


def _begin(hypothesis: Hypothesis) -> Floats:
    return (
        np.array(hypothesis.start()) / hypothesis.shared().sd.numpy()
        if hypothesis.effects
        else np.zeros(0)
    )


def acting(
    hypothesis: Hypothesis, values: Tensor, cells: Cells, *, sought: bool = False
) -> list[SimulatedEffect]:
    """Return the effects with one set of ``values`` [V, K] for each of V soils, on B cells.

    Effects that are ``sought`` are zero in cells where they do not act.
    """
    count = len(cells.slip)
    values = values.repeat_interleave(count, 0)
    if sought:
        values = torch.where(cells.acts.repeat(len(values) // count).unsqueeze(1), values, 0.0)
    parts = torch.split(values, [each.count for each in hypothesis.effects], 1)
    return [each.with_values(part) for each, part in zip(hypothesis.effects, parts, strict=True)]


class NearBy:
    """States of cells by searches that begin where the one before ended, for the same cells.

    A fit asks for many that hardly differ.
    """

    def __init__(self) -> None:
        self._cells: Cells | None = None
        self._depth: Tensor | None = None  # [B]

    def states(
        self,
        bed: Rig,
        cells: Cells,
        strength: Tensor,
        constants: Tensor,
        effects: Sequence[SimulatedEffect],
    ) -> Tensor:
        """Return what :meth:`Rig.states` does."""
        if cells is not self._cells:
            self._cells, self._depth = cells, None
        found = bed.states(cells, strength, constants, effects, self._depth)
        self._depth = found[0, :, ROWS.index("sinkage")]
        return found


@dataclass(frozen=True, slots=True)
class _Spread:
    """Differences of measurements from the model, in deviations of the rig.

    ``hyper`` [2 R] is the excess of each row, then s of each.
    """

    functions: Floats  # [B, F], PER_SIGNAL for each signal
    near: Floats  # [B, B] correlation of the model error
    seen: npt.NDArray[np.bool_]  # [R B] cell by cell, in the order of ROWS
    slip: Floats  # [R B, R B] of the error of slip

    def covariance(self, hyper: Floats) -> Floats:
        """Return the covariance of the M measurements, [M, M]."""
        rows, count = len(ROWS), len(self.functions)
        covariance = self.slip.copy()
        for row in range(rows):
            covariance[row::rows, row::rows] += (
                np.eye(count) * (1.0 + hyper[row] ** 2) + hyper[rows + row] ** 2 * self.near
            )
        return covariance[np.ix_(self.seen, self.seen)]

    def depends_on(
        self, hyper: Floats, residual: Floats, signals: Sequence[str]
    ) -> tuple[str, str]:
        """Return row and signal of the largest part of a discrepancy that ``residual`` [M] holds.

        In deviations of the rig, with the discrepancy expanded in functions of each signal.
        """
        pulled = np.zeros(len(self.seen))
        pulled[self.seen] = np.linalg.solve(self.covariance(hyper), residual)
        parts = {}
        for k, row in enumerate(ROWS):
            missed = hyper[len(ROWS) + k] ** 2 * self.near @ pulled[k :: len(ROWS)]
            weights, *_ = np.linalg.lstsq(self.functions, missed, rcond=None)
            for j, signal in enumerate(signals):
                own = slice(PER_SIGNAL * j, PER_SIGNAL * (j + 1))
                parts[row, signal] = float(np.linalg.norm(self.functions[:, own] @ weights[own]))
        return max(parts, key=lambda each: parts[each])


def explain(
    model: WheelModel, cells: Cells, *, flexible: bool = False, start: Floats | None = None
) -> Explained:
    """Fit a model to cells; ``flexible`` with a discrepancy without a name on top."""
    values = model.start() if start is None else start
    seen = cells.seen.numpy().ravel()
    noise = np.tile(model.bed.deviations, len(cells.slip))[seen]
    functions = smooth(cells)
    every, near = np.concatenate(list(functions.values()), 1), correlation(cells)
    hyper = np.repeat([1.0, float(flexible)], len(ROWS))
    measured = cells.measured.numpy().ravel()[seen]
    residual, jacobian = np.zeros(0), np.zeros(0)
    spread = _Spread(every, near, seen, model.slip_errors(cells, values))
    for _ in range(_ROUNDS):
        white = np.linalg.inv(np.linalg.cholesky(spread.covariance(hyper)))

        def short(x: Floats, white: Floats = white) -> Floats:
            return np.concatenate(
                [white @ ((model.of(cells, x).ravel()[seen] - measured) / noise), x]
            )

        def slope(x: Floats, white: Floats = white) -> Floats:
            by = model.jacobian(cells, x)[1].reshape(len(seen), -1)[seen] / noise[:, None]
            return np.vstack([white @ by, np.eye(len(x))])

        values = least_squares(
            short, values, slope, (model.low, model.high), max_nfev=12, xtol=1e-6
        ).x
        modelled, by = model.jacobian(cells, values)
        spread = _Spread(every, near, seen, model.slip_errors(cells, values))
        residual = (measured - modelled.ravel()[seen]) / noise
        jacobian = by.reshape(len(seen), -1)[seen] / noise[:, None]
        hyper = _most_likely(
            residual + jacobian @ values, jacobian, spread, hyper, flexible=flexible
        )
    left = spread.depends_on(hyper, residual, list(functions))
    return _finished(model, values, residual, jacobian, hyper, spread, left)


def smooth(cells: Cells) -> dict[str, Floats]:
    """Return functions [B, PER_SIGNAL] of each signal that make a discrepancy, of unit mean square.

    The mean belongs to datum and soil.
    """
    slip, acts, side = (
        cells.slip.numpy(),
        cells.acts.numpy().astype(float),
        np.sin(cells.slip_angle.numpy()),
    )
    columns = np.stack([slip, slip**2, np.maximum(slip - 0.5, 0.0)], 1)
    powers = np.stack([np.ones_like(slip), slip, slip**2], 1)
    found = {"slip": columns - columns.mean(0)}
    if (
        not acts.all()
    ):  # where tables of reference are there, what they lack may depend on the wheel alone
        found["wheel"] = acts[:, None] * powers
    if side.any():
        found["slip angle"] = side[:, None] * powers
    return {
        signal: table / np.sqrt((table**2).mean(0)).clip(_LEAST) for signal, table in found.items()
    }


def _marginal(hyper: Floats, target: Floats, jacobian: Floats, spread: _Spread) -> float:
    """Return -2 log of the density of the measurements, up to a constant.

    With the parameters integrated out (linearised).
    """
    covariance = spread.covariance(hyper) + jacobian @ jacobian.T
    factor = np.linalg.cholesky(covariance)
    pulled = np.linalg.solve(factor, target)
    return float(pulled @ pulled + 2.0 * np.log(np.diag(factor)).sum())


def _most_likely(
    target: Floats, jacobian: Floats, spread: _Spread, hyper: Floats, *, flexible: bool
) -> Floats:
    free = len(hyper) if flexible else len(ROWS)

    def cost(logs: Floats) -> float:
        return _marginal(
            np.concatenate([np.exp(logs), np.zeros(len(hyper) - free)]), target, jacobian, spread
        )

    found = minimize(
        cost, np.log(hyper[:free].clip(0.05)), method="L-BFGS-B", bounds=[(-4.0, 5.0)] * free
    )
    return np.concatenate([np.exp(found.x), np.zeros(len(hyper) - free)])


def _finished(
    model: WheelModel,
    values: Floats,
    residual: Floats,
    jacobian: Floats,
    hyper: Floats,
    spread: _Spread,
    left: tuple[str, str],
) -> Explained:
    evidence = -0.5 * _marginal(hyper, residual + jacobian @ values, jacobian, spread)
    weight = np.linalg.inv(spread.covariance(hyper))
    covariance: Floats = np.linalg.inv(jacobian.T @ weight @ jacobian + np.eye(len(values))).astype(
        np.float64
    )
    # Where a limit holds a size, the Gaussian's middle is beyond it: its mass in the range is not a
    # half.
    middle = covariance @ (jacobian.T @ (weight @ (residual + jacobian @ values)))
    held = np.minimum(values - model.low, model.high - values) < _LEAST
    middle = np.where(held, middle, values)
    sizes = _ranged(model.hypothesis, model.first)
    evidence += sum(
        _inside(middle[k], np.sqrt(covariance[k, k]), model.low[k], model.high[k]) for k in sizes
    )
    error = hyper[len(ROWS) :] * np.array(model.bed.deviations)
    return Explained(model.hypothesis, values, covariance, float(evidence), error, left)


def _ranged(hypothesis: Hypothesis, first: int) -> Sequence[int]:
    return range(first, first + hypothesis.shared().sd.shape[0])


def _inside(mean: float, sd: float, low: float, high: float) -> float:
    """Return the log of the posterior's mass in the range over the prior's."""
    after = norm.cdf((high - mean) / sd) - norm.cdf((low - mean) / sd)
    return float(np.log(max(after, 1e-6)) - np.log(norm.cdf(high) - norm.cdf(low)))
