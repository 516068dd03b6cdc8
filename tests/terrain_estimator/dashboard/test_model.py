# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Answers to a viewer, without ROS and without a browser."""

import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from rover_parameters.parameters import configure
from terrain_estimator.bags import Types
from terrain_estimator.config.dashboard import ShownConfig
from terrain_estimator.dashboard.model import Cursor, LiveModel
from terrain_estimator.dashboard.values import MOST
from terrain_estimator.messaging.messages import Status
from tests.terrain_estimator.dashboard.messages import (
    WHEELS,
    advice,
    estimate,
    health,
    instant,
    measured,
    refused,
    truth,
)

make = Types().make


def drive(model: LiveModel, steps: range) -> None:
    for step in steps:
        for topic, message in instant(make, step):
            model.take(topic, message, 0.1 * step)


def all_of(model: LiveModel, now_s: float = 0.0) -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(model.update(Cursor(), now_s))
    return answer


def column(answer: dict[str, Any], name: str, part: str = "recent") -> list[float | None]:
    at = answer["begin"]["columns"].index(name)
    return [row[at] for row in answer[part]]


def test_values_of_now_and_rows_are_those_of_the_topics() -> None:
    model = LiveModel("one", ShownConfig(window_s=10.0, points=100))
    model.take("ground_truth/terrain", truth(make), 0.0)
    drive(model, range(21))
    answer = all_of(model, 2.5)
    last = estimate(make, 20)
    for name in (
        "cohesion",
        "cohesion_stddev",
        "cohesion_lower_95",
        "cohesion_upper_95",
        "tan_phi",
        "change_probability",
        "sequence",
    ):
        assert answer["now"]["terrain_estimate"][name] == getattr(last, name)
    assert answer["now"]["odom"]["heading"] == pytest.approx(0.5)
    assert column(answer, "time") == pytest.approx(
        [0.1 * step for step in range(19)]
    )  # the last two are not complete yet
    assert column(answer, "cohesion") == [1500.0 + step for step in range(19)]
    assert column(answer, "slip_2") == pytest.approx([0.12 + 1e-4 * step for step in range(19)])
    assert column(answer, "sinkage_3") == pytest.approx([0.018 + 1e-5 * step for step in range(19)])
    assert column(answer, "truth_cohesion") == [1480.0] * 19
    assert answer["ages"]["terrain_estimate"] == pytest.approx(0.5)
    assert column(answer, "cohesion", "whole") == column(answer, "cohesion")


def test_rows_are_of_one_instant_though_a_topic_lags_behind_the_others() -> None:
    model = LiveModel("one", ShownConfig(window_s=10.0, points=100))
    drive(model, range(10))
    for step in range(10, 60):  # the estimate of an instant comes after the next slip, or later
        for topic, message in measured(make, step):
            model.take(topic, message, 0.1 * step)
        if (late := step - 1 - step % 3) >= 10:
            model.take("terrain_estimate", estimate(make, late), 0.1 * step)
    answer = all_of(model)
    assert len(answer["recent"]) > 50
    steps = np.round(10.0 * np.array(column(answer, "time"))).astype(int)
    assert column(answer, "slip_2") == pytest.approx(0.12 + 1e-4 * steps)
    given = {step - 1 - step % 3 for step in range(10, 60)} | set(range(10))
    newest = [max(each for each in given if each <= step) for step in steps]
    assert column(answer, "cohesion") == [1500.0 + each for each in newest]


def test_the_inner_band_holds_68_percent_and_ends_at_zero() -> None:
    model = LiveModel("one", ShownConfig())
    model.take("terrain_estimate", estimate(make, 0, cohesion=50.0, cohesion_stddev=100.0), 0.0)
    now = all_of(model)["now"]["terrain_estimate"]
    half = norm.ppf(0.84)
    assert now["cohesion_lower_68"] == 0.0
    assert now["cohesion_upper_68"] == pytest.approx(50.0 + half * 100.0)
    assert now["tan_phi_lower_68"] == pytest.approx(0.6 - half * 0.0123)


def test_a_viewer_gets_only_what_it_lacks_and_one_from_before_a_restart_everything() -> None:
    model = LiveModel("one", ShownConfig(window_s=10.0, points=100))
    drive(model, range(20))
    first = all_of(model)
    drive(model, range(20, 30))
    second = json.loads(model.update(Cursor(**first["cursor"]), 0.0))
    assert "begin" not in second
    assert [row[0] for row in second["recent"]] == pytest.approx(
        [0.1 * step for step in range(18, 28)]
    )
    third = json.loads(model.update(Cursor(**second["cursor"]), 0.0))
    assert (third["recent"], third["whole"], third["journal"]) == ([], [], [])
    again = LiveModel("two", ShownConfig(window_s=10.0, points=100))
    drive(again, range(5))
    answer = json.loads(again.update(Cursor(**second["cursor"]), 0.0))
    assert len(answer["recent"]) == 3
    assert answer["begin"]["wheels"] == list(WHEELS)


def test_what_is_not_finite_is_null_and_what_is_not_heard_any_more_is_no_row() -> None:
    model = LiveModel("one", ShownConfig(window_s=10.0, points=100))
    for step in range(40):
        for topic, message in measured(make, step):
            model.take(topic, message, 0.1 * step)
        if step < 5:
            model.take(
                "terrain_estimate",
                estimate(make, step, cohesion=math.nan, change_probability=math.inf),
                0.1 * step,
            )
    answer = all_of(model)
    assert answer["now"]["terrain_estimate"]["cohesion"] is None
    assert answer["now"]["terrain_estimate"]["change_probability"] is None
    assert set(column(answer, "cohesion")) == {None}
    heard = column(answer, "tan_phi")
    assert heard[4] is not None
    assert heard[-1] is None


