# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fits of hypotheses to the same runs: nothing, effects, a discrepancy on top."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.fit import (
    Evaluate,
    Fit,
    fit,
    predict,
    predict_from,
)
from terrain_estimator.discovery.hypotheses.contributions import (
    Contributions,
    ContributionTask,
    here,
)
from terrain_estimator.discovery.hypotheses.equations import Equations, Query
from terrain_estimator.discovery.hypotheses.library import Hypothesis, Shared
from terrain_estimator.discovery.hypotheses.next_effect import Known, NextEffectTask
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Point, start_of
from terrain_estimator.discovery.leftover.flexible import Flexible, flexible, no_columns
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.packing import view_of
from terramechanics.terrain.soil import Soil


@dataclass(frozen=True, slots=True)
class Candidate:
    """A hypothesis and its fit to the runs."""

    hypothesis: Hypothesis
    fit: Fit
    weights: Flexible | None = None  # the discrepancy on top, where there is one

    @property
    def sizes(self) -> list[tuple[str, float, float]]:
        """Name, size and standard deviation of each effect, see :meth:`Hypothesis.sizes`."""
        return self.hypothesis.sizes(
            self.fit.point.shared.tolist(), self.fit.covariance.diagonal().sqrt().tolist()
        )


class Study:
    """Runs of one rover on one soil, and fits to them."""

    def __init__(
        self,
        nominal: Nominal,
        runs: Sequence[Blocks],
        mask: Tensor | None = None,
        contributions: Contributions | None = None,
        start: Point | None = None,
    ) -> None:
        """Take the runs; ``mask`` [R] is 1 for the rows that may be used, None for all.

        ``contributions`` computes what these runs contribute, by default here, one after the other.
        ``start`` is a point near the fit of "nothing is missing", by default the prior's mean.
        """
        self.nominal, self.runs = nominal, tuple(runs)
        self.mask = (
            torch.ones(len(nominal.row_names), dtype=torch.float64) if mask is None else mask
        )
        self.contributions = contributions or here(self.runs)
        self.none = Hypothesis((), nominal.doubt)  # nothing is missing
        self._plain = no_columns(self.runs)
        self._predicted: dict[tuple[Hypothesis, int], tuple[Candidate | None, Point, float]] = {}
        self.nothing = self._nothing(start or self.prior_mean())

    @property
    def soils(self) -> list[Soil]:
        """The soil of each run, as told."""
        return [run.soil or self.nominal.soil for run in self.runs]

    def without(self, candidate: Candidate) -> Candidate:
        """Return nothing missing where constants are held that effects of a candidate stand for."""
        none = Hypothesis((), candidate.hypothesis.doubt)
        if none == self.none:
            return self.nothing
        return self.refine(Candidate(none, self.nothing.fit))

    def gain(self, candidate: Candidate) -> float:
        """Return the gain [nat] of a candidate over nothing."""
        return candidate.fit.log_evidence - self.nothing.fit.log_evidence

    @cached_property
    def free(self) -> Candidate:
        """Nothing missing but a discrepancy without a name."""
        return self.with_discrepancy(self.nothing)

    def evaluate(self, hypothesis: Hypothesis, at: Nominal | None = None) -> Evaluate:
        """Return the equations of every run under a hypothesis, as a function of the point.

        ``at`` is another nominal model than that of the study.
        """
        task = ContributionTask(at or self.nominal, hypothesis, self.mask)
        return partial(self.contributions, task)

    @property
    def no_columns(self) -> Sequence[Tensor]:
        """Columns of a discrepancy that is not there, of every run."""
        return self._plain.columns

    def prior_mean(self) -> Point:
        """Return the prior's mean, with the velocities of the runs."""
        velocities = [velocities_of(run) for run in self.runs]
        start = start_of(velocities, self.nominal.uncertain.shape[0], self.nominal.prior)
        return start.with_shared(torch.tensor(self.none.start(), dtype=torch.float64))

    def doubting(self, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
        """Return hypotheses under which the same constants of the rover are in doubt as here."""
        return [each.doubting(self.nominal.doubt) for each in hypotheses]

    def _nothing(self, start: Point) -> Candidate:
        unknown: list[Tensor | None] = [None] * len(self.runs)
        evaluate, columns = self.evaluate(self.none), self._plain.columns
        constants = self.none.shared()
        first = fit(evaluate, start, constants, columns, unknown, most=3)
        # With columns of the soil constants from nearby an iteration takes a fifth of the time.
        settled = fit(
            evaluate,
            first.point,
            constants,
            columns,
            [each.by_constant for each in first.equations],
            most=9,
        )
        return Candidate(
            self.none, fit(evaluate, settled.point, constants, columns, unknown, most=2)
        )

    def equations_of_nothing(self) -> list[Equations]:
        """Return every run's equations at the best fit of "nothing is missing".

        Those of its Fit are a step behind.
        """
        found = self.nothing.fit
        none = torch.zeros(0, dtype=torch.float64)
        values, steps = tuple(found.point.shared.tolist()), self.none.shared().step
        queries = [
            Query(unknowns, values, none, columns, steps, before.by_constant, before.around)
            for unknowns, columns, before in zip(
                found.point.runs, self._plain.columns, found.equations, strict=True
            )
        ]
        return list(self.evaluate(self.none)(queries))

    def _start(self, hypothesis: Hypothesis, after: Candidate | None) -> Point:
        start = (after or self.nothing).fit.point
        values = torch.tensor(hypothesis.start(), dtype=torch.float64)
        values[: start.shared.shape[0]] = start.shared
        return start.with_shared(values)

    def predict(
        self, hypothesis: Hypothesis, after: Candidate | None = None
    ) -> tuple[Point, float]:
        """Predict the best fit of a hypothesis and its log evidence from one evaluation.

        Its effects are those of ``after``, by default none, and one more. The search asks twice for
        pairs: before other soils are an answer, and where they are none.
        """
        key = hypothesis, id(after)  # ``after`` is kept, so that its id stays its own
        if key not in self._predicted:
            self._predicted[key] = (after, *self._predict(hypothesis, after))
        _, point, log_evidence = self._predicted[key]
        return point, log_evidence

    def _predict(self, hypothesis: Hypothesis, after: Candidate | None) -> tuple[Point, float]:
        before, shared = (after or self.nothing).fit, hypothesis.shared()
        acting = before.origin.shared
        own = slice(len(acting), None)  # values of the one more
        if any(hypothesis.start()[own]):
            start = self._start(hypothesis, after)
            columns, known = self._plain.columns, before.equations
            found = predict(self.evaluate(hypothesis), start, shared, columns, known)
        else:
            task = NextEffectTask(self.nominal, hypothesis, shared.step[own])
            sizes = tuple(acting.tolist())
            equations = self.contributions(
                task,
                [
                    Known(unknowns, sizes, each)
                    for unknowns, each in zip(before.origin.runs, before.equations, strict=True)
                ],
            )
            start = before.origin.with_shared(torch.cat([acting, torch.zeros(len(task.steps))]))
            found = predict_from(equations, start, shared)
        return found.point, found.log_evidence

    def explain(self, hypothesis: Hypothesis, after: Candidate | None = None) -> Candidate:
        """Fit a hypothesis from nothing, or from a candidate whose effects come first in it."""
        return self.fit_from(hypothesis, self._start(hypothesis, after))

    def fit_from(self, hypothesis: Hypothesis, start: Point, *, most: int = 8) -> Candidate:
        """Fit a hypothesis from ``start`` with the columns of the soil constants of nothing."""
        known = [each.by_constant for each in self.nothing.fit.equations]
        found = fit(
            self.evaluate(hypothesis),
            start,
            hypothesis.shared(),
            self._plain.columns,
            known,
            most=most,
            daring=DARING,
        )
        return Candidate(hypothesis, found)

    def given(self, hypothesis: Hypothesis, values: Tensor) -> Candidate:
        """Fit the runs' own unknowns at shared ones that other runs gave.

        ``values`` as ``Fit.point.shared``.
        """
        first = self._held(hypothesis, values, most=9)
        evaluate, columns = self.evaluate(hypothesis), self._plain.columns
        unknown: list[Tensor | None] = [None] * len(self.runs)
        pinned = _pinned(hypothesis, values)
        return Candidate(hypothesis, fit(evaluate, first.point, pinned, columns, unknown, most=3))

    def _held(
        self, hypothesis: Hypothesis, values: Tensor, most: int, after: Candidate | None = None
    ) -> Fit:
        start = (after or self.nothing).fit.point.with_shared(values)
        known = [each.by_constant for each in self.nothing.fit.equations]
        columns = self._plain.columns
        pinned = _pinned(hypothesis, values)
        return fit(self.evaluate(hypothesis), start, pinned, columns, known, most=most)

    def predict_at(
        self, hypothesis: Hypothesis, values: Tensor, after: Candidate | None = None
    ) -> float:
        """Predict the gain [nat] over nothing of a hypothesis with these values, held there.

        The runs' own unknowns come from ``after``, by default from nothing.
        """
        before = (after or self.nothing).fit
        found = predict(
            self.evaluate(hypothesis),
            before.point.with_shared(values),
            _pinned(hypothesis, values),
            self._plain.columns,
            before.equations,
        )
        return found.given - self.nothing.fit.given

    def explain_from(
        self, hypothesis: Hypothesis, values: Tensor, after: Candidate | None = None
    ) -> Candidate:
        """Fit a hypothesis from these values, to which the runs' own unknowns were fitted first.

        They come from ``after``, by default from nothing.
        """
        return self.fit_from(hypothesis, self._held(hypothesis, values, most=5, after=after).point)

    def refine(self, candidate: Candidate, *, most: int = 8) -> Candidate:
        """Fit a candidate until nothing moves, with its own columns of the soil constants.

        A run whose ground ends IMPROBABLY far from the prior may be in another minimum, where a fit
        without the effect had led it: it is also begun anew at the prior's mean, and the better fit
        is kept.
        """
        found = self._settled(candidate.hypothesis, candidate.fit.point, most)
        anew = _from_prior(found.point)
        if anew is not found.point:
            again = self._settled(candidate.hypothesis, anew, 2 * most)
            found = max(found, again, key=lambda each: each.log_evidence)
        return dataclasses.replace(candidate, fit=found)

    def _settled(self, hypothesis: Hypothesis, start: Point, most: int) -> Fit:
        unknown: list[Tensor | None] = [None] * len(self.runs)
        evaluate, sizes = self.evaluate(hypothesis), hypothesis.shared()
        return fit(evaluate, start, sizes, self._plain.columns, unknown, most=most)

    def with_discrepancy(self, candidate: Candidate) -> Candidate:
        """Return a candidate with a flexible discrepancy on top.

        The spread of its weights, row by row, is the most likely one.

        The rows are exactly linear in the weights and in c and tan phi, so that one evaluation
        does: it is within 3 nat of a fit to the end, in a third of the time.
        """
        weights = flexible(self.runs)
        sizes, first = candidate.hypothesis.shared(), candidate.fit.point.shared.shape[0]
        rows = self.nominal.row_names
        row_of = torch.tensor([rows.index(column.row) for column in weights.names])
        spread = _first_spread(candidate.fit, len(rows))[row_of]
        point = candidate.fit.point.with_shared(
            torch.cat([candidate.fit.point.shared, torch.zeros_like(spread)])
        )
        shared = Shared(sizes.low, sizes.high, torch.cat([sizes.sd, spread]), sizes.step)

        def spreads(values: Tensor, variances: Tensor) -> Tensor:
            return torch.cat(
                [sizes.sd, _spread(values[first:].square() + variances[first:], row_of)]
            )

        found = predict(
            self.evaluate(candidate.hypothesis),
            point,
            shared,
            weights.columns,
            candidate.fit.equations,
            spreads,
        )
        return Candidate(candidate.hypothesis, found, weights)


DARING = 5
"""First steps of a hypothesis' fit that are made even where they fit worse.

Far from the ground that suits an effect, shorter steps end in a corner: for lugs on drives whose
soil was another a fit stopped at a third of what it gains by five whole steps.
"""
IMPROBABLE = 3.0
"""[1] Prior deviations of c or tan phi beyond which a run is fitted anew from the prior's mean."""


def _from_prior(point: Point) -> Point:
    """Return a point whose improbable grounds are at the prior's mean; the same if none is."""
    runs = []
    for own in point.runs:
        mean, precision = own.prior_moments()
        ground = 2 + own.kappa.shape[0]
        off = ((own.flat() - mean).square() * precision)[:2].amax()
        back = torch.zeros_like(mean)
        back[:ground] = (mean - own.flat())[:ground]
        runs.append(own.moved(back) if off > IMPROBABLE**2 else own)
    changed = any(after is not before for after, before in zip(runs, point.runs, strict=True))
    return dataclasses.replace(point, runs=tuple(runs)) if changed else point


def _pinned(hypothesis: Hypothesis, values: Tensor) -> Shared:
    """Return shared unknowns that cannot leave these values: a range without width."""
    free = hypothesis.shared()
    return Shared(values, values, free.sd, free.step)


def _spread(power: Tensor, row_of: Tensor) -> Tensor:
    """Return the deviation of each weight: root mean square over the weights of its row."""
    total = torch.zeros(int(row_of.max()) + 1, dtype=torch.float64).index_add_(0, row_of, power)
    return (total / torch.bincount(row_of)).sqrt()[row_of].clamp(min=1e-9)


def _first_spread(found: Fit, rows: int) -> Tensor:
    """Return first deviations [R] of the weights of a row, from the unexplained variance there."""
    excess = torch.stack([each.excess for each in found.equations]).mean(0)
    noise = torch.stack(
        [
            (each.factor @ each.factor.transpose(1, 2)).diagonal(dim1=1, dim2=2).mean(0)
            for each in found.equations
        ]
    ).mean(0)
    per_row = (excess + 0.01 * noise)[1:].clone()
    return (per_row / rows).sqrt()


def velocities_of(run: Blocks) -> Tensor:
    """Return first velocities [V] [m/s] at the joints of a run's blocks."""
    velocity = torch.zeros(run.velocities, dtype=torch.float64)
    mean = view_of(run.packed, run.wheel_rate.shape[-1]).velocity.mean(1)
    velocity[run.ends[:, 0]] = mean
    velocity[run.ends[:, 1]] = mean
    return velocity
