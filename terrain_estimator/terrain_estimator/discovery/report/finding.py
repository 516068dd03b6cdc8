# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole investigation of some runs: fits, verdict, and what is confusable with what."""

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from terrain_estimator.discovery.evidence.search import (
    Foreseen,
    bettered,
    foresee,
    further,
    members,
    search,
)
from terrain_estimator.discovery.evidence.soil_revision import (
    RevisedStudy,
    revised,
    revised_alone,
)
from terrain_estimator.discovery.evidence.study import Candidate, Study
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


@dataclass(frozen=True, slots=True)
class _Singles:
    """What single effects explain of the runs of a study."""

    free: Candidate  # nothing with a discrepancy
    foreseen: list[Foreseen]
    found: list[Candidate]  # the most probable first
    best_with: Candidate  # the most probable with a discrepancy
    gains: Gains

    @property
    def left(self) -> float:
        """What the best of them leaves [nat]."""
        return self.gains.explainable - self.gains.best


@dataclass(frozen=True, slots=True)
class _Revision:
    """What was found on revised constants of the soils, in gains over nothing on those told."""

    there: RevisedStudy
    found: Finding
    alone: float  # [nat] constants alone, where they explained more than any effect; else 0
    explains: float  # [nat] constants and what is named on them

    def closes(self, gains: Gains, thresholds: Thresholds) -> bool:
        """Return whether this closes nearly all that the best effect leaves, see is_pair."""
        name = gains.single or gains.best
        left = max(gains.explainable, self.explains) - name
        return self.explains - name >= max(thresholds.anything, SECOND_SHARE * left)

    @property
    def finding(self) -> Finding:
        """The finding with these constants as a part of it."""
        judgement = besides_soil(self.found)
        return dataclasses.replace(self.found, soil=self.there, judgement=judgement)

    def weighed(self, told: Finding, thresholds: Thresholds) -> Finding:
        """Return this where it explains enough, else ``told``.

        What the constants explain is there to be explained then, too.
        """
        gains = told.gains
        if self.alone > (gains.single or gains.best):
            enough = self.explains >= thresholds.share * max(gains.explainable, self.explains)
        else:
            enough = self.closes(gains, thresholds)
        if enough and self.explains > gains.best:
            return self.finding
        gains = dataclasses.replace(gains, nothing_with=max(gains.nothing_with, self.explains))
        judgement = judge(gains, thresholds)
        chances = told.judgement.probabilities | judgement.probabilities
        judgement = dataclasses.replace(judgement, probabilities=chances)
        return dataclasses.replace(told, gains=gains, judgement=judgement)


