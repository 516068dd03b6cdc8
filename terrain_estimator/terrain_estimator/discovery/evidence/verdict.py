# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One rule from evidence to verdict: none, soil, named, confusable or unknown.

With L the log evidence of a hypothesis over "nothing is missing" and L+ that of the same with a
discrepancy without a name on top:

1. Nothing is missing where no named effect and no discrepancy, alone or together, gains
   ``anything``.
2. An effect is named where it closes at least the ``share`` of what can be explained at all, L /
   max(L, L+, L+ of nothing). A test for "something is left" would not do: a right name whose law is
   slightly another leaves something too, and a wrong one gains hundreds of nats as soon as anything
   is missing. What separates them is the share of the gap that a name closes.
3. Every effect that comes within ``apart`` of the best, relative to what the best gains (a pair:
   over the best single effect), is as good an explanation: together they are a confusable set.
4. Two effects take the place of the best one where together they close the ``share`` and the second
   adds enough: nearly all (SECOND_SHARE) that the first leaves, or ``anything`` more than a
   discrepancy does, alone or beside the first. It also adds LEAST_ADDED of the pair's gain, or,
   where it closes nearly all, OWN of what it gains alone. A right name whose law is slightly
   another leaves something too, of which an effect that acts in the same place takes a part. They
   are named where a discrepancy on top explains little more (PAIR_SHARE), else it is unknown.

5. Soil constants that differ from those of the soil file count like an effect, see
   :func:`terrain_estimator.discovery.report.investigation.investigate`.

The thresholds are calibrated by ``studies.calibration``.
"""

import json
import math
from dataclasses import dataclass
from enum import StrEnum
from importlib.resources import files

import torch

from terrain_estimator.discovery.hypotheses.library import Hypothesis


class Verdict(StrEnum):
    """The kind of answer that the runs allow."""

    NONE = "none"
    SOIL = "soil"  # the soil is another than its file says, and nothing else is missing
    NAMED = "named"
    CONFUSABLE = "confusable"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class Thresholds:
    """The three numbers of the rule."""

    anything: float  # [nat]
    share: float  # [1]
    apart: float  # [1] of the gain of the best


def read_thresholds() -> Thresholds:
    """Return the calibrated thresholds that come with the package."""
    file = files("terrain_estimator.discovery.evidence") / "thresholds.json"
    values = json.loads(file.read_text(encoding="utf-8"))
    return Thresholds(values["anything"], values["share"], values["apart"])


@dataclass(frozen=True, slots=True)
class Gains:
    """Log evidences over nothing [nat] that the rule looks at."""

    named: tuple[tuple[Hypothesis, float], ...]  # the most probable first
    nothing_with: float  # nothing with the discrepancy
    best_with: float  # the most probable with the discrepancy
    single: float = 0.0  # of the best single effect where ``named`` are pairs

    @property
    def best(self) -> float:
        """Gain of the most probable named effect [nat]."""
        return self.named[0][1]

    @property
    def explainable(self) -> float:
        """Largest gain of any explanation [nat]."""
        return max(self.best, self.nothing_with, self.best_with)

    @property
    def pairs(self) -> bool:
        """Whether the named are pairs."""
        return self.single != 0.0

    @property
    def closed(self) -> float:
        """Share that the best name explains of what it does with a discrepancy on top, 0 to 1."""
        most = max(self.best, self.best_with)
        return max(self.best, 0.0) / most if most > 0.0 else 0.0

    @property
    def share(self) -> float:
        """Share of the explainable that the best name explains, 0 to 1."""
        return max(self.best, 0.0) / self.explainable if self.explainable > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict, its hypotheses and its probabilities."""

    verdict: Verdict
    # one where named, several where confusable; where unknown the closest, none where no row shows
    # that something is missing
    named: tuple[Hypothesis, ...]
    probabilities: dict[str, float]  # of none, unknown and every effect; they add up to one


def judge(gains: Gains, thresholds: Thresholds) -> Judgement:
    """Apply the rule."""
    best, close = gains.named[0][0], thresholds.apart * _told_apart_by(gains, thresholds)
    alike = tuple(hypothesis for hypothesis, gain in gains.named if gain >= gains.best - close)
    verdict = Verdict.UNKNOWN
    named: tuple[Hypothesis, ...] = (best,)
    if gains.explainable < thresholds.anything:
        verdict, named = Verdict.NONE, ()
    elif gains.share >= thresholds.share and not (gains.pairs and gains.closed < PAIR_SHARE):
        verdict, named = (
            (Verdict.NAMED, (best,))
            if len({frozenset(each.names) for each in alike}) == 1
            else (Verdict.CONFUSABLE, alike)
        )
    return Judgement(verdict, named, _probabilities(gains, thresholds))


