# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Thresholds of the verdict from runs of known truth.

Nothing missing, a library effect, and one taken out of the library.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

from terrain_estimator.discovery.evidence.search import foresee, search
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.evidence.verdict import Gains, Thresholds
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.report.finding import gains_of

MARGIN = 1.5
"""[1] By how much more than the worst null case something has to gain."""
LEAST = 8.0
"""[nat] Least gain that counts, whatever a few null cases give."""


@dataclass(frozen=True, slots=True)
class CalibrationCase:
    """The gains of one calibration case, which the rule uses."""

    truth: str  # empty where nothing is missing
    with_truth: Gains
    without_truth: Gains | None  # the same with a library that lacks the truth


def sample(study: Study, truth: str, progress: ProgressCallback) -> CalibrationCase:
    """Investigate a case twice: with the whole library, and with one that lacks the truth."""
    free = study.with_discrepancy(study.nothing)

    def gains(found: Sequence[Candidate]) -> Gains:
        return gains_of(study.nothing, found, free, study.with_discrepancy(found[0]))

    foreseen = foresee(study, singles(), progress)
    everything = search(study, foreseen, progress)
    if not truth:
        return CalibrationCase(truth, gains(everything), None)
    others = [each for each in everything if truth not in each.hypothesis.names]
    if not others:
        rest = [each for each in foreseen if truth not in each.hypothesis.names]
        others = search(study, rest, progress)
    return CalibrationCase(truth, gains(everything), gains(others))


def thresholds(samples: Sequence[CalibrationCase]) -> Thresholds:
    """Return the numbers that fit these samples best.

      - ``anything``: MARGIN times the largest gain of any null case, at least LEAST.
    - ``share``: where the fewest cases fall on the wrong side, those with the truth below it and
      those without above it; the
        middle of all such places.
      - ``apart``: the largest lead of a wrong name over the right one among those that pass, at
        least a twentieth.
    """
    nulls = [each.with_truth.explainable for each in samples if not each.truth]
    anything = max([MARGIN * gain for gain in nulls] + [LEAST])
    known = [each for each in samples if each.truth and each.with_truth.explainable >= anything]
    inside = sorted(each.with_truth.share for each in known)
    outside = sorted(each.without_truth.share for each in known if each.without_truth)
    share = _divide(outside, inside)
    leads = [_lead(each) for each in known if each.with_truth.share >= share]
    return Thresholds(anything, share, max([0.05, *(lead for lead in leads if lead < _HOPELESS)]))


_HOPELESS = 0.3
"""[1] A right name that is further behind is not confusable but lost."""


def _lead(each: CalibrationCase) -> float:
    """Return the lead of the best name over the right one, as a share of its gain.

    0 where it is the right one, 1 where that was not even fitted.
    """
    gains = each.with_truth
    right = max(
        (gain for hypothesis, gain in gains.named if hypothesis.names == (each.truth,)), default=0.0
    )
    return 1.0 - right / gains.best


def _divide(outside: Sequence[float], inside: Sequence[float]) -> float:
    """Return the cut with the fewest of ``outside`` above and of ``inside`` below."""
    values = sorted({0.0, 1.0, *outside, *inside})
    wrong = [
        (sum(x >= high for x in outside) + sum(x < high for x in inside), low, high)
        for low, high in itertools.pairwise(values)
    ]
    fewest = min(wrong)[0]
    best = [(low, high) for count, low, high in wrong if count == fewest]
    return 0.5 * (best[0][0] + best[-1][1])
