# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Which effects are missing from runs on given soils: fits and verdict."""

import dataclasses
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch

from terrain_estimator.discovery.evidence.search import (
    Foreseen,
    bettered,
    foresee,
    further,
    members,
    ranked,
    search,
)
from terrain_estimator.discovery.evidence.soil_revision import RevisedStudy
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.evidence.verdict import (
    Gains,
    Judgement,
    Thresholds,
    Verdict,
    is_pair,
    judge,
)
from terrain_estimator.discovery.hypotheses.library import Hypothesis, together
from terrain_estimator.discovery.hypotheses.rover_doubt import (
    NOTABLE,
    STANDS_FOR,
    RoverConstant,
    standing_for,
)
from terrain_estimator.discovery.leftover.flexible import Column
from terrain_estimator.discovery.progress import ProgressCallback


@dataclass(frozen=True, slots=True)
class Leftover:
    """The row and signal on which a discrepancy depends."""

    column: Column
    strength: float  # [1] decrease of the objective: squared standard deviations
    degrees: int  # functions of that signal


@dataclass(frozen=True, slots=True)
class ConstantFound:
    """A constant of the rover in doubt, and what the runs say of it under the answer."""

    constant: RoverConstant
    moved: float  # [1] from the file, in stated deviations
    moved_sd: float  # [1] deviation of that, given the runs
    effect: str  # that may stand for it, empty for none
    named: bool  # whether that effect is: then this is the constant for which it stands

    @property
    def name(self) -> str:
        """Its key in the rover file."""
        return self.constant.name

    @property
    def is_notable(self) -> bool:
        """Whether the runs move it so far that the file, or what stands for it, is in question."""
        return abs(self.moved) >= NOTABLE

    def plain(self) -> dict[str, Any]:
        """Return its entry of finding.json, in the unit of the rover file."""
        told = self.constant
        return {
            "name": told.name,
            "unit": told.unit,
            "told": told.told,
            "told_sd": told.sd,
            "found": told.at(self.moved),
            "found_sd": self.moved_sd * told.sd,
            "moved": self.moved,
            "moved_sd": self.moved_sd,
            "effect": self.effect,
            "named": self.named,
            "notable": self.is_notable,
        }


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

    @property
    def answer(self) -> Candidate:
        """The best name, or nothing where nothing is missing."""
        nothing = self.judgement.verdict in (Verdict.NONE, Verdict.SOIL)
        return self.nothing if nothing else self.best

    @property
    def constants(self) -> list[ConstantFound]:
        """The rover's constants in doubt under the answer; empty where none is."""
        fit, found = self.answer.fit, []
        spread = fit.covariance.diagonal().sqrt().tolist()
        sizes = {name: (size, sd) for name, size, sd in self.answer.sizes}
        for told, moved, sd in zip(  # the effects' values come behind
            self.nothing.hypothesis.doubt, fit.point.shared.tolist(), spread, strict=False
        ):
            effect = next((name for name, each in STANDS_FOR.items() if each == told.name), "")
            if effect not in sizes:
                found.append(ConstantFound(told, moved, sd, effect, named=False))
                continue
            size, size_sd = sizes[effect]
            ends = [standing_for(told, size + k * size_sd) for k in (0.0, -0.5, 0.5)]
            there, low, high = ((each - told.told) / told.sd for each in ends)
            found.append(ConstantFound(told, there, abs(high - low), effect, named=True))
        return found

    def candidate(self, hypothesis: Hypothesis) -> Candidate:
        """Return the fit of that hypothesis."""
        return next(each for each in self.candidates if each.hypothesis == hypothesis)


@dataclass(frozen=True, slots=True)
class Singles:
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


def part_of(progress: ProgressCallback, first: float, last: float) -> ProgressCallback:
    """Return the progress of a part of the work."""
    return lambda share, label: progress(first + (last - first) * share, label)


