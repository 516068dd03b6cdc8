# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Counting and averaging of messages: rates, spans, innovations and thresholds, by plain sums."""

import dataclasses
import math
import statistics
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.messaging.arrival_rates import timing
from terrain_estimator.messaging.diagnostics import CHECKS, Check, CheckResult, Level, table, worst
from terrain_estimator.messaging.health import (
    FEWEST_INNOVATIONS,
    HealthMonitor,
    normalized_innovation,
)
from terrain_estimator.messaging.history import (
    Errors,
    RunHistory,
    Spans,
    UpdateSpan,
    WheelHistory,
    WheelSpan,
)
from terrain_estimator.messaging.pairing import Counters
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import INPUT_TYPES
from terrain_estimator.update import Disagreement, Update
from tests.terrain_estimator.updates import update

MS = 1_000_000
FRESH = dict.fromkeys(INPUT_TYPES, 0.05)


# rate and jitter


def test_the_rate_is_one_over_the_median_interval() -> None:
    arrivals = np.cumsum([0, 100, 100, 130, 100, 70, 100]) * MS
    found = timing(arrivals.tolist())
    assert found.messages == 7
    assert found.rate_hz == pytest.approx(10.0)
    assert timing(arrivals.tolist(), 4.0).rate_hz == pytest.approx(2.5)
    expected = np.percentile([0.0, 0.0, 30.0, 0.0, 30.0, 0.0], 99)
    assert found.jitter_ms_p99 == pytest.approx(expected)


def test_two_messages_have_a_rate_and_one_has_none() -> None:
    assert timing([5 * MS, 25 * MS]).rate_hz == pytest.approx(50.0)
    assert timing([5 * MS, 25 * MS]).jitter_ms_p99 == 0.0
    for arrivals in ([], [7]):
        found = timing(arrivals)
        assert found.messages == len(arrivals)
        assert math.isnan(found.rate_hz)
        assert math.isnan(found.jitter_ms_p99)
    at_once = timing([3, 3, 3])
    assert math.isnan(at_once.rate_hz)
    assert at_once.jitter_ms_p99 == 0.0


# innovations


def with_innovation(
    innovation: float, variance: float, squared: float = math.nan, degrees: int = 0
) -> Update:
    plain = update(1)
    return plain._replace(
        prediction=plain.prediction._replace(innovation=innovation, innovation_variance=variance),
        decision=plain.decision._replace(mahalanobis_squared=squared, degrees_of_freedom=degrees),
    )


def test_a_block_gives_its_distance_by_degree_and_else_the_velocity_its_own() -> None:
    assert normalized_innovation(with_innovation(0.3, 0.04, 12.0, 6)) == 2.0
    assert normalized_innovation(with_innovation(0.3, 0.04, 12.0, 0)) == pytest.approx(2.25)
    assert normalized_innovation(with_innovation(0.3, 0.04, math.inf, 3)) == pytest.approx(2.25)
    assert normalized_innovation(with_innovation(-0.3, 0.04)) == pytest.approx(2.25)
    for variance in (0.0, -1.0, math.nan):
        assert math.isnan(normalized_innovation(with_innovation(0.3, variance)))
    assert normalized_innovation(with_innovation(1e200, 1.0)) == math.inf


def test_errors_count_what_is_within_one_deviation_and_within_the_95_percent() -> None:
    errors, scale = Errors(), 0.2
    shares = (0.0, 0.999, -1.0, 1.001, HALF_WIDTH_95 - 1e-6, HALF_WIDTH_95 + 1e-6, -5.0)
    for share in shares:
        errors.add(share * scale, scale**2)
    for nothing in ((math.nan, 1.0), (math.inf, 1.0), (1.0, 0.0), (1.0, math.nan), (1.0, -2.0)):
        errors.add(*nothing)
    assert (errors.count, errors.inside_68, errors.inside_95) == (7, 3, 5)
    assert errors.rms == pytest.approx(scale * math.sqrt(sum(s * s for s in shares) / 7.0))
    assert errors.predicted_rms == pytest.approx(scale)
    assert math.isnan(Errors().rms)
    assert math.isnan(Errors().predicted_rms)


@given(
    values=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(0.01, 1.0)), min_size=1, max_size=20),
    cut=st.integers(0, 20),
)
def test_errors_of_two_parts_added_are_those_of_the_whole(
    values: list[tuple[float, float]], cut: int
) -> None:
    whole, parts = Errors(), (Errors(), Errors())
    for index, value in enumerate(values):
        whole.add(*value)
        parts[index >= cut].add(*value)
    both = parts[0] + parts[1]
    assert dataclasses.astuple(both) == pytest.approx(dataclasses.astuple(whole))


