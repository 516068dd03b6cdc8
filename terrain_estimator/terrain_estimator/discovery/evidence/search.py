# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fits of every hypothesis to the same runs: nothing, single effects, pairs, a discrepancy."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.fit import Evaluate, Fit, fit, predict
from terrain_estimator.discovery.hypotheses.contributions import (
    Contributions,
    ContributionTask,
    here,
)
from terrain_estimator.discovery.hypotheses.equations import Equations, Query
from terrain_estimator.discovery.hypotheses.library import NOTHING, Hypothesis, Shared
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Point, start_of
from terrain_estimator.discovery.leftover.flexible import Flexible, flexible, no_columns
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.row_names import row_names


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
    ) -> None:
        """Take the runs; ``mask`` [R] is 1 for the rows that may be used, None for all.

        ``contributions`` computes what these runs contribute, by default here, one after the other.
        """
        self.nominal, self.runs = nominal, tuple(runs)
        self.mask = (
            torch.ones(len(row_names(nominal.rover.axles)), dtype=torch.float64)
            if mask is None
            else mask
        )
        self.contributions = contributions or here(self.runs)
        self._plain = no_columns(self.runs)
        self.nothing = self._nothing()

    def _evaluate(self, hypothesis: Hypothesis) -> Evaluate:
        return partial(self.contributions, ContributionTask(self.nominal, hypothesis, self.mask))

    def _nothing(self) -> Candidate:
        velocities = [velocities_of(run) for run in self.runs]
        start = start_of(velocities, self.nominal.uncertain.shape[0], self.nominal.prior)
        unknown: list[Tensor | None] = [None] * len(self.runs)
        evaluate, columns = self._evaluate(NOTHING), self._plain.columns
        first = fit(evaluate, start, NOTHING.shared(), columns, unknown, most=3)
        # With columns of the soil constants from nearby an iteration takes a fifth of the time.
        settled = fit(
            evaluate,
            first.point,
            NOTHING.shared(),
            columns,
            [each.by_constant for each in first.equations],
            most=9,
        )
        return Candidate(
            NOTHING, fit(evaluate, settled.point, NOTHING.shared(), columns, unknown, most=2)
        )

    def equations_of_nothing(self) -> list[Equations]:
        """Return every run's equations at the best fit of "nothing is missing".

        Those of its Fit are a step behind.
        """
        found = self.nothing.fit
        none = torch.zeros(0, dtype=torch.float64)
        queries = [
            Query(unknowns, (), none, columns, (), before.by_constant, before.around)
            for unknowns, columns, before in zip(
                found.point.runs, self._plain.columns, found.equations, strict=True
            )
        ]
        return list(self._evaluate(NOTHING)(queries))

    def _start(self, hypothesis: Hypothesis, after: Candidate | None) -> Point:
        start = (after or self.nothing).fit.point
        values = torch.tensor(hypothesis.start(), dtype=torch.float64)
        values[: start.shared.shape[0]] = start.shared
        return start.with_shared(values)

    def predict(
        self, hypothesis: Hypothesis, after: Candidate | None = None
    ) -> tuple[Point, float]:
        """Predict the best fit of a hypothesis and its log evidence from one evaluation."""
        before = (after or self.nothing).fit
        start = self._start(hypothesis, after)
        found = predict(
            self._evaluate(hypothesis),
            start,
            hypothesis.shared(),
            self._plain.columns,
            before.equations,
        )
        return found.point, found.log_evidence

    def explain(self, hypothesis: Hypothesis, after: Candidate | None = None) -> Candidate:
        """Fit a hypothesis from nothing, or from a candidate whose effects come first in it."""
        return self.fit_from(hypothesis, self._start(hypothesis, after))

    def fit_from(self, hypothesis: Hypothesis, start: Point, *, most: int = 8) -> Candidate:
        """Fit a hypothesis from ``start`` with the columns of the soil constants of nothing."""
        known = [each.by_constant for each in self.nothing.fit.equations]
        found = fit(
            self._evaluate(hypothesis),
            start,
            hypothesis.shared(),
            self._plain.columns,
            known,
            most=most,
        )
        return Candidate(hypothesis, found)

    def given(self, hypothesis: Hypothesis, values: Tensor) -> Candidate:
        """Fit the runs' own unknowns at shared ones that other runs gave.

        ``values`` as ``Fit.point.shared``.
        """
        first = self._held(hypothesis, values, most=9)
        evaluate, columns = self._evaluate(hypothesis), self._plain.columns
        unknown: list[Tensor | None] = [None] * len(self.runs)
        pinned = _pinned(hypothesis, values)
        return Candidate(hypothesis, fit(evaluate, first.point, pinned, columns, unknown, most=3))

    def _held(self, hypothesis: Hypothesis, values: Tensor, most: int) -> Fit:
        start = self.nothing.fit.point.with_shared(values)
        known = [each.by_constant for each in self.nothing.fit.equations]
        columns = self._plain.columns
        pinned = _pinned(hypothesis, values)
        return fit(self._evaluate(hypothesis), start, pinned, columns, known, most=most)

    def predict_at(self, hypothesis: Hypothesis, values: Tensor) -> float:
        """Predict the gain [nat] over nothing of a hypothesis with these values, held there."""
        nothing = self.nothing.fit
        found = predict(
            self._evaluate(hypothesis),
            nothing.point.with_shared(values),
            _pinned(hypothesis, values),
            self._plain.columns,
            nothing.equations,
        )
        return found.given - nothing.given

    def explain_from(self, hypothesis: Hypothesis, values: Tensor) -> Candidate:
        """Fit a hypothesis from these values, to which the runs' own unknowns were fitted first."""
        return self.fit_from(hypothesis, self._held(hypothesis, values, most=5).point)

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
        evaluate, sizes = self._evaluate(hypothesis), hypothesis.shared()
        return fit(evaluate, start, sizes, self._plain.columns, unknown, most=most)

    def with_discrepancy(self, candidate: Candidate) -> Candidate:
        """Return a candidate with a flexible discrepancy on top.

        The spread of its weights, row by row, is the most likely one.

        The rows are exactly linear in the weights and in c and tan phi, so that one evaluation
        does: it is within 3 nat of a fit to the end, in a third of the time.
        """
        weights = flexible(self.runs)
        sizes, first = candidate.hypothesis.shared(), candidate.fit.point.shared.shape[0]
        rows = row_names(self.nominal.rover.axles)
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
            self._evaluate(candidate.hypothesis),
            point,
            shared,
            weights.columns,
            candidate.fit.equations,
            spreads,
        )
        return Candidate(candidate.hypothesis, found, weights)


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


