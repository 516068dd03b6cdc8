# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""State of health: counts, and the worst of the last period in words."""

import dataclasses
import math

import pytest

from msg_defs.msg import EstimatorHealth
from terrain_estimator.bags import Types
from terrain_estimator.estimator.intake import mostly_refused
from terrain_estimator.messaging.diagnostics import FIT, MODEL, REFUSED, Check, Level
from terrain_estimator.messaging.health import Health, HealthMonitor
from terrain_estimator.messaging.messages import Meta, health_message
from terrain_estimator.messaging.pairing import Counters
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import INPUT_TYPES
from terrain_estimator.update import Disagreement, RowFit, Seconds
from tests.terrain_estimator.messaging.test_messages import decided, updated

FRESH = dict.fromkeys(INPUT_TYPES, 0.05)


def counters(**changes: Counters) -> dict[str, Counters]:
    return {topic: changes.get(topic, Counters(received=10, paired=10)) for topic in INPUT_TYPES}


def after(*outcomes: Outcome, monitor: HealthMonitor | None = None) -> Health:
    monitor = monitor or HealthMonitor()
    for outcome in outcomes:
        monitor.observe(updated(decided(outcome)), 0.001)
    return monitor.report(counters(), FRESH)


@pytest.mark.parametrize(
    ("outcomes", "level", "word"),
    [
        ([Outcome.ACCEPTED] * 10, Level.OK, "estimating"),
        ([Outcome.STANDSTILL] * 10, Level.OK, "standing still"),
        ([Outcome.NOT_PLANAR] * 10, Level.WARN, "10 NOT_PLANAR (nothing is learnt there"),
        ([Outcome.ACCEPTED] * 9 + [Outcome.NOT_FINITE], Level.WARN, "1 NOT_FINITE"),
        ([Outcome.WRONG_WHEELS] * 10, Level.ERROR, "wheel names of the rover file"),
        ([Outcome.ACCEPTED] * 9 + [Outcome.NUMERICAL_FAILURE], Level.ERROR, "NUMERICAL_FAILURE"),
        ([], Level.OK, "waiting"),
    ],
)
def test_the_level_is_that_of_the_worst(outcomes: list[Outcome], level: Level, word: str) -> None:
    health = after(*outcomes)
    assert health.level is level
    assert word in health.summary


def test_silence_on_a_required_topic_is_stale_and_named_and_on_an_optional_one_it_is_not() -> None:
    health = HealthMonitor().report(counters(), FRESH | {"odom": 1.5})
    assert (health.level, "odom" in health.summary) == (Level.STALE, True)
    assert HealthMonitor().report(counters(), {}).level is Level.STALE
    assert HealthMonitor().report(counters(), FRESH | {"imu": math.nan}).level is Level.OK


def test_a_node_that_is_configured_again_reports_a_failed_callback_once() -> None:
    monitor = HealthMonitor()
    monitor.failures = 2
    assert "2 callbacks failed" in after(Outcome.ACCEPTED, monitor=monitor).summary
    again = HealthMonitor(monitor.reported_failures)
    again.failures = 2  # the node goes on counting
    assert after(Outcome.ACCEPTED, monitor=again).level is Level.OK
    again.failures = 3
    assert "1 callbacks failed" in after(Outcome.ACCEPTED, monitor=again).summary


def test_counts_go_on_and_statistics_start_anew_with_every_report() -> None:
    monitor = HealthMonitor()
    first = after(*[Outcome.ACCEPTED] * 3, Outcome.NOT_FINITE, monitor=monitor)
    assert (first.sequence, first.accepted, first.rejected, first.latency_median_s) == (
        0,
        3,
        1,
        0.001,
    )
    assert first.normalized_innovation_squared == pytest.approx(0.7)
    second = monitor.report(counters(), FRESH)
    assert (second.sequence, second.accepted, second.rejected, second.level) == (1, 3, 1, Level.OK)
    assert math.isnan(second.normalized_innovation_squared)


def test_a_refused_second_is_ten_refused_observations_and_counted_when_it_ends() -> None:
    monitor = HealthMonitor()
    for waiting in range(1, 10):
        accepted = decided()._replace(settled=0)
        monitor.observe(updated(accepted, observations_waiting=waiting), 0.001)
    waits = monitor.report(counters(), FRESH)
    assert (waits.accepted, waits.rejected, waits.summary) == (0, 0, "estimating")
    gated = decided(Outcome.GATED)._replace(settled=9)
    monitor.observe(updated(gated), 0.001)
    found = monitor.report(counters(), FRESH)
    assert (found.accepted, found.rejected) == (0, 10)
    assert (found.seconds_taken, found.seconds_refused) == (0, 1)
    assert "10 GATED" in found.summary
    assert found.level is Level.ERROR, "all that was settled was refused"


