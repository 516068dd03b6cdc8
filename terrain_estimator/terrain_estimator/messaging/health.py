# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""State of health of the estimator.

A report holds counts since the start, statistics of the last period, and a level in words.
"""

import dataclasses
import math
import statistics
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from terrain_estimator.estimator.intake import FEWEST
from terrain_estimator.messaging.averaging import Rate, Treatment
from terrain_estimator.messaging.diagnostics import (
    CONDITION,
    FAILURES,
    FIT,
    INNOVATION,
    LATENCY,
    LOSSES,
    MODEL,
    NUMERICS,
    OPTIONAL,
    PLANAR,
    RATE,
    REFUSED,
    REQUIRED,
    CheckResult,
    Level,
    worst,
)
from terrain_estimator.messaging.pairing import Counters
from terrain_estimator.messaging.settled import SettledOutcomes
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import REQUIRED_INPUTS
from terrain_estimator.update import Decision, Update

REFERENCE = REQUIRED_INPUTS[0]
FEWEST_INNOVATIONS = 5
"""Fewer innovations than this give no meaningful mean of squares."""


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
    """One report of the estimator's health."""

    sequence: int
    level: Level
    summary: str
    accepted: int
    rejected: int
    seconds_taken: int
    seconds_refused: int
    outcomes: Mapping[Outcome, int]
    inputs: tuple[InputHealth, ...]
    normalized_innovation_squared: float  # mean over the last period, per degree of freedom
    condition_number: float
    latency_median_s: float
    latency_max_s: float
    resets: int
    findings: tuple[CheckResult, ...]  # of which the level is the worst


class RefusalCounts:
    """Refused observations by their reason, with the newest detail of each."""

    def __init__(self) -> None:
        """Start without a refusal."""
        self._counts: Counter[Outcome] = Counter()
        self._details: dict[Outcome, str] = {}

    def add(self, decision: Decision) -> None:
        """Count one decision where it is a refusal, with the observations that it leaves out.

        A rover that stands is none.
        """
        outcome = decision.outcome
        if not outcome.used and outcome is not Outcome.STANDSTILL:
            self._counts[outcome] += 1 + decision.settled
            self._details[outcome] = decision.detail

    def total(self) -> int:
        """Return the number of refusals."""
        return self._counts.total()

    def words(self) -> str:
        """Return counts, reasons and advice, the most common reason first with its detail."""
        parts: list[str] = []
        for outcome, count in self._counts.most_common():
            detail = "" if parts else self._details[outcome]
            reason = f": {detail}" if detail else ""
            parts.append(f"{count} {outcome.name} ({outcome.advice}){reason}")
        return "; ".join(parts)


