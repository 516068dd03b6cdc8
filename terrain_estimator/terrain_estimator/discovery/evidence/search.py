# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The search among hypotheses: which are foreseen to explain something, and their fits."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.unknowns import Point
from terrain_estimator.discovery.progress import ProgressCallback

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
    after: Candidate | None = None,
) -> list[Candidate]:
    """Fit hypotheses again that explain more at a size that matters than was foreseen or found.

    One evaluation near nothing says little of a law that is far from linear, such as multipass. At
    its typical size, doubled as long as that gains, another one does. Effects with two signs are
    nearly linear and are not looked at. ``after`` is as in :func:`foresee`: then the effect is the
    one more.
    """
    base, again = (after or study.nothing).fit.log_evidence, []
    known = {each.hypothesis: each.log_evidence - base for each in foreseen}
    known |= {each.hypothesis: each.fit.log_evidence - base for each in found}
    first = len((after or study.nothing).fit.point.shared)
    for number, (hypothesis, gain) in enumerate(known.items()):
        progress(number / len(known), hypothesis.label)
        if float(hypothesis.shared().low[first]) < 0.0:
            continue
        values, there = _best_multiple(study, hypothesis, after)
        if there > max(gain + WORTHLESS, PROMISING * (found[0].fit.log_evidence - base)):
            again.append(study.refine(study.explain_from(hypothesis, values, after)))
    return again


def _best_multiple(
    study: Study, hypothesis: Hypothesis, after: Candidate | None
) -> tuple[Tensor, float]:
    """Return the multiple of the typical size that explains most, and its gain [nat]."""
    values = torch.tensor(hypothesis.typical(), dtype=torch.float64)
    before = (after or study.nothing).fit
    first, already = len(before.point.shared), before.given - study.nothing.fit.given
    values[:first] = before.point.shared
    high = float(hypothesis.shared().high[first])
    gain = study.predict_at(hypothesis, values, after) - already
    while gain > 0.0 and values[first] < high:
        double = values.clone()
        double[first] = min(2.0 * float(values[first]), high)
        more = study.predict_at(hypothesis, double, after) - already
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
    doubt, shared = study.nominal.doubt, pair.fit.point.shared
    found, at = [], len(doubt)
    for effect in pair.hypothesis.effects:
        values = torch.cat([shared[: len(doubt)], shared[at : at + effect.count]])
        hypothesis = Hypothesis((effect,)).doubting(doubt)
        alone = study.fit_from(hypothesis, pair.fit.point.with_shared(values))
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
