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
from terrain_estimator.model.rows import row_names


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
        free = hypothesis.shared()
        pinned = Shared(values, values, free.sd, free.step)  # a range without width
        start = self.nothing.fit.point.with_shared(values)
        evaluate, columns = self._evaluate(hypothesis), self._plain.columns
        known = [each.by_constant for each in self.nothing.fit.equations]
        first = fit(evaluate, start, pinned, columns, known, most=9)
        unknown: list[Tensor | None] = [None] * len(self.runs)
        return Candidate(hypothesis, fit(evaluate, first.point, pinned, columns, unknown, most=3))

    def refine(self, candidate: Candidate, *, most: int = 8) -> Candidate:
        """Fit a candidate until nothing moves, with its own columns of the soil constants."""
        evaluate, sizes = self._evaluate(candidate.hypothesis), candidate.hypothesis.shared()
        unknown: list[Tensor | None] = [None] * len(self.runs)
        found = fit(evaluate, candidate.fit.point, sizes, self._plain.columns, unknown, most=most)
        return dataclasses.replace(candidate, fit=found)

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
"""[1] Share of the largest gain that is predicted below which a hypothesis is not fitted."""
RIVAL = 0.7
"""[1] Share of the best's gain below which another hypothesis is no rival and is not refined."""
WORTHLESS = 2.0
"""[nat] Largest predicted gain of hypotheses that explain nothing: then only the best is fitted."""


def search(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    progress: ProgressCallback,
    after: Candidate | None = None,
) -> list[Candidate]:
    """Return the most probable hypotheses, best first.

    ``after`` is a candidate whose effects come first in all of them.

    What one evaluation predicts of each decides which are fitted.
    """
    predicted = []
    for number, hypothesis in enumerate(hypotheses):
        progress(0.5 * number / len(hypotheses), hypothesis.label)
        predicted.append((*study.predict(hypothesis, after), hypothesis))
    predicted.sort(key=lambda each: -each[1])
    base = (after or study.nothing).fit.log_evidence
    gain = predicted[0][1] - base
    best = [
        each for each in predicted[:FITTED] if each[1] - base > max(PROMISING * gain, WORTHLESS)
    ] or predicted[:1]
    candidates = []
    for number, (point, _, hypothesis) in enumerate(best):
        progress(0.5 + 0.5 * number / len(best), hypothesis.label)
        candidates.append(study.fit_from(hypothesis, point))
    return _refined(study, ranked(candidates), base)


def _refined(study: Study, candidates: list[Candidate], base: float) -> list[Candidate]:
    """Fit the best and its rivals until nothing moves, where they gain anything over ``base``."""
    enough = RIVAL * (candidates[0].fit.log_evidence - base)
    rivals = [
        each
        for each in candidates[:REFINED]
        if each.fit.log_evidence - base > max(enough, WORTHLESS)
    ]
    return ranked([study.refine(each) for each in rivals] + candidates[len(rivals) :])


def ranked(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Sort candidates, the most probable first."""
    return sorted(candidates, key=lambda each: -each.fit.log_evidence)
