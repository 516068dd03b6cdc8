# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Runs in bounded memory, without losses in their sums."""

import math

import pytest

from terrain_estimator.messaging.history import RunHistory, WheelHistory
from terrain_estimator.outcome import Outcome
from tests.terrain_estimator.updates import START_NS, STEP_NS, update


@pytest.mark.parametrize("observations", [1, 8, 9, 100, 1000])
def test_a_long_run_takes_no_more_spans_than_fit_and_its_sums_are_those_of_all_observations(
    observations: int,
) -> None:
    history = RunHistory(capacity=8)
    for number in range(observations):
        history.add(
            update(
                number,
                Outcome.GATED if number % 10 == 5 else Outcome.ACCEPTED,
                innovation=0.03 if number % 4 == 0 else 0.01,
            )
        )
        assert len(history.spans) <= 8
    whole = sum(history.spans[1:], start=history.spans[0])
    gated = sum(number % 10 == 5 for number in range(observations))
    used = [number for number in range(observations) if number % 10 != 5]
    wild = sum(number % 4 == 0 for number in used)
    assert whole.outcomes == {Outcome.ACCEPTED: len(used)} | (
        {Outcome.GATED: gated} if gated else {}
    )
    assert whole.errors.count == whole.nis_count == len(used)
    assert (
        whole.errors.inside_68 == whole.errors.inside_95 == len(used) - wild
    )  # one deviation and three
    assert whole.errors.rms == pytest.approx(
        math.sqrt((9e-4 * wild + 1e-4 * (len(used) - wild)) / len(used))
    )
    assert whole.errors.predicted_rms == pytest.approx(0.01)
    assert whole.nis == pytest.approx((9 * wild + len(used) - wild) / len(used))
    assert whole.stamp_ns == START_NS + (observations - 1) * STEP_NS
    assert whole.estimate.observations_used == observations
    assert len({span.count for span in history.spans[:-1]}) <= 1


def test_a_short_rise_of_the_change_probability_stays_visible() -> None:
    history = RunHistory(capacity=4)
    for number in range(200):
        history.add(
            update(number, change=0.9 if number == 77 else math.nan if number < 10 else 0.01)
        )
    assert max(span.change_probability for span in history.spans) == 0.9


def test_a_run_without_predictions_has_no_error() -> None:
    history = RunHistory()
    history.add(update(0, Outcome.STANDSTILL))
    assert math.isnan(history.spans[0].errors.rms)
    assert math.isnan(history.spans[0].errors.predicted_rms)
    assert math.isnan(history.spans[0].nis)


@pytest.mark.parametrize("messages", [1, 8, 9, 1000])
def test_what_wheels_did_is_kept_as_means_of_those_that_were_measured(messages: int) -> None:
    history = WheelHistory(("left", "right", "idle"), capacity=8)
    for number in range(messages):
        left = math.nan if number % 2 else 0.1
        history.add(
            START_NS + number * STEP_NS,
            ["right", "of_another_rover", "left"],
            [-0.001 * number, 5.0, left],
        )
        assert len(history.spans) <= 8
    whole = sum(history.spans[1:], start=history.spans[0])
    assert (whole.count, whole.stamp_ns) == (messages, START_NS + (messages - 1) * STEP_NS)
    assert whole.mean("left") == pytest.approx(0.1)
    assert whole.mean("right") == pytest.approx(-0.0005 * (messages - 1))
    assert math.isnan(whole.mean("idle"))
    assert math.isnan(whole.mean("of_another_rover"))