FITTED, REFINED = 5, 2
"""Hypotheses that are fitted in full at most, and those that are fitted until nothing moves."""
PROMISING = 0.25
"""[1] Share of the largest foreseen gain below which a hypothesis is not fitted."""
RIVAL = 0.7
"""[1] Share of the best's gain below which another hypothesis is no rival and is not refined."""
WORTHLESS = 2.0
"""[nat] Largest predicted gain of hypotheses that explain nothing: then only the best is fitted."""


@dataclass(frozen=True, slots=True)
class Foreseen:
    """The best fit of a hypothesis that one evaluation predicts."""

    hypothesis: Hypothesis
    point: Point
    log_evidence: float


def foresee(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    progress: ProgressCallback,
    after: Candidate | None = None,
) -> list[Foreseen]:
    """Return what one evaluation predicts of each hypothesis, the most probable first.

    ``after`` is a candidate whose effects come first in all of them.
    """
    found = []
    for number, hypothesis in enumerate(hypotheses):
        progress(number / len(hypotheses), hypothesis.label)
        found.append(Foreseen(hypothesis, *study.predict(hypothesis, after)))
    return sorted(found, key=lambda each: -each.log_evidence)


def search(
    study: Study,
    foreseen: Sequence[Foreseen],
    progress: ProgressCallback,
    after: Candidate | None = None,
) -> list[Candidate]:
    """Fit the hypotheses of which something is foreseen; return them, the most probable first.

    ``after`` is as in :func:`foresee`.
    """
    base = (after or study.nothing).fit.log_evidence
    gain = foreseen[0].log_evidence - base
    best = [
        each
        for each in foreseen[:FITTED]
        if each.log_evidence - base > max(PROMISING * gain, WORTHLESS)
    ] or foreseen[:1]
    candidates = []
    for number, each in enumerate(best):
        progress(number / len(best), each.hypothesis.label)
        candidates.append(study.fit_from(each.hypothesis, each.point))
    return _refined(study, ranked(candidates), base)