@pytest.mark.parametrize(
    ("judged", "taken", "level"),
    [(9, 0, Level.OK), (60, 54, Level.OK), (60, 53, Level.WARN), (20, 9, Level.ERROR)],
)
def test_a_model_that_leaves_seconds_out_is_a_finding(
    judged: int, taken: int, level: Level
) -> None:
    """The reason in words is that of the estimate's status."""
    monitor, seconds = HealthMonitor(), Seconds(judged, taken)
    told = updated(seconds=seconds)._replace(disagreements=mostly_refused(seconds))
    monitor.observe(told, 0.001)
    health = monitor.report(counters(), FRESH)
    [found] = [each for each in health.findings if each.check is MODEL]
    assert found.level is health.level is level
    assert f"{taken} of the last {judged} seconds of driving were taken" in found.text
    assert found.text.startswith("the model does not fit") == (level is Level.ERROR)


def test_seconds_that_were_taken_but_miss_by_too_much_are_an_error_of_the_model() -> None:
    monitor = HealthMonitor()
    reason = Disagreement("the last 20 seconds miss it", "check the model")
    monitor.observe(updated(seconds=Seconds(60, 60))._replace(disagreements=(reason,)), 0.001)
    health = monitor.report(counters(), FRESH)
    assert health.level is Level.ERROR
    assert "the last 20 seconds miss it" in health.summary


def test_the_row_that_misses_most_is_told_and_no_fault() -> None:
    monitor = HealthMonitor()
    fit = (RowFit("velocity", 0.1, 1.0), RowFit("torque_1", -1.2, 0.5), RowFit("load", 0.0, 1.2))
    monitor.observe(updated(fit=fit), 0.001)
    health = monitor.report(counters(), FRESH)
    [found] = [each for each in health.findings if each.check is FIT]
    assert found.value == pytest.approx(1.3)
    assert found.level is Level.OK
    assert found.text == "row torque_1 misses by 1.30 predicted deviations, most of all"
    [unknown] = [each for each in HealthMonitor().report({}, {}).findings if each.check is FIT]
    assert math.isnan(unknown.value)


def test_losses_are_reported_once() -> None:
    monitor = HealthMonitor()
    lossy = counters(wheel_slip=Counters(received=10, lost=2, out_of_order=1))
    assert "wheel_slip: 2 lost, 1 out of order" in monitor.report(lossy, FRESH).summary
    assert monitor.report(lossy, FRESH).level is Level.OK


def test_what_was_lost_in_one_report_and_comes_late_in_the_next_is_out_of_order() -> None:
    monitor = HealthMonitor()
    assert (
        "wheel_slip: 1 lost"
        in monitor.report(counters(wheel_slip=Counters(received=10, lost=1)), FRESH).summary
    )
    late = monitor.report(counters(wheel_slip=Counters(received=11, out_of_order=1)), FRESH)
    assert (late.level, late.inputs[0].lost) == (Level.WARN, 0)
    assert "wheel_slip: 1 out of order" in late.summary


def test_a_topic_may_be_faster_than_the_slip_and_one_that_lacks_is_told() -> None:
    for topic in ("imu", "odom"):
        assert (
            HealthMonitor()
            .report(counters(**{topic: Counters(received=100, unpaired=90)}), FRESH)
            .level
            is Level.OK
        )
    lacking = counters(
        wheel_slip=Counters(received=10, unpaired=2), odom=Counters(received=20, unpaired=12)
    )
    monitor = HealthMonitor()
    assert "wheel_slip: 2 without partner" in (summary := monitor.report(lacking, FRESH).summary)
    assert "odom: 12 without partner" in summary
    lacking["odom"].unpaired += 10
    assert monitor.report(lacking, FRESH).level is Level.OK


def test_a_failed_callback_is_an_error() -> None:
    monitor = HealthMonitor()
    monitor.failures += 1
    assert monitor.report(counters(), FRESH).level is Level.ERROR
    assert monitor.report(counters(), FRESH).level is Level.OK


def test_the_message_carries_every_outcome_and_input() -> None:
    types = Types()
    health = dataclasses.replace(after(Outcome.ACCEPTED, Outcome.GATED), resets=2)
    message = health_message(
        health, types.make, Meta("m", "a", "b", (), "base_link"), types.make("std_msgs/msg/Header")
    )
    assert dict(zip(message.outcome, message.outcome_count.tolist(), strict=True))["GATED"] == 1
    assert message.input_topic == list(INPUT_TYPES)
    assert (message.accepted, message.rejected, message.resets, message.model_id) == (1, 1, 2, "m")
    assert message.input_age.tolist() == [0.05] * 5
    assert {level.name: level.value for level in Level} == {
        level.name: getattr(EstimatorHealth, level.name) for level in Level
    }


def test_a_finding_says_its_number_with_its_unit_and_a_ratio_without_one() -> None:
    assert REFUSED.judge(0.5).text == "share of observations refused since the last report is 0.5"
    assert Check("age", "age of the state", "s", "").judge(2.0).text == "age of the state is 2 s"