def explain_singly(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> Singles:
    """Fit all single effects that promise something."""
    progress(0.0, "nothing missing")
    free = study.free
    foreseen = foresee(study, hypotheses, part_of(progress, 0.1, 0.5))
    found = search(study, foreseen, part_of(progress, 0.5, 1.0))
    base = study.nothing.fit.log_evidence
    # Where neither a name nor the discrepancy comes near to gaining anything, both together do not
    # either.
    clear = max(found[0].fit.log_evidence, free.fit.log_evidence) - base < 0.5 * thresholds.anything
    best_with = found[0] if clear else study.with_discrepancy(found[0])
    gains = gains_of(study.nothing, found, free, best_with)
    return Singles(free, foreseen, found, best_with, gains)


def complete(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    thresholds: Thresholds,
    single: Singles,
    progress: ProgressCallback,
) -> Finding:
    """Fit again what may explain more, pairs where the best leaves something, and judge."""
    if single.left >= thresholds.anything:
        part = part_of(progress, 0.0, 0.2)
        single = _with_fits(study, single, further(study, single.foreseen, single.found, part))
    answer = None
    if single.left >= thresholds.anything:
        part = part_of(progress, 0.2, 0.7)
        first, most = single.found[0], single.gains.explainable
        pairs = _beside(study, hypotheses, first, most, thresholds, part)
        single, answer = _as_answer(study, single, pairs, thresholds)
    if answer is not None:
        part = part_of(progress, 0.7, 1.0)
        others = exchanged(study, hypotheses, answer.found[0], single.found, thresholds, part)
        if others and study.gain(others[0]) > answer.gains.best:
            every = ranked([*answer.found, *others])
            single, better = _as_answer(study, single, every, thresholds)
            answer = better or _beside_singles(
                study, single, answer.found, answer.best_with, thresholds
            )
    found, gains, best_with = single.found, single.gains, single.best_with
    if answer is not None:
        found, gains, best_with = [*answer.found, *found], answer.gains, answer.best_with
    judgement = judge(gains, thresholds)
    # What one evaluation already showed to be far behind was not fitted.
    unlikely = {name: 0.0 for hypothesis in hypotheses for name in hypothesis.names}
    judgement = dataclasses.replace(judgement, probabilities=unlikely | judgement.probabilities)
    return Finding(judgement, gains, tuple(found), study.nothing, tuple(leftovers(best_with)))


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Pairs of effects that are an answer, and what they explain."""

    found: list[Candidate]  # the most probable first
    best_with: Candidate  # that with a discrepancy
    gains: Gains


def _with_fits(study: Study, single: Singles, more: Sequence[Candidate]) -> Singles:
    """Return ``single`` with ``more`` fits of single effects, of each the better one."""
    found, best_with = bettered(single.found, more), single.best_with
    if found[0] is not single.found[0]:
        best_with = study.with_discrepancy(found[0])
    gains = gains_of(study.nothing, found, single.free, best_with)
    return dataclasses.replace(single, found=found, best_with=best_with, gains=gains)


def _as_answer(
    study: Study, single: Singles, pairs: list[Candidate], thresholds: Thresholds
) -> tuple[Singles, _Pairs | None]:
    """Return single effects, fitted again from the best pair, and ``pairs`` if they answer."""
    if not pairs:
        return single, None
    single = _with_fits(study, single, members(study, pairs[0]))
    return single, _beside_singles(
        study, single, pairs, study.with_discrepancy(pairs[0]), thresholds
    )


def _beside_singles(
    study: Study,
    single: Singles,
    pairs: list[Candidate],
    best_with: Candidate,
    thresholds: Thresholds,
) -> _Pairs | None:
    """Return ``pairs`` if they answer, and not the best single effect."""
    gains = gains_of(study.nothing, pairs, single.free, best_with)
    gains = dataclasses.replace(gains, single=single.gains.best)
    answers = is_pair(single.gains, gains, thresholds)
    return _Pairs(pairs, best_with, gains) if answers else None


def _beside(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    first: Candidate,
    explainable: float,
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> list[Candidate]:
    """Return the most probable pairs of ``first`` and another effect.

    They are fitted again from a size that matters where none explains the ``explainable`` [nat].
    """
    others = pairs_with(hypotheses, first)
    if not others:
        return []
    foreseen = foresee(study, others, part_of(progress, 0.0, 0.4), first)
    found = search(study, foreseen, part_of(progress, 0.4, 0.7), first)
    if explainable - study.gain(found[0]) < thresholds.anything:
        return found
    return bettered(found, further(study, foreseen, found, part_of(progress, 0.7, 1.0), first))


def exchanged(
    study: Study,
    hypotheses: Sequence[Hypothesis],
    pair: Candidate,
    singles: Sequence[Candidate],
    thresholds: Thresholds,
    progress: ProgressCallback,
) -> list[Candidate]:
    """Return pairs of the second effect of ``pair`` with another one than the first.

    The first was the best alone. Beside the second another effect may be as good or better.
    """
    first, second = pair.hypothesis.effects
    kept = next(each for each in singles if each.hypothesis.effects == (second,))
    others = [each for each in hypotheses if each.effects != (first,)]
    return _beside(study, others, kept, study.gain(pair), thresholds, progress)


def pairs_with(hypotheses: Sequence[Hypothesis], first: Candidate) -> list[Hypothesis]:
    """Return the pairs of the effect of ``first`` and each other one."""
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
