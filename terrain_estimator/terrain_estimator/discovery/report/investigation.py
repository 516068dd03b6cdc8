# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The whole investigation of some runs: missing effects and other soils, which compete."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from terrain_estimator.discovery.evidence.other_soils import on_other_soil
from terrain_estimator.discovery.evidence.search import foresee
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
    judge,
)
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rover_doubt import (
    STANDS_FOR,
    STEP,
    WITHIN,
    is_within,
)
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.report.finding import (
    Finding,
    Singles,
    complete,
    explain_singly,
    pairs_with,
    part_of,
)
from terramechanics.terrain.soil import Soil

_Start = tuple[Candidate, Study]
"""An effect and the study, on some soils, in which it was fitted."""


@dataclass(frozen=True, slots=True)
class _Revision:
    """What was found on other soils, in gains over nothing on those told."""

    there: RevisedStudy
    found: Finding
    alone: float  # [nat] soils without an effect; 0 where constants alone promise too little
    explains: float  # [nat] the soils and what is named on them

    @property
    def effects(self) -> int:
        """The number of effects in the answer beside the soils."""
        return len(self.found.answer.hypothesis.effects)

    @property
    def is_named(self) -> bool:
        """Whether these effects are named, and not only the closest."""
        return self.finding.judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)

    @property
    def single(self) -> Candidate:
        """The most probable single effect on these soils."""
        return _single(self.found)

    def closes(self, gains: Gains, thresholds: Thresholds) -> bool:
        """Return whether this closes nearly all that the best effect leaves."""
        name = gains.single or gains.best
        left = max(gains.explainable, self.explains) - name
        return self.explains - name >= max(thresholds.anything, SECOND_SHARE * left)

    @property
    def finding(self) -> Finding:
        """The finding with these soils as a part of it."""
        judgement = besides_soil(self.found, 0.0 if self.there.of_files else LEAST_BESIDE)
        return dataclasses.replace(self.found, soil=self.there, judgement=judgement)

    def suffices(self, gains: Gains, thresholds: Thresholds) -> bool:
        """Return whether this explains enough beside what a pair of effects explains."""
        if self.alone > (gains.single or gains.best):
            return self.explains >= thresholds.share * gains.explainable
        return self.closes(gains, thresholds)


def investigate(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
    soils: Sequence[Soil] = (),
) -> Finding:
    """Search what is missing: effects, another soil, or both; see :func:`or_beyond` for a rover.

    Other soils count like an effect and are tried where the best effect leaves something, or where
    constants alone explain more: those of files at hand, ``soils``, then constants that are fitted,
    alone, beside the effect, and beside the best one on another file. On ground between two files
    an effect may look missing on either. They are the answer where they close nearly all of what
    the best effect leaves, with what is found on them and more than a pair of effects promises.
    Else pairs are tried, and the soils are weighed again. A prior without doubt of the constants
    leaves them.
    """
    hypotheses = study.doubting(hypotheses)
    found = _investigated(study, hypotheses, thresholds, progress, soils)
    return or_beyond(found, study, hypotheses, thresholds)


def _investigated(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
    soils: Sequence[Soil],
) -> Finding:
    single = explain_singly(study, hypotheses, thresholds, part_of(progress, 0.0, 0.2))
    if not _is_in_doubt(study, single, thresholds):
        return complete(study, hypotheses, thresholds, single, part_of(progress, 0.2, 1.0))
    promised: float | None = None  # by a pair
    tried, answers = list[_Revision](), list[_Revision]()
    starts = [(single.found[0], study)]
    for revise in (
        partial(_on_file, soils=soils, progress=part_of(progress, 0.2, 0.4)),
        partial(_on_constants, progress=part_of(progress, 0.4, 0.6)),
    ):
        revision = revise(study, hypotheses, thresholds, starts, single.gains)
        if revision is None:
            continue
        tried.append(revision)
        starts.append((revision.single, revision.there.study))
        if not revision.closes(single.gains, thresholds):
            continue
        if revision.found.judgement.verdict is Verdict.NONE:
            answers.append(revision)
            break
        if promised is None:
            promised = _foreseen_pair(study, hypotheses, single.found[0])
        if revision.explains > promised:
            answers.append(revision)
    if answers:
        return _preferred(answers, thresholds).finding
    told = complete(study, hypotheses, thresholds, single, part_of(progress, 0.6, 0.8))
    first = _single(told)
    alone = any(each.alone > (told.gains.single or told.gains.best) for each in tried)
    left = told.gains.explainable - (told.gains.single or told.gains.best)
    if left >= thresholds.anything and not alone and first.hypothesis != single.found[0].hypothesis:
        last = part_of(progress, 0.8, 1.0)
        starts = [(first, study)]
        again = _on_constants(study, hypotheses, thresholds, starts, told.gains, progress=last)
        tried += [again] if again else []
    return _weighed(told, tried, thresholds)


