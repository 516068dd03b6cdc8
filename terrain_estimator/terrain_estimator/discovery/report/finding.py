# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole investigation of some runs: fits, verdict, and what is confusable with what."""

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from terrain_estimator.discovery.evidence.search import (
    Candidate,
    Study,
    bettered,
    foresee,
    further,
    members,
    search,
)
from terrain_estimator.discovery.evidence.soil_revision import RevisedStudy, revised
from terrain_estimator.discovery.evidence.verdict import (
    SECOND_SHARE,
    Gains,
    Judgement,
    Thresholds,
    Verdict,
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
    soil: RevisedStudy | None = None  # on which all this was found, where the soil files do not fit

    def study(self, told: Study) -> Study:
        """Return the study in which the fits were made; ``told`` has the soils of the files."""
        return told if self.soil is None else self.soil.study

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
    """Search what is missing: effects, other constants of the soils, or both.

    The constants count like an effect. Where they explain more than any name, the search begins
    anew on the constants found, and its verdict holds if they close the ``share``; else they are
    the second of a pair, see :func:`is_pair`. A prior without doubt of the constants leaves them.
    """
    told = _searched(
        study, hypotheses, thresholds, lambda share, label: progress(0.5 * share, label)
    )
    if told.judgement.verdict is Verdict.NONE or study.nominal.prior.constants_sd == 0.0:
        return told
    progress(0.5, "soil constants")
    name = told.gains.single or told.gains.best
    left = told.gains.explainable - name
    there = revised(study, study.nominal)
    alone = there is not None and there.gain(there.study.nothing, study) > name
    if not alone:
        if left < thresholds.anything:
            return told
        first = next(each for each in told.candidates if len(each.hypothesis.effects) == 1)
        there = revised(study, study.nominal, first.hypothesis)
        if there is None:
            return told
        gained = there.gain(there.study.explain(first.hypothesis), study) - name
        if gained < max(thresholds.anything, PROMISING * left):
            return told
    assert there is not None
    found, there = _on_revised(
        study,
        there,
        hypotheses,
        thresholds,
        lambda share, label: progress(0.55 + 0.4 * share, label),
    )
    explains = there.gain(_answer(found), study)
    explainable = max(told.gains.explainable, explains)
    if alone:
        accepted = explains >= thresholds.share * explainable
    else:
        needed = max(thresholds.anything, SECOND_SHARE * (explainable - name))
        accepted = explains - name >= needed and explains > told.gains.best
    if accepted:
        return dataclasses.replace(found, soil=there, judgement=_besides_soil(found.judgement))
    # What the constants explain is there to be explained, too.
    gains = dataclasses.replace(told.gains, nothing_with=max(told.gains.nothing_with, explains))
    chances = told.judgement.probabilities | judge(gains, thresholds).probabilities
    judgement = dataclasses.replace(judge(gains, thresholds), probabilities=chances)
    return dataclasses.replace(told, gains=gains, judgement=judgement)


PROMISING = 0.5
"""[1] Share of what the best name leaves that revised constants explain beside it at least."""


def _on_revised(
    study: Study,
    there: RevisedStudy,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> tuple[Finding, RevisedStudy]:
    """Search on revised constants, and again on those that fit beside the best name."""
    found = _searched(
        there.study, hypotheses, thresholds, lambda share, label: progress(0.5 * share, label)
    )
    if found.judgement.verdict is Verdict.NONE:
        return found, there
    beside = revised(there.study, study.nominal, found.best.hypothesis)
    if beside is None:
        return found, there
    again = beside.study.refine(beside.study.explain(found.best.hypothesis))
    if beside.gain(again, study) - there.gain(found.best, study) < thresholds.anything:
        return found, there
    return _searched(
        beside.study,
        hypotheses,
        thresholds,
        lambda share, label: progress(0.5 + 0.5 * share, label),
    ), beside


def _answer(found: Finding) -> Candidate:
    return found.nothing if found.judgement.verdict is Verdict.NONE else found.best


def _besides_soil(judgement: Judgement) -> Judgement:
    """Return a judgement on revised constants: nothing else is missing where it says none."""
    verdict = Verdict.SOIL if judgement.verdict is Verdict.NONE else judgement.verdict
    chances = {name: p for name, p in judgement.probabilities.items() if name != "none"}
    chances |= {"none": 0.0, "soil": judgement.probabilities["none"]}
    return dataclasses.replace(judgement, verdict=verdict, probabilities=chances)


def _searched(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> Finding:
    """Fit all hypotheses, pairs with the best one where it leaves something, and judge."""
    progress(0.05, "nothing missing")
    free = study.with_discrepancy(study.nothing)
    foreseen = foresee(study, hypotheses, lambda share, label: progress(0.1 + 0.2 * share, label))
    found = search(study, foreseen, lambda share, label: progress(0.3 + 0.2 * share, label))
    base = study.nothing.fit.log_evidence
    # Where neither a name nor the discrepancy comes near to gaining anything, both together do not
    # either.
    clear = max(found[0].fit.log_evidence, free.fit.log_evidence) - base < 0.5 * thresholds.anything
    best_with = found[0] if clear else study.with_discrepancy(found[0])
    gains = gains_of(study.nothing, found, free, best_with)
    if gains.explainable - gains.best >= thresholds.anything:
        again = further(
            study, foreseen, found, lambda share, label: progress(0.5 + 0.1 * share, label)
        )
        found, first = bettered(found, again), found[0]
        if found[0] is not first:
            best_with = study.with_discrepancy(found[0])
        gains = gains_of(study.nothing, found, free, best_with)
    if gains.explainable - gains.best >= thresholds.anything:
        pairs = _beside(
            study, hypotheses, found[0], lambda share, label: progress(0.6 + 0.35 * share, label)
        )
        if pairs:
            alone = bettered(found, members(study, pairs[0]))
            if alone[0] is not found[0]:
                best_with = study.with_discrepancy(alone[0])
            found, gains = alone, gains_of(study.nothing, alone, free, best_with)
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
    if not others:
        return []
    foreseen = foresee(study, others, lambda share, label: progress(0.5 * share, label), first)
    return search(study, foreseen, lambda share, label: progress(0.5 + 0.5 * share, label), first)


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
