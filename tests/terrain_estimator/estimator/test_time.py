# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Stamps case by case through pairing and estimator: the table in docs/estimator.md."""

import math
from typing import Any

import pytest

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.pairing import RESTART_AFTER
from terrain_estimator.messaging.pipeline import Answer, Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.outcome import Outcome
from tests.drives import STEP_NS, Event, drive_messages

STEPS = 40


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


def steps() -> list[list[Event]]:
    """The messages of each instant."""
    events = list(drive_messages(Types().make, STEPS / 10))
    return [events[at : at + 5] for at in range(0, len(events), 5)]


def shifted(events: list[Event], by_ns: int) -> list[Event]:
    stamps = {
        id(message.header.stamp): message.header.stamp for _, _, message in events
    }  # the messages of an instant share one
    for stamp in stamps.values():
        stamp.sec, stamp.nanosec = divmod(stamp.sec * 10**9 + stamp.nanosec + by_ns, 10**9)
    return events


def play(pipeline: Pipeline, instants: list[list[Event]]) -> list[Answer]:
    return [
        answer
        for events in instants
        for topic, _, message in events
        for answer in pipeline.add(topic, message)
    ]


def told(answers: list[Answer]) -> list[str]:
    return [warning for answer in answers for warning in answer.update.warnings]


def estimates(answers: list[Answer]) -> list[tuple[Any, ...]]:
    return [
        (each.update.stamp_ns, each.update.estimate.mean.tobytes(), each.update.decision.outcome)
        for each in answers
    ]


def test_a_bag_that_loops_starts_from_the_prior_and_says_so_once(model: LoadedModel) -> None:
    pipeline = Pipeline(model, EstimatorConfig())
    first, second = play(pipeline, steps()), play(pipeline, steps())
    assert told(first) == []
    [warning] = told(second)
    assert (
        "the clock went back by 3.0 s" in warning
    )  # 3.9 s, of which it takes nine messages to be certain
    assert estimates(second) == estimates(
        play(Pipeline(model, EstimatorConfig()), steps()[RESTART_AFTER - 1 :])
    )
    assert {name: count.out_of_order for name, count in pipeline.counters.items()} == dict.fromkeys(
        pipeline.inputs, RESTART_AFTER - 1
    )
    assert [each.update.sequence for each in (*first, *second)] == list(
        range(len(first) + len(second))
    )


def test_a_step_back_of_less_than_a_second_costs_the_messages_that_are_not_later(
    model: LoadedModel,
) -> None:
    pipeline = Pipeline(model, EstimatorConfig())
    instants = steps()
    answers = play(pipeline, instants[:20]) + play(
        pipeline, [shifted(events, -3 * STEP_NS) for events in instants[20:]]
    )
    assert told(answers) == []
    assert len(answers) == STEPS - 3
    assert pipeline.counters["odom"].out_of_order == 3


def test_after_a_minute_without_messages_what_was_known_holds(model: LoadedModel) -> None:
    pipeline = Pipeline(model, EstimatorConfig())
    instants = steps()
    before = play(pipeline, instants[:20])
    after = play(pipeline, [shifted(events, 60 * 10**9) for events in instants[20:]])
    assert told(after) == []
    assert {each.update.decision.outcome for each in after} == {Outcome.ACCEPTED}
    assert after[-1].update.estimate.covariance[0, 0] < before[-1].update.estimate.covariance[0, 0]
    assert after[-1].update.estimate.time_used_s < STEPS / 10 + 1.0  # the gap is no time of driving


def restarted(model: LoadedModel, saved: dict[str, Any]) -> Pipeline:
    pipeline = Pipeline(model, EstimatorConfig())
    pipeline.restore(saved)
    return pipeline


def test_a_saved_state_outlives_a_clock_that_begins_anew(model: LoadedModel) -> None:
    first = Pipeline(model, EstimatorConfig())
    before = play(first, steps()[:25])  # in the middle of a block
    saved = first.save()
    earlier = play(
        restarted(model, saved), [shifted(events, -100 * 10**9) for events in steps()[25:]]
    )
    later = play(restarted(model, saved), [shifted(events, 100 * 10**9) for events in steps()[25:]])
    [warning] = told(earlier)
    assert "stamps begin 99.9 s before those of the saved state" in warning
    assert told(later) == []
    assert [each[1:] for each in estimates(earlier)] == [each[1:] for each in estimates(later)], (
        "as after a pause"
    )
    assert {each.update.decision.outcome for each in earlier} == {Outcome.ACCEPTED}
    known, again = before[-1].update.estimate, earlier[0].update.estimate
    assert (known.observations_used, known.observations_waiting) == (20, 5)
    assert (again.observations_used, again.observations_waiting) == (25, 1), "the gap ended it"
    assert (
        earlier[-1].update.estimate.covariance[0, 0] < before[-1].update.estimate.covariance[0, 0]
    )
    assert math.isnan(earlier[0].update.prediction.innovation)


def test_a_bag_that_loops_after_a_restart_is_told_from_the_restart(model: LoadedModel) -> None:
    first = Pipeline(model, EstimatorConfig())
    play(first, steps()[:15])
    pipeline = restarted(model, first.save())
    answers = play(pipeline, [*steps()[:13], *steps()[:13]])
    assert ["saved state" in warning for warning in told(answers)] == [True, False]
    assert (pipeline.resets, first.resets) == (1, 0)


def test_duplicates_and_late_messages_are_counted_and_change_nothing(model: LoadedModel) -> None:
    plain, pipeline = Pipeline(model, EstimatorConfig()), Pipeline(model, EstimatorConfig())
    instants = steps()
    twice = [[*events, *events] for events in instants]
    assert estimates(play(pipeline, twice)) == estimates(play(plain, steps()))
    assert pipeline.counters["wheel_slip"].out_of_order == STEPS


def test_the_order_of_topics_within_the_time_out_changes_nothing(model: LoadedModel) -> None:
    instants = steps()
    late_imu = [[event for event in events if event[0] != "imu"] for events in instants]
    for at in range(3, len(instants)):
        late_imu[at] += [event for event in instants[at - 3] if event[0] == "imu"]
    reordered = play(Pipeline(model, EstimatorConfig()), late_imu)
    assert (
        estimates(reordered)
        == estimates(play(Pipeline(model, EstimatorConfig()), steps()))[: len(reordered)]
    )
    assert len(reordered) == STEPS - 3


def test_a_whole_instant_from_the_far_future_is_followed_and_given_up_when_time_goes_on(
    model: LoadedModel,
) -> None:
    pipeline = Pipeline(model, EstimatorConfig())
    instants = steps()
    glitch = shifted(steps()[20], 10**6 * 10**9)
    answers = play(pipeline, [*instants[:20], glitch, *instants[20:]])
    assert len(told(answers)) == 1
    assert "the clock went back by" in told(answers)[0]
    assert answers[-1].update.stamp_ns == instants[-1][0][1]