def investigate_as_told(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
    explained: float,
) -> Finding:
    """Search which effects are missing on the soils as told, without others.

    ``explained`` [nat] is what other soils explain with what is named on them, over nothing on
    those told: so much is there to be explained.
    """
    hypotheses = study.doubting(hypotheses)
    single = explain_singly(study, hypotheses, thresholds, part_of(progress, 0.0, 0.4))
    told = complete(study, hypotheses, thresholds, single, part_of(progress, 0.4, 1.0))
    found = _beside_others(told, explained, thresholds)
    return or_beyond(found, study, hypotheses, thresholds)


def or_beyond(
    found: Finding, study: Study, hypotheses: Sequence[Hypothesis], thresholds: Thresholds
) -> Finding:
    """Return the finding, or the effect that stands for a constant beyond its stated deviation.

    Where nothing else is missing and the runs move a constant of the rover to the end of what its
    deviation allows, its file is wrong or something stands for it. Such an effect is named where
    with it the runs are ``anything`` likelier than with the constant at that end. That something is
    there is no question then, so that the size pays nothing for its wide prior. ``study`` is on the
    soils as told.
    """
    if found.judgement.verdict not in (Verdict.NONE, Verdict.SOIL):
        return found
    there = found.study(study)
    names = [name for name, each in STANDS_FOR.items() if each in _at_the_end(there.nothing)]
    tried = [
        there.refine(there.explain(each))
        for each in hypotheses
        if len(each.names) == 1 and each.names[0] in names
    ]
    if not tried:
        return found
    best = max(tried, key=lambda each: each.fit.given)
    if best.fit.given - there.nothing.fit.given < thresholds.anything:
        return found
    sure = dict.fromkeys(found.judgement.probabilities, 0.0)
    judgement = Judgement(Verdict.NAMED, (best.hypothesis,), sure | {best.hypothesis.names[0]: 1.0})
    others = tuple(each for each in found.candidates if each.hypothesis != best.hypothesis)
    return dataclasses.replace(found, judgement=judgement, candidates=(best, *others))


def may_be_the_file(
    found: Finding, doubted: Callable[[], Study], thresholds: Thresholds, *, unproven: bool = False
) -> Study | None:
    """Return the study to search again, where an error of the rover file may be all that is found.

    ``found`` counts the file as exact, ``doubted`` makes the study with its constants in doubt. It
    is returned in two cases, None otherwise:

    - One of the best names, proven or not, stands for a constant in doubt and is smaller than its
      deviation allows: there such a size has no name.
    - The answer is unknown, or ``unproven`` as held-out runs hardly show it, and there not even a
      discrepancy gains ``anything`` over nothing.
    """
    if found.judgement.verdict in (Verdict.NONE, Verdict.SOIL):
        return None
    study = doubted()
    sizes = (found.candidate(each).sizes for each in found.judgement.named)
    doubt = study.nominal.doubt
    if any(is_within(doubt, ((name, size) for name, size, _ in each)) for each in sizes):
        return study
    unknown = unproven or found.judgement.verdict is Verdict.UNKNOWN
    return study if unknown and study.gain(study.free) < thresholds.anything else None


def _at_the_end(nothing: Candidate) -> list[str]:
    """Return the constants in doubt that the runs move as far as they may."""
    moved = zip(nothing.hypothesis.doubt, nothing.fit.point.shared.tolist(), strict=True)
    return [each.name for each, value in moved if abs(value) > WITHIN - STEP]