# spans


def test_a_span_holds_the_last_estimate_and_the_largest_change() -> None:
    made = [
        update(k, change=change)._replace(
            estimate=update(k).estimate._replace(change_probability=change),
        )
        for k, change in enumerate((0.2, math.nan, 0.7, 0.1))
    ]
    made[1] = made[1]._replace(disagreements=(Disagreement("it misses", "check"),))
    halves = []
    for part in (made[:2], made[2:]):
        span = UpdateSpan(part[0].stamp_ns, part[0].estimate)
        for each in part:
            span.add(each, Counter({each.decision.outcome: 1}))
        halves.append(span)
    whole = halves[0] + halves[1]
    assert whole.stamp_ns == made[-1].stamp_ns
    assert whole.estimate is made[-1].estimate
    assert [half.disagrees for half in halves] == [True, False]
    assert not whole.disagrees
    assert (halves[1] + halves[0]).disagrees
    assert [half.change_probability for half in halves] == [0.2, 0.7]
    assert whole.change_probability == 0.7
    assert (halves[1] + halves[0]).change_probability == 0.7
    assert whole.count == 4
    assert whole.outcomes == Counter({Outcome.ACCEPTED: 4})
    known = [normalized_innovation(each) for each in made]
    assert whole.nis == pytest.approx(statistics.fmean(known))
    assert (whole.nis_count, whole.errors.count) == (4, 4)
    assert math.isnan(UpdateSpan(0, made[0].estimate).nis)


@dataclasses.dataclass
class Numbers:
    """A span of numbers."""

    values: list[int] = dataclasses.field(default_factory=list)

    @property
    def count(self) -> int:
        return len(self.values)

    def __add__(self, later: "Numbers") -> "Numbers":
        return Numbers(self.values + later.values)


@given(capacity=st.sampled_from([2, 4, 6]), total=st.integers(1, 100))
def test_spans_keep_everything_in_its_order_in_bounded_room(capacity: int, total: int) -> None:
    spans: Spans[Numbers] = Spans(capacity)
    for number in range(total):
        spans.room(Numbers).values.append(number)
    assert [value for span in spans.spans for value in span.values] == list(range(total))
    assert len(spans.spans) <= capacity
    lengths = [span.count for span in spans.spans]
    assert len(set(lengths[:-1])) <= 1
    assert lengths[-1] <= lengths[0]
    assert total <= capacity or len(spans.spans) > capacity // 2


def test_a_run_begins_with_its_first_update() -> None:
    history = RunHistory()
    made = [update(k) for k in range(3)]
    for each in made:
        history.add(each)
    assert history.first_ns == made[0].stamp_ns
    assert [span.count for span in history.spans] == [1, 1, 1]
    assert [span.stamp_ns for span in history.spans] == [each.stamp_ns for each in made]


def test_wheels_are_averaged_by_name_over_the_messages_that_know_them() -> None:
    history = WheelHistory(("left", "right"), capacity=2)
    history.add(10, ["left", "right", "other"], [1.0, 4.0, 100.0])
    history.add(20, ["right", "left"], [6.0, math.nan])
    history.add(30, ["left"], [2.0])
    assert [span.count for span in history.spans] == [2, 1]
    first, last = history.spans
    assert (first.mean("left"), first.mean("right")) == (1.0, 5.0)
    assert (last.mean("left"), last.stamp_ns) == (2.0, 30)
    assert math.isnan(last.mean("right"))
    assert math.isnan(first.mean("other"))
    assert (first + last).mean("left") == 1.5
    assert (first + last).count == 3
    assert WheelSpan().count == 0


# checks


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_a_level_holds_above_its_limit_and_not_at_it(check: Check) -> None:
    """The most severe whose limit is passed."""
    limits = {Level.WARN: check.warn, Level.ERROR: check.error, Level.STALE: check.stale}
    finite = {level: limit for level, limit in limits.items() if math.isfinite(limit)}
    assert finite
    for level, limit in finite.items():
        passed = [other for other, lower in finite.items() if lower < limit]
        assert check.judge(limit).level == max(passed, default=Level.OK)
        above = math.nextafter(limit, math.inf)
        assert check.judge(above).level == max([*passed, level])
    assert check.judge(math.nan).level is Level.OK
    assert check.judge(-1.0).level is Level.OK