def further(
    study: Study,
    foreseen: Sequence[Foreseen],
    found: Sequence[Candidate],
    progress: ProgressCallback,
) -> list[Candidate]:
    """Fit hypotheses again that explain more at a size that matters than was foreseen or found.

    One evaluation near nothing says little of a law that is far from linear, such as multipass. At
    its typical size, doubled as long as that gains, another one does. Effects with two signs are
    nearly linear and are not looked at.
    """
    base, again = study.nothing.fit.log_evidence, []
    known = {each.hypothesis: each.log_evidence - base for each in foreseen}
    known |= {each.hypothesis: each.fit.log_evidence - base for each in found}
    for number, (hypothesis, gain) in enumerate(known.items()):
        progress(number / len(known), hypothesis.label)
        if float(hypothesis.shared().low[0]) < 0.0:
            continue
        values, there = _best_multiple(study, hypothesis)
        if there > max(gain + WORTHLESS, PROMISING * (found[0].fit.log_evidence - base)):
            again.append(study.refine(study.explain_from(hypothesis, values)))
    return again


def _best_multiple(study: Study, hypothesis: Hypothesis) -> tuple[Tensor, float]:
    """Return the multiple of the typical size that explains most, and its gain [nat]."""
    high = float(hypothesis.shared().high[0])
    values = torch.tensor(hypothesis.typical(), dtype=torch.float64)
    gain = study.predict_at(hypothesis, values)
    while gain > 0.0 and values[0] < high:
        double = values.clone()
        double[0] = min(2.0 * float(values[0]), high)
        more = study.predict_at(hypothesis, double)
        if more <= gain:
            break
        values, gain = double, more
    return values, gain


def _refined(study: Study, candidates: list[Candidate], base: float) -> list[Candidate]:
    """Fit the best and its rivals until nothing moves, where they gain anything over ``base``."""
    enough = RIVAL * (candidates[0].fit.log_evidence - base)
    rivals = [
        each
        for each in candidates[:REFINED]
        if each.fit.log_evidence - base > max(enough, WORTHLESS)
    ]
    return ranked([study.refine(each) for each in rivals] + candidates[len(rivals) :])


def members(study: Study, pair: Candidate) -> list[Candidate]:
    """Return each effect of a pair alone, fitted from the pair's point.

    A fit that begins with nothing may stop far from the best one, and the pair has found a way
    there: where one of its effects has no size, the other one alone explains as much.
    """
    found, at = [], 0
    for effect in pair.hypothesis.effects:
        values = pair.fit.point.shared[at : at + effect.count]
        alone = study.fit_from(Hypothesis((effect,)), pair.fit.point.with_shared(values))
        found.append(study.refine(alone))
        at += effect.count
    return found


def bettered(before: Sequence[Candidate], more: Sequence[Candidate]) -> list[Candidate]:
    """Return the better fit of every hypothesis, the most probable first."""
    best: dict[Hypothesis, Candidate] = {}
    for each in ranked([*before, *more]):
        best.setdefault(each.hypothesis, each)
    return list(best.values())


def ranked(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Sort candidates, the most probable first."""
    return sorted(candidates, key=lambda each: -each.fit.log_evidence)