class HealthMonitor:
    """Collector of updates between two reports; memory is bounded by the updates of one period."""

    def __init__(self, reported_failures: int = 0) -> None:
        """Start with zero counts.

        ``reported_failures`` carries over the failures that were reported before a node was
        configured again.
        """
        self._settled = SettledOutcomes()
        self._last: Update | None = None
        self.resets = 0
        # callbacks that raised, in total and up to the last report
        self.failures = self.reported_failures = reported_failures
        self._sequence = 0
        self._condition_number = math.nan
        self._start_period()
        self._previous: dict[str, InputHealth] = {}

    def _start_period(self) -> None:
        self._recent: Counter[Outcome] = Counter()
        self._refusals = RefusalCounts()
        self._latencies: list[float] = []
        self._innovations: list[float] = []

    def observe(self, update: Update, latency_s: float) -> None:
        """Count one update, which took ``latency_s`` of wall time."""
        self._last = update
        self._recent += self._settled.add(update)
        if update.decision.outcome is not Outcome.NOT_PLANAR:  # that has a check of its own
            self._refusals.add(update.decision)
        self._latencies.append(latency_s)
        self._condition_number = update.condition_number
        innovation = normalized_innovation(update)
        if math.isfinite(innovation):
            self._innovations.append(innovation)

    def report(
        self,
        counters: Mapping[str, Counters],
        ages_s: Mapping[str, float],
        rate: Rate | None = None,
    ) -> Health:
        """Return the health since the last report, and start a new period."""
        inputs = tuple(
            InputHealth(
                topic,
                count.received,
                count.unpaired,
                count.out_of_order,
                count.lost,
                ages_s.get(topic, math.nan),
            )
            for topic, count in counters.items()
        )
        findings = (
            *self._judge_inputs(inputs),
            *_judge_rate(rate),
            *self._judge_updates(),
        )
        level, summary = worst(findings)
        settled = self._settled
        health = Health(
            sequence=self._sequence,
            level=level,
            summary=summary or self._doing(),
            accepted=settled.used,
            rejected=settled.refused,
            seconds_taken=settled.seconds_taken,
            seconds_refused=settled.seconds_refused,
            outcomes=dict(settled.outcomes),
            inputs=inputs,
            normalized_innovation_squared=(
                statistics.fmean(self._innovations) if self._innovations else math.nan
            ),
            condition_number=self._condition_number,
            latency_median_s=statistics.median(self._latencies) if self._latencies else math.nan,
            latency_max_s=max(self._latencies, default=math.nan),
            resets=self.resets,
            findings=findings,
        )
        self._sequence += 1
        self._previous = {entry.topic: entry for entry in inputs}
        self.reported_failures = self.failures
        self._start_period()
        return health

    def _doing(self) -> str:
        if self._recent[Outcome.STANDSTILL]:
            return "standing still"
        return "estimating" if self._latencies else "waiting for complete observations"

    def _judge_inputs(self, inputs: tuple[InputHealth, ...]) -> Iterator[CheckResult]:
        incomplete = any(self._unpaired(entry) for entry in inputs if entry.topic == REFERENCE)
        for entry in inputs:
            age_s = entry.age_s
            if entry.topic in REQUIRED_INPUTS:
                words = f"no data on {entry.topic} " + (
                    "since the start" if math.isnan(age_s) else f"for {age_s:.1f} s"
                )
                yield REQUIRED.judge(math.inf if math.isnan(age_s) else age_s, entry.topic, words)
            else:
                yield OPTIONAL.judge(
                    age_s, entry.topic, f"no data on {entry.topic} for {age_s:.1f} s"
                )
            count, words = self._losses(entry, incomplete=incomplete)
            yield LOSSES.judge(count, entry.topic, f"{entry.topic}: {words or 'none lost'}")

    def _unpaired(self, entry: InputHealth) -> int:
        """Return the number of new messages without a partner."""
        before = self._previous.get(entry.topic)
        return entry.unpaired - (before.unpaired if before else 0)

    def _losses(self, entry: InputHealth, *, incomplete: bool) -> tuple[int, str]:
        """Return the new losses of one input, also in words.

        ``incomplete``: an instant lacked messages. Otherwise a message without a partner is normal,
        since its topic is faster than the reference; on an optional topic it always is.
        """
        before = self._previous.get(entry.topic)
        # negative where a missing message arrived late
        lost = max(0, entry.lost - (before.lost if before else 0))
        backwards = entry.out_of_order - (before.out_of_order if before else 0)
        unpaired = self._unpaired(entry) if incomplete and entry.topic in REQUIRED_INPUTS else 0
        counts = (("lost", lost), ("out of order", backwards), ("without partner", unpaired))
        return lost + backwards + unpaired, ", ".join(
            f"{count} {what}" for what, count in counts if count
        )

    def _judge_updates(self) -> Iterator[CheckResult]:
        share = self._refusals.total() / self._recent.total() if self._recent else 0.0
        yield REFUSED.judge(share, text=f"refused: {self._refusals.words() or 'none'}")
        turned = self._recent[Outcome.NOT_PLANAR]
        yield PLANAR.judge(
            turned / self._recent.total() if turned else 0.0, text=f"{turned} NOT_PLANAR"
        )
        yield self._judge_model()
        yield self._judge_fit()
        yield NUMERICS.judge(
            self._recent[Outcome.NUMERICAL_FAILURE],
            text=f"{self._recent[Outcome.NUMERICAL_FAILURE]} NUMERICAL_FAILURE",
        )
        failures = self.failures - self.reported_failures
        yield FAILURES.judge(failures, text=f"{failures} callbacks failed")
        yield INNOVATION.judge(
            statistics.fmean(self._innovations)
            if len(self._innovations) >= FEWEST_INNOVATIONS
            else math.nan
        )
        yield CONDITION.judge(self._condition_number)
        yield LATENCY.judge(max(self._latencies, default=math.nan))

    def _judge_fit(self) -> CheckResult:
        fits = self._last.estimate.fit if self._last else ()
        missed, row = max(
            ((math.hypot(each.offset, each.spread), each.row) for each in fits),
            default=(math.nan, ""),
        )
        words = f"row {row} misses by {missed:.2f} predicted deviations, most of all" if row else ""
        return FIT.judge(missed, text=words or "not known yet")

    def _judge_model(self) -> CheckResult:
        """Judge the last seconds of driving, as the status of the last estimate does."""
        if self._last is None:
            return MODEL.judge(math.nan, text="no second of driving yet")
        judged, taken = self._last.estimate.seconds
        share = 1.0 - taken / judged if judged >= FEWEST else math.nan
        findings = [each.finding for each in self._last.disagreements]
        words = f"{taken} of the last {judged} seconds of driving were taken"
        result = MODEL.judge(share, text="; ".join(findings) or words)
        # a model that misses seconds by too much is at fault though each second was taken
        return (
            dataclasses.replace(result, level=max(result.level, Level.ERROR))
            if findings
            else result
        )


def _judge_rate(rate: Rate | None) -> Iterator[CheckResult]:
    if rate is not None:
        yield RATE.judge(rate.treatment is Treatment.REFUSE, text=f"rate: {rate}")


def normalized_innovation(update: Update) -> float:
    """Return the squared innovation over its predicted variance, per degree of freedom.

    NaN where nothing was predicted.
    """
    decision, prediction = update.decision, update.prediction
    if math.isfinite(decision.mahalanobis_squared) and decision.degrees_of_freedom > 0:
        return decision.mahalanobis_squared / decision.degrees_of_freedom
    if not prediction.innovation_variance > 0.0:
        return math.nan
    # not **, which raises on overflow
    return prediction.innovation * prediction.innovation / prediction.innovation_variance