def investigate(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> Finding:
    """Search what is missing: effects, other constants of the soils, or both.

    The constants count like an effect and are tried where the best one leaves something: alone,
    then beside it. They are the answer where they close nearly all of that, with what is found on
    them and more than a pair of effects promises. Else pairs are tried, and the constants are
    weighed again. A prior without doubt of the constants leaves them.
    """
    single = _singles(study, hypotheses, thresholds, _part(progress, 0.0, 0.3))
    doubted = study.nominal.prior.constants_sd > 0.0
    revision: _Revision | None = None
    if doubted and single.left >= thresholds.anything:
        progress(0.3, "soil constants")
        there = _promising(study, single.found[0], single.gains, thresholds)
        if there is not None:
            revision = _on_revised(study, there, hypotheses, thresholds, _part(progress, 0.35, 0.6))
            if revision.closes(single.gains, thresholds) and (
                revision.found.judgement.verdict is Verdict.NONE
                or revision.explains > _foreseen_pair(study, hypotheses, single.found[0])
            ):
                return revision.finding
    told = _completed(study, hypotheses, thresholds, single, _part(progress, 0.6, 0.8))
    first = next(each for each in told.candidates if len(each.hypothesis.effects) == 1)
    tried = revision is not None and revision.alone > (told.gains.single or told.gains.best)
    if doubted and not tried and first.hypothesis != single.found[0].hypothesis:
        there = _promising(study, first, told.gains, thresholds)
        if there is not None:
            revision = _on_revised(study, there, hypotheses, thresholds, _part(progress, 0.8, 1.0))
    return told if revision is None else revision.weighed(told, thresholds)


def _foreseen_pair(study: Study, hypotheses: Sequence[Hypothesis], first: Candidate) -> float:
    """Return the largest foreseen gain [nat] of ``first`` with another effect."""
    foreseen = foresee(study, _pairs(hypotheses, first), lambda _share, _label: None, first)
    base = study.nothing.fit.log_evidence
    return foreseen[0].log_evidence - base if foreseen else first.fit.log_evidence - base


def _promising(
    study: Study, first: Candidate, gains: Gains, thresholds: Thresholds
) -> RevisedStudy | None:
    """Return the study on constants that explain more than the best effect, or much beside it.

    ``first`` is that effect; None where it leaves nothing, or no such constants are found.
    """
    name = gains.single or gains.best
    left = gains.explainable - name
    if left < thresholds.anything:
        return None
    alone = revised_alone(study, thresholds.share * gains.explainable)
    if alone is not None and alone.gain(alone.beside, study) > name:
        return alone
    there = revised(study, first)
    least = max(thresholds.anything, PROMISING * left)
    if there is None or there.gain(there.beside, study) - name < least:
        return None
    return there


PROMISING = 0.5
"""[1] Share of what the best name leaves that revised constants explain beside it at least."""


def _part(progress: ProgressCallback, first: float, last: float) -> ProgressCallback:
    """Return the progress of a part of the work."""
    return lambda share, label: progress(first + (last - first) * share, label)


def _on_revised(
    study: Study,
    there: RevisedStudy,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> _Revision:
    """Search on revised constants, or on those that fit beside the best effect there."""
    alone = 0.0 if there.beside.hypothesis.effects else there.gain(there.beside, study)
    single = _singles(there.study, hypotheses, thresholds, _part(progress, 0.0, 0.4))
    best = single.found[0]
    something = single.gains.explainable >= thresholds.anything
    if something and best.hypothesis != there.beside.hypothesis:
        beside = _beside_effect(study, best, there, thresholds)
        if beside is not there:
            there = beside
            single = _singles(there.study, hypotheses, thresholds, _part(progress, 0.4, 0.6))
    found = _completed(there.study, hypotheses, thresholds, single, _part(progress, 0.6, 1.0))
    answer = found.nothing if found.judgement.verdict is Verdict.NONE else found.best
    return _Revision(there, found, alone, there.gain(answer, study))


def _beside_effect(
    study: Study, effect: Candidate, there: RevisedStudy, thresholds: Thresholds
) -> RevisedStudy:
    """Return the study on the constants that fit beside an effect, found on those of ``there``.

    Constants that were fitted without the effect stand in for it: they are fitted again as long as
    that gains anything. Returns ``there`` where it never does.
    """
    for _ in range(REFITS):
        found = revised(study, effect, there.study)
        if found is None:
            break
        if found.gain(found.beside, study) - there.gain(effect, study) < thresholds.anything:
            break
        there, effect = found, found.beside
    return there


REFITS = 4
"""Fits of the constants beside an effect at most."""


LEAST_BESIDE = 50.0
"""[nat] Least gain of a name on revised constants.

Constants take up most of an effect that acts like another soil, and what is left of it looks like
something else. In 24 practice cases, field_batches("0000a5a5"), names that were right gained 105
nat or more, three of four wrong ones 23 to 36.
"""


def besides_soil(found: Finding) -> Judgement:
    """Return the judgement on revised constants: nothing else is missing where it says none.

    A name that gains little is unknown.
    """
    judgement = found.judgement
    verdict = Verdict.SOIL if judgement.verdict is Verdict.NONE else judgement.verdict
    named = judgement.named
    chances = {name: p for name, p in judgement.probabilities.items() if name != "none"}
    chances |= {"none": 0.0, "soil": judgement.probabilities["none"]}
    if verdict in (Verdict.NAMED, Verdict.CONFUSABLE) and found.gains.best < LEAST_BESIDE:
        sure = {name: chances[name] for name in ("none", "soil")}
        chances = dict.fromkeys(chances, 0.0) | sure | {"unknown": 1.0 - sum(sure.values())}
        verdict, named = Verdict.UNKNOWN, named[:1]
    return Judgement(verdict, named, chances)


def _singles(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> _Singles:
    """Fit all effects that promise something."""
    progress(0.0, "nothing missing")
    free = study.with_discrepancy(study.nothing)
    foreseen = foresee(study, hypotheses, _part(progress, 0.1, 0.5))
    found = search(study, foreseen, _part(progress, 0.5, 1.0))
    base = study.nothing.fit.log_evidence
    # Where neither a name nor the discrepancy comes near to gaining anything, both together do not
    # either.
    clear = max(found[0].fit.log_evidence, free.fit.log_evidence) - base < 0.5 * thresholds.anything
    best_with = found[0] if clear else study.with_discrepancy(found[0])
    gains = gains_of(study.nothing, found, free, best_with)
    return _Singles(free, foreseen, found, best_with, gains)


def _completed(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    single: _Singles,
    progress: ProgressCallback,
) -> Finding:
    """Fit again what may explain more, pairs where the best leaves something, and judge."""
    found, gains, best_with, free = single.found, single.gains, single.best_with, single.free
    if gains.explainable - gains.best >= thresholds.anything:
        again = further(study, single.foreseen, found, _part(progress, 0.0, 0.2))
        found, first = bettered(found, again), found[0]
        if found[0] is not first:
            best_with = study.with_discrepancy(found[0])
        gains = gains_of(study.nothing, found, free, best_with)
    if gains.explainable - gains.best >= thresholds.anything:
        pairs = _beside(study, hypotheses, found[0], _part(progress, 0.2, 0.9))
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
    return Finding(judgement, gains, tuple(found), study.nothing, tuple(leftovers(best_with)))


def _beside(
    study: Study, hypotheses: Sequence[Hypothesis], first: Candidate, progress: ProgressCallback
) -> list[Candidate]:
    """Return the most probable pairs of ``first`` and another effect."""
    others = _pairs(hypotheses, first)
    if not others:
        return []
    foreseen = foresee(study, others, lambda share, label: progress(0.5 * share, label), first)
    return search(study, foreseen, lambda share, label: progress(0.5 + 0.5 * share, label), first)


def _pairs(hypotheses: Sequence[Hypothesis], first: Candidate) -> list[Hypothesis]:
    names = set(first.hypothesis.names)
    return [together(first.hypothesis, each) for each in hypotheses if not names & set(each.names)]


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