def test_a_finding_names_its_subject_and_gives_advice_where_something_is_wrong() -> None:
    check = Check("age", "age of it", "s", "hurry", 1.0)
    late, fine = check.judge(1234.5, "odom"), check.judge(0.5)
    assert (late.name, late.message) == ("age odom", "age of it is 1.23e+03 s (hurry)")
    assert (fine.name, fine.message) == ("age", "age of it is 0.5 s")
    assert check.judge(2.0, "odom", "odom is old").message == "odom is old (hurry)"
    assert Check("a", "it", "", "", 1.0).judge(2.0).message == "it is 2"


def test_the_worst_findings_are_told_and_no_others() -> None:
    def finding(level: Level, text: str) -> CheckResult:
        return CheckResult(Check("c", "q", "", ""), "", 0.0, level, text)

    found = [finding(Level.WARN, "a"), finding(Level.ERROR, "b"), finding(Level.ERROR, "c")]
    assert worst(found) == (Level.ERROR, "b; c")
    assert worst([finding(Level.OK, "fine")]) == (Level.OK, "")
    assert worst([]) == (Level.OK, "")


def test_the_table_has_a_row_for_every_check_with_its_limits() -> None:
    rows = table().splitlines()
    assert len(rows) == 2 + len(CHECKS)
    for check, row in zip(CHECKS, rows[2:], strict=True):
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert cells[0] == check.name
        for cell, limit in zip(cells[3:6], (check.warn, check.error, check.stale), strict=True):
            assert cell == ("" if math.isinf(limit) else f"{limit:g}")


# health


def counters(**changes: Counters) -> dict[str, Counters]:
    return {topic: changes.get(topic, Counters(received=10, paired=10)) for topic in INPUT_TYPES}


def test_latency_and_innovation_are_those_of_the_period() -> None:
    monitor = HealthMonitor()
    for latency in (0.01, 0.05, 0.02):
        monitor.observe(with_innovation(0.3, 0.04), latency)
    report = monitor.report(counters(), FRESH)
    assert report.latency_median_s == 0.02
    assert report.latency_max_s == 0.05
    assert report.normalized_innovation_squared == pytest.approx(2.25)
    assert report.condition_number == with_innovation(0.3, 0.04).condition_number
    nothing = monitor.report(counters(), FRESH)
    assert math.isnan(nothing.latency_median_s)
    assert math.isnan(nothing.latency_max_s)
    assert nothing.sequence == 1


@pytest.mark.parametrize("count", [FEWEST_INNOVATIONS - 1, FEWEST_INNOVATIONS])
def test_a_few_innovations_are_no_reason_to_warn(count: int) -> None:
    monitor = HealthMonitor()
    for _ in range(count):
        monitor.observe(with_innovation(1.0, 0.04), 0.001)
    level = monitor.report(counters(), FRESH).level
    assert level == (Level.ERROR if count == FEWEST_INNOVATIONS else Level.OK)


def test_the_share_of_refused_observations_is_of_those_of_the_period() -> None:
    """Standing still is no refusal; all refused is an error, one of many a warning."""
    monitor = HealthMonitor()
    monitor.observe(update(0, Outcome.STANDSTILL), 0.001)
    assert monitor.report(counters(), FRESH).level is Level.OK
    monitor.observe(update(1, Outcome.GATED), 0.001)
    refused = monitor.report(counters(), FRESH)
    assert (refused.level, refused.accepted, refused.rejected) == (Level.ERROR, 0, 2)
    for number in range(9):
        monitor.observe(update(2 + number), 0.001)
    monitor.observe(update(11, Outcome.GATED), 0.001)
    found = monitor.report(counters(), FRESH)
    assert found.level is Level.WARN
    assert "refused: 1 GATED" in found.summary
    assert found.outcomes == {Outcome.STANDSTILL: 1, Outcome.GATED: 2, Outcome.ACCEPTED: 9}


def test_an_input_without_a_message_is_told_with_its_age() -> None:
    report = HealthMonitor().report(counters(), FRESH | {"odom": 2.34})
    assert "no data on odom for 2.3 s" in report.summary
    assert {entry.topic: entry.age_s for entry in report.inputs}["odom"] == 2.34
    silent = HealthMonitor().report(counters(), {})
    assert "no data on odom since the start" in silent.summary


def test_a_wheel_of_one_span_alone_keeps_its_sum() -> None:
    first, later = WheelSpan(), WheelSpan()
    first.add(1, [("left", 0.5)])
    later.add(2, [("right", 0.25)])
    both = first + later
    assert both.sums == {"left": 0.5, "right": 0.25}
    assert (both.stamp_ns, both.count) == (2, 2)