def _is_in_doubt(study: Study, single: Singles, thresholds: Thresholds) -> bool:
    """Return whether the soils may be others than told.

    That is where the best effect leaves something, or constants near those of the files explain
    more than it: an effect that acts like another soil explains one, too.
    """
    if study.nominal.prior.constants_sd == 0.0 or single.gains.explainable < thresholds.anything:
        return False
    if single.left >= thresholds.anything:
        return True
    near = revised(study, study.nothing)
    return near is None or near.gain(near.beside, study) - single.gains.best >= thresholds.anything


def _preferred(answers: Sequence[_Revision], thresholds: Thresholds) -> _Revision:
    """Return the first answer; a later one where nothing else is missing and it explains more.

    With an effect beside them constants that are fitted explain more than the right file, too, as
    they take up what the effect's law misses. On ground that no file describes a second effect
    takes up what the file misses: then a later answer with one effect that explains as much is
    preferred.
    """
    first, *others = answers
    for each in others:
        alone = each.found.judgement.verdict is Verdict.NONE
        least = thresholds.anything if alone else 0.0
        simpler = alone or (each.is_named and each.effects < first.effects)
        if simpler and each.explains - first.explains >= least:
            first = each
    return first


def _weighed(told: Finding, tried: Sequence[_Revision], thresholds: Thresholds) -> Finding:
    """Return the finding on the other soils that explains most and enough, else ``told``.

    What the soils explain is there to be explained on those told, too.
    """
    if not tried:
        return told
    best, most = told.gains.best, max(each.explains for each in tried)
    beside = _beside_others(told, most, thresholds)
    for each in sorted(tried, key=lambda each: -each.explains):
        if each.explains > best and each.suffices(beside.gains, thresholds):
            return each.finding
    return beside


def _beside_others(told: Finding, explained: float, thresholds: Thresholds) -> Finding:
    """Return the finding on the soils as told where others explain so much [nat]."""
    gains = dataclasses.replace(told.gains, nothing_with=max(told.gains.nothing_with, explained))
    judgement = judge(gains, thresholds)
    chances = told.judgement.probabilities | judgement.probabilities
    judgement = dataclasses.replace(judgement, probabilities=chances)
    return dataclasses.replace(told, gains=gains, judgement=judgement)


def _single(found: Finding) -> Candidate:
    """Return the most probable single effect of a finding."""
    return next(each for each in found.candidates if len(each.hypothesis.effects) == 1)


def _on_file(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    starts: Sequence[_Start],
    gains: Gains,
    *,
    soils: Sequence[Soil],
    progress: ProgressCallback,
) -> _Revision | None:
    """Search on the soil at hand that explains most.

    None where no soil at hand explains more than the first of ``starts``.
    """
    progress(0.0, "other soil files")
    there = on_other_soil(study, soils, PROMISING * gains.explainable)
    if there is None:
        return None
    single = explain_singly(there.study, hypotheses, thresholds, part_of(progress, 0.2, 0.6))
    alone = there.gain(there.beside, study)
    if max(there.gain(single.found[0], study), alone) < study.gain(starts[0][0]):
        return None
    found = complete(there.study, hypotheses, thresholds, single, part_of(progress, 0.6, 1.0))
    return _Revision(there, found, alone, there.gain(found.answer, study))


def _on_constants(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    starts: Sequence[_Start],
    gains: Gains,
    *,
    progress: ProgressCallback,
) -> _Revision | None:
    """Search on constants that are fitted alone, or on those that fit beside one of ``starts``.

    Constants that are fitted alone may end in a valley that suits no effect that is there. So those
    beside an effect are searched, too, where they explain more than what was found on the former;
    ``anything`` more where nothing else was missing there. None where both promise too little.
    """
    progress(0.0, "soil constants")
    alone, first, least = _alone(study, gains, thresholds), None, -math.inf
    if alone is not None:
        part = part_of(progress, 0.2, 0.6)
        first = _on_revised(study, alone, hypotheses, thresholds, part)
        clear = first.found.judgement.verdict is Verdict.NONE
        least = first.explains + (thresholds.anything if clear else 0.0)
    beside = _beside_starts(study, starts, gains, thresholds)
    if beside is None or beside.gain(beside.beside, study) <= least:
        return first
    part = part_of(progress, 0.6, 1.0)
    second = _on_revised(study, beside, hypotheses, thresholds, part)
    if first is None:
        return second
    if second.explains <= least:
        return first
    return dataclasses.replace(second, alone=max(first.alone, second.alone))


