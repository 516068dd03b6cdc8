# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole investigation of some runs: fits, verdict, and what is confusable with what."""

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from terrain_estimator.discovery.evidence.search import Candidate, Study, search
from terrain_estimator.discovery.evidence.verdict import (
    Gains,
    Judgement,
    Thresholds,
    is_pair,
    judge,
)
from terrain_estimator.discovery.hypotheses.library import Hypothesis, together
from terrain_estimator.discovery.leftover.flexible import Column
from terrain_estimator.discovery.progress import ProgressCallback


@dataclass(frozen=True, slots=True)
class Leftover:
    """The row and signal on which a discrepancy depends."""

    column: Column
    strength: float  # [1] decrease of the objective: squared standard deviations
    degrees: int  # functions of that signal


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
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
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
    study: Study, hypotheses: Sequence[Hypothesis], first: Candidate, progress: ProgressCallback
) -> list[Candidate]:
    """Return the most probable pairs of ``first`` and another effect."""
    names = set(first.hypothesis.names)
    others = [
        together(first.hypothesis, each) for each in hypotheses if not names & set(each.names)
    ]
    return search(study, others, progress, after=first) if others else []


def gains_of(
    nothing: Candidate, named: Sequence[Candidate], nothing_with: Candidate, best_with: Candidate
) -> Gains:
    """Return the numbers of the rule from fits; ``named`` the most probable first."""
    base = nothing.fit.log_evidence
    return Gains(
        tuple((each.hypothesis, each.fit.log_evidence - base) for each in named),
        nothing_with.fit.log_evidence - base,
        best_with.fit.log_evidence - base,
    )


def leftovers(candidate: Candidate) -> list[Leftover]:
    """Return the dependences of a candidate's discrepancy, the strongest first.

    Signals of one name in one row (of several axles) count as one.
    """
    if candidate.weights is None:
        return []
    first = candidate.fit.point.shared.shape[0] - len(candidate.weights.names)
    weights, covariance = (
        candidate.fit.point.shared[first:],
        candidate.fit.covariance[first:, first:],
    )
    groups: dict[Column, list[int]] = {}
    for index, column in enumerate(candidate.weights.names):
        groups.setdefault(Column(column.row, _signal(column.signal)), []).append(index)
    found = [
        Leftover(
            column,
            float(weights[index] @ torch.linalg.solve(covariance[index][:, index], weights[index])),
            len(index),
        )
        for column, index in groups.items()
    ]
    return sorted(found, key=lambda each: -each.strength)


def _signal(name: str) -> str:
    """Return ``slip`` for ``slip^2_1``: powers, axles and positions are one signal."""
    base = re.split("[_^]", name, maxsplit=1)[0]
    return "distance" if base.startswith("distance") else base