SECOND_SHARE = 0.95
"""[1] Least share that the second effect closes of what the first leaves.

Two effects that were hidden together closed 0.70 to 1 (median 1, ten cases), the best second one
beside a single effect of another law 0.91 at most (slip_sinkage; twelve cases).
"""


LEAST_ADDED = 0.1
"""[1] Least share of a pair's gain that its second effect adds.

Of pairs that were hidden and named it added 0.16 to 0.63 (20 practice cases), beside a single
effect of another law 0.015 to 0.035 (four).
"""

OWN = 0.5
"""[1] Least share of what the second effect gains alone that it adds beside the first.

Beside an effect that gains much, such as failed_wheel, a second one that is there may add less
than LEAST_ADDED. It acts elsewhere and adds what it gains alone. One that takes up what the law of
the first misses acts where the first does: coulomb_drag beside drive_drag alone gained 1059 to 1424
nat, and added 59 to 70 (three cases).
"""

PAIR_SHARE = 0.9
"""[1] Least share that two effects explain of what they do with a discrepancy on top.

Two effects fit more to what is none of them: slip_sinkage of another law was taken for
rate_dependence and slip_sinkage, which left 0.19 and 0.23. The first alone would have been wrong,
too. Of pairs that were hidden and named none left more than 0.05 (13 practice cases).
"""


def is_pair(single: Gains, pair: Gains, thresholds: Thresholds) -> bool:
    """Return whether the best ``pair`` is an answer, and not the best ``single`` effect."""
    gained = pair.best - single.best
    left = max(single.explainable, pair.explainable) - single.best
    closes = gained >= max(thresholds.anything, SECOND_SHARE * left)
    # Beside a single effect of another law no second name explained more than a discrepancy of any
    # shape (8 practice cases); five of eight pairs that were hidden did, one of them with 0.87 of
    # what was left.
    surpasses = pair.best >= single.explainable + thresholds.anything
    adds = gained >= LEAST_ADDED * pair.best
    own = gained >= OWN * _second_alone(single, pair)
    enough = (closes and (adds or own)) or (surpasses and adds)
    return enough and pair.share >= thresholds.share


def _second_alone(single: Gains, pair: Gains) -> float:
    """Return what the pair's other effect gains alone [nat]; 0 where it promised nothing."""
    first, both = single.named[0][0].effects, pair.named[0][0].effects
    return max(
        (gain for each, gain in single.named if each.effects != first and each.effects[0] in both),
        default=0.0,
    )


def _told_apart_by(gains: Gains, thresholds: Thresholds) -> float:
    """Return the gain of the best [nat]; of a pair that over the best single effect."""
    return max(gains.best - gains.single, thresholds.anything)


_SHARE_WIDTH = 0.03
"""[1] Width in share over which "unknown" turns into a name: about its scatter among seeds."""


def _probabilities(gains: Gains, thresholds: Thresholds) -> dict[str, float]:
    """Return smooth versions of the rule's three steps."""
    something = _rise((gains.explainable - thresholds.anything) / (0.25 * thresholds.anything))
    known = _rise((gains.share - thresholds.share) / _SHARE_WIDTH)
    if gains.pairs:
        known *= _rise((gains.closed - PAIR_SHARE) / _SHARE_WIDTH)
    width = 0.5 * thresholds.apart * _told_apart_by(gains, thresholds)
    weights = torch.softmax(
        torch.tensor([gain / width for _, gain in gains.named], dtype=torch.float64), 0
    ).tolist()
    probabilities = {"none": 1.0 - something, "unknown": something * (1.0 - known)}
    order: dict[frozenset[str], str] = {}  # of the same names that of the most probable
    for (hypothesis, _), weight in zip(gains.named, weights, strict=True):
        name = order.setdefault(frozenset(hypothesis.names), " + ".join(hypothesis.names))
        probabilities[name] = probabilities.get(name, 0.0) + something * known * weight
    return probabilities


def _rise(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-max(-50.0, min(50.0, x))))