def _foreseen_pair(study: Study, hypotheses: Sequence[Hypothesis], first: Candidate) -> float:
    """Return the largest foreseen gain [nat] of ``first`` with another effect."""
    foreseen = foresee(study, pairs_with(hypotheses, first), lambda _share, _label: None, first)
    base = study.nothing.fit.log_evidence
    return foreseen[0].log_evidence - base if foreseen else study.gain(first)


def _alone(study: Study, gains: Gains, thresholds: Thresholds) -> RevisedStudy | None:
    """Return the study on constants that explain more than the best effect; None where none do."""
    alone = revised_alone(study, thresholds.share * gains.explainable)
    enough = alone is not None and alone.gain(alone.beside, study) > (gains.single or gains.best)
    return alone if enough else None


def _beside_starts(
    study: Study, starts: Sequence[_Start], gains: Gains, thresholds: Thresholds
) -> RevisedStudy | None:
    """Return the study on the constants that explain most beside the effect of one of ``starts``.

    None where the best effect leaves nothing, or no such constants explain much of that.
    """
    name = gains.single or gains.best
    left = gains.explainable - name
    if left < thresholds.anything:
        return None
    least = name + max(thresholds.anything, PROMISING * left)
    found = [revised(study, effect, there) for effect, there in starts]
    return max(
        (each for each in found if each and each.gain(each.beside, study) >= least),
        key=lambda each: each.gain(each.beside, study),
        default=None,
    )


PROMISING = 0.5
"""[1] Share that another soil explains at least.

Of what the best name leaves, for constants that are fitted beside it; of all that can be explained
on the soils as told, for another file with a discrepancy on top.
"""


def _on_revised(
    study: Study,
    there: RevisedStudy,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> _Revision:
    """Search on revised constants, or on those that fit beside the best effect there."""
    alone = 0.0 if there.beside.hypothesis.effects else there.gain(there.beside, study)
    single = explain_singly(there.study, hypotheses, thresholds, part_of(progress, 0.0, 0.4))
    best = single.found[0]
    something = single.gains.explainable >= thresholds.anything
    if something and best.hypothesis != there.beside.hypothesis:
        beside = _beside_effect(study, best, there, thresholds)
        if beside is not there:
            there = beside
            single = explain_singly(
                there.study, hypotheses, thresholds, part_of(progress, 0.4, 0.6)
            )
    found = complete(there.study, hypotheses, thresholds, single, part_of(progress, 0.6, 1.0))
    return _Revision(there, found, alone, there.gain(found.answer, study))


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
"""[nat] Least gain of a name on constants that were fitted.

Constants take up most of an effect that acts like another soil, and what is left of it looks like
something else. In 24 practice cases, field_batches("0000a5a5"), names that were right gained 105
nat or more, three of four wrong ones 23 to 36.
"""


def besides_soil(found: Finding, least: float) -> Judgement:
    """Return the judgement on another soil: nothing else is missing where it says none.

    A name that gains less than ``least`` [nat] is unknown.
    """
    judgement = found.judgement
    verdict = Verdict.SOIL if judgement.verdict is Verdict.NONE else judgement.verdict
    named = judgement.named
    chances = {name: p for name, p in judgement.probabilities.items() if name != "none"}
    chances |= {"none": 0.0, "soil": judgement.probabilities["none"]}
    if verdict in (Verdict.NAMED, Verdict.CONFUSABLE) and found.gains.best < least:
        sure = {name: chances[name] for name in ("none", "soil")}
        chances = dict.fromkeys(chances, 0.0) | sure | {"unknown": 1.0 - sum(sure.values())}
        verdict, named = Verdict.UNKNOWN, named[:1]
    return Judgement(verdict, named, chances)
