# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator's state of health: counts since the start, statistics of the last period, and a level in words."""

import math
import statistics
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

from terrain_estimator.outcome import Outcome
from terrain_estimator.pairing import Counters
from terrain_estimator.ros_types import REQUIRED_INPUTS
from terrain_estimator.update import Update

STALE_AFTER_S = 1.0
"""[s] without a message on a required topic, by the steady clock: the input is stale."""


class Level(IntEnum):
    """Level of health; the values are those of msg_defs/EstimatorHealth."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class InputHealth:
    """Counters of one input topic since the start."""

    topic: str
    received: int
    unpaired: int
    out_of_order: int
    lost: int
    age_s: float  # since the last message, by the steady clock; NaN where none came


@dataclass(frozen=True, slots=True)
class Health:
    """One report."""

    sequence: int
    level: Level
    summary: str
    accepted: int
    rejected: int
    outcomes: Mapping[Outcome, int]
    inputs: tuple[InputHealth, ...]
    normalized_innovation_squared: float  # mean over the last period, per degree of freedom
    condition_number: float
    latency_median_s: float
    latency_max_s: float
    resets: int


class HealthMonitor:
    """Collects updates between two reports. Memory is bounded by the updates of one period."""

    def __init__(self) -> None:
        """Start with nothing counted."""
        self.outcomes: Counter[Outcome] = Counter()
        self.resets = 0
        self.failures = 0  # callbacks that raised
        self._sequence = 0
        self._condition_number = math.nan
        self._start_period()
        self._previous: dict[str, InputHealth] = {}
        self._previous_failures = 0

    def _start_period(self) -> None:
        self._recent: Counter[Outcome] = Counter()
        self._latencies: list[float] = []
        self._innovations: list[float] = []

    def observe(self, update: Update, latency_s: float) -> None:
        """Count one update, which took ``latency_s`` of wall time."""
        self.outcomes[update.decision.outcome] += 1
        self._recent[update.decision.outcome] += 1
        self._latencies.append(latency_s)
        self._condition_number = update.condition_number
        innovation = _normalized_innovation(update)
        if math.isfinite(innovation):
            self._innovations.append(innovation)

    def report(self, counters: Mapping[str, Counters], ages_s: Mapping[str, float]) -> Health:
        """The health since the last report; starts a new period."""
        inputs = tuple(
            InputHealth(topic, count.received, count.unpaired, count.out_of_order, count.lost, ages_s.get(topic, math.nan))
            for topic, count in counters.items()
        )
        level, summary = self._judge(inputs)
        accepted = sum(count for outcome, count in self.outcomes.items() if outcome.used)
        health = Health(
            sequence=self._sequence,
            level=level,
            summary=summary,
            accepted=accepted,
            rejected=self.outcomes.total() - accepted,
            outcomes=dict(self.outcomes),
            inputs=inputs,
            normalized_innovation_squared=statistics.fmean(self._innovations) if self._innovations else math.nan,
            condition_number=self._condition_number,
            latency_median_s=statistics.median(self._latencies) if self._latencies else math.nan,
            latency_max_s=max(self._latencies, default=math.nan),
            resets=self.resets,
        )
        self._sequence += 1
        self._previous = {entry.topic: entry for entry in inputs}
        self._previous_failures = self.failures
        self._start_period()
        return health

    def _judge(self, inputs: tuple[InputHealth, ...]) -> tuple[Level, str]:
        """The worst that was seen in this period, and its words."""
        silent = [entry.topic for entry in inputs if entry.topic in REQUIRED_INPUTS and not entry.age_s <= STALE_AFTER_S]
        if silent:
            return Level.STALE, f"no message for {STALE_AFTER_S:g} s on {', '.join(silent)}"
        if self.failures > self._previous_failures:
            return Level.ERROR, f"{self.failures - self._previous_failures} callbacks failed, see the log"
        refused = {outcome: count for outcome, count in self._recent.items() if not outcome.used and outcome is not Outcome.STANDSTILL}
        if refused:
            words = "; ".join(f"{count} {outcome.name} ({outcome.advice})" for outcome, count in sorted(refused.items()))
            hopeless = sum(refused.values()) == self._recent.total() or Outcome.NUMERICAL_FAILURE in refused
            return (Level.ERROR if hopeless else Level.WARN), f"refused: {words}"
        troubled = [text for entry in inputs if (text := self._trouble(entry))]
        if troubled:
            return Level.WARN, "; ".join(troubled)
        return Level.OK, "standing still" if self._recent[
            Outcome.STANDSTILL
        ] else "estimating" if self._recent else "waiting for complete observations"

    def _trouble(self, entry: InputHealth) -> str:
        """New losses of one input in words. An optional topic may be faster than the others: unpaired is normal there."""
        before = self._previous.get(entry.topic)
        lost = entry.lost - (before.lost if before else 0)
        backwards = entry.out_of_order - (before.out_of_order if before else 0)
        unpaired = entry.unpaired - (before.unpaired if before else 0) if entry.topic in REQUIRED_INPUTS else 0
        counts = (("lost", lost), ("out of order", backwards), ("without partner", unpaired))
        words = [f"{count} {what}" for what, count in counts if count]
        return f"{entry.topic}: {', '.join(words)}" if words else ""


def _normalized_innovation(update: Update) -> float:
    """Squared innovation over its predicted variance, per degree of freedom; NaN where nothing was predicted."""
    decision, prediction = update.decision, update.prediction
    if math.isfinite(decision.mahalanobis_squared) and decision.degrees_of_freedom > 0:
        return decision.mahalanobis_squared / decision.degrees_of_freedom
    if not prediction.innovation_variance > 0.0:
        return math.nan
    return prediction.innovation * prediction.innovation / prediction.innovation_variance  # not **, which raises on overflow