@pytest.mark.parametrize(
    ("name", "value", "rows", "period"),
    [("window", 24.0, 119, 0.2), ("points", 60, 60, 0.2), ("points", 120, 120, 0.1)],
)
def test_window_and_points_say_how_long_and_how_fine_the_recent_history_is(
    name: str, value: float, rows: int, period: float
) -> None:
    model = LiveModel(
        "one", configure(ShownConfig, {"window": 12.0, "points": 120} | {name: value})
    )
    drive(model, range(241))
    answer = all_of(model)
    times = [row[0] for row in answer["recent"]]
    assert len(times) == rows
    assert np.diff(times) == pytest.approx(period)
    assert answer["begin"]["window"] == (value if name == "window" else 12.0)


def test_memory_and_answers_do_not_grow_with_the_drive_nor_with_a_message() -> None:
    model = LiveModel("one", ShownConfig(window_s=10.0, points=50))
    drive(model, range(600))
    once = all_of(model)
    drive(model, range(600, 1500))
    later = all_of(model)
    assert len(later["recent"]) == len(once["recent"]) == 50
    assert len(later["whole"]) <= 50
    assert later["whole"][0][0] < 10.0  # the beginning of the drive
    model.take(
        "terrain_estimate",
        estimate(make, 1500, soil=["x"] * 10_000, status_text="y" * 10_000),
        150.0,
    )
    assert len(all_of(model)["now"]["terrain_estimate"]["soil"]) == MOST
    assert len(json.dumps(all_of(model))) < 2 * len(json.dumps(once))


def test_a_reset_is_an_event_and_an_estimator_that_began_anew_is_no_reset() -> None:
    model = LiveModel("one", ShownConfig())
    for step in range(60):
        drive(model, range(step, step + 1))
        message = health(make, step)
        message.resets = 2 if 20 <= step < 40 else 0
        model.take("estimator_health", message, 0.1 * step)
    events = [event["text"] for event in all_of(model)["journal"]]
    assert [text for text in events if "reset" in text or "restarted" in text] == [
        "the posterior was reset (2 times since the start)",
        "the estimator restarted",
    ]


def test_the_journal_says_what_happened_in_words() -> None:
    model = LiveModel("one", ShownConfig())
    drive(model, range(15))
    for step in range(15, 40):
        model.take("terrain_estimate", refused(make, step), 0.1 * step)
        model.take("estimator_health", health(make, step, 2, "no odom"), 0.1 * step)
        model.take("traction_advice", advice(make, step, stop=True), 0.1 * step)
    drive(model, range(40, 55))
    events = [(event["level"], event["text"]) for event in all_of(model)["journal"]]
    assert events == [
        ("ok", "identified"),
        ("warn", "GATED: the ground changed, or a sensor failed"),
        ("error", "health: no odom"),
        ("error", "planner: the wheels slip"),
        ("ok", "observations are accepted again"),
    ]


def test_a_model_that_does_not_fit_is_an_event_whatever_the_observation_was() -> None:
    model = LiveModel("one", ShownConfig())
    drive(model, range(15))
    text = "disagrees; the model does not fit this rover or ground: 2 of the last 20 seconds"
    for step in range(15, 40):
        message = estimate(make, step) if step % 10 else refused(make, step)
        message.status, message.status_text = int(Status.DISAGREES), text
        message.seconds_judged, message.seconds_taken = 20, 2
        model.take("terrain_estimate", message, 0.1 * step)
    answer = all_of(model)
    now = answer["now"]["terrain_estimate"]
    assert (now["status"], now["seconds_judged"], now["seconds_taken"]) == ("DISAGREES", 20, 2)
    assert now["fit_row"] == ["velocity", "torque_1"]
    assert (now["fit_offset"], now["fit_spread"]) == ([0.0412, -1.2345], [1.0123, 1.4988])
    assert ("error", text) in [(event["level"], event["text"]) for event in answer["journal"]]
    assert column(answer, "status")[-1] == Status.DISAGREES


def test_a_clock_that_was_set_back_begins_a_new_history_and_one_wild_stamp_does_not() -> None:
    model = LiveModel("one", ShownConfig(window_s=10.0, points=100))
    drive(model, range(1000, 1020))
    model.take("odom", dict(measured(make, 90_000))["odom"], 102.0)
    drive(model, range(1020, 1030))
    assert column(all_of(model), "time") == pytest.approx([0.1 * step for step in range(28)])
    drive(model, range(30))
    answer = all_of(model)
    assert len(answer["recent"]) < 30
    assert "stamps went back by 103 s" in answer["journal"][0]["text"]
    drive(model, range(30, 50))
    drive(model, range(25, 50))
    answer = all_of(model)
    assert "stamps went back by 2 s" in answer["journal"][0]["text"], "a bag of seconds that loops"
    assert 0 < len(answer["recent"]) < 25


def test_other_wheels_are_another_rover() -> None:
    model = LiveModel("one", ShownConfig(window_s=10.0, points=100))
    drive(model, range(10))
    message = dict(measured(make, 10))["wheel_slip"]
    message.wheel = ["bow", "stern"]
    model.take("wheel_slip", message, 1.0)
    answer = all_of(model)
    assert answer["recent"] == []
    assert "slip_2" not in answer["begin"]["columns"]
