# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole investigation of some runs: fits, verdict, and what is confusable with what."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

from terrain_estimator.discovery.evidence.search import Candidate, Progress, Study, search
from terrain_estimator.discovery.evidence.verdict import (
    Gains,
    Judgement,
    Leftover,
    Thresholds,
    gains_of,
    is_pair,
    judge,
    leftovers,
)
from terrain_estimator.discovery.hypotheses.library import Hypothesis, together


@dataclass(frozen=True, slots=True)
class Finding:
    """The answer of some runs."""

    judgement: Judgement
    gains: Gains
    candidates: tuple[Candidate, ...]  # named hypotheses, the most probable first
    nothing: Candidate
    left: tuple[Leftover, ...]  # on what the residual of the best name depends, strongest first

    @property
    def best(self) -> Candidate:
        """The most probable named hypothesis."""
        return self.candidates[0]

    def candidate(self, hypothesis: Hypothesis) -> Candidate:
        """Return the fit of that hypothesis."""
        return next(each for each in self.candidates if each.hypothesis == hypothesis)


def investigate(
    study: Study, hypotheses: Sequence[Hypothesis], thresholds: Thresholds, progress: Progress
) -> Finding:
    """Fit all hypotheses, pairs with the best one where it leaves something, and judge."""
    progress(0.05, "nothing missing")
    free = study.with_discrepancy(study.nothing)
    found = search(study, hypotheses, lambda share, label: progress(0.1 + 0.5 * share, label))
    base = study.nothing.fit.log_evidence
    # Where neither a name nor the discrepancy comes near to gaining anything, both together do not
    # either.
    clear = max(found[0].fit.log_evidence, free.fit.log_evidence) - base < 0.5 * thresholds.anything
    best_with = found[0] if clear else study.with_discrepancy(found[0])
    gains = gains_of(study.nothing, found, free, best_with)
    if gains.explainable - gains.best >= thresholds.anything:
        pairs = _beside(
            study, hypotheses, found[0], lambda share, label: progress(0.6 + 0.35 * share, label)
        )
        if pairs:
            pair_with = study.with_discrepancy(pairs[0])
            paired = dataclasses.replace(
                gains_of(study.nothing, pairs, free, pair_with), single=gains.best
            )
            if is_pair(gains, paired, thresholds):
                found, gains, best_with = [*pairs, *found], paired, pair_with
    judgement = judge(gains, thresholds)
    # What one evaluation already showed to be far behind was not fitted.
    unlikely = {name: 0.0 for hypothesis in hypotheses for name in hypothesis.names}
    judgement = dataclasses.replace(judgement, probabilities=unlikely | judgement.probabilities)
    return Finding(
        judgement,
        gains,
        tuple(found),
        study.nothing,
        tuple(leftovers(best_with)),
    )


def _beside(
    study: Study, hypotheses: Sequence[Hypothesis], first: Candidate, progress: Progress
) -> list[Candidate]:
    """Return the most probable pairs of ``first`` and another effect."""
    names = set(first.hypothesis.names)
    others = [
        together(first.hypothesis, each) for each in hypotheses if not names & set(each.names)
    ]
    return search(study, others, progress, after=first) if others else []
