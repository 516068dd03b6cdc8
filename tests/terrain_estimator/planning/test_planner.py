# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Advice of the planner: unknown margins, go on, stop before the rover digs in."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.bags import Types
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.messaging.messages import Status
from terrain_estimator.observation import Observation
from terrain_estimator.planning.belief import Belief
from terrain_estimator.planning.messages import advice_message, belief_of_message
from terrain_estimator.planning.planner import Advice, Planner, Reason
from terrain_estimator.topics import ESTIMATE
from tests.terrain_estimator.planning.support import (
    FIRM,
    METADATA,
    ROVER,
    SOFT,
    belief,
    drive,
    drive_gets_stuck,
    table,
)

UNKNOWN = belief((2750.0, 0.6), (1300.0, 0.22), identified=False, changed=1.0)


def planner(**values: Any) -> Planner:
    return Planner(table(), METADATA.prior_mean, METADATA.prior_sd, configure(AdviceConfig, values))


def advice(observations: list[Observation], known: Belief, **values: Any) -> Advice:
    given = planner(**values)
    for observation in observations:
        given.observe(observation)
    given.believe(known)
    found = given.advise(observations[-1].stamp_ns)
    assert found is not None
    return found


def standing(stamp_ns: int = 0) -> Observation:
    """Return the measurements of standing wheels: no slip, the pitch."""
    one = drive()[0][0]
    nothing = np.full(3, math.nan)
    return dataclasses.replace(
        one,
        stamp_ns=stamp_ns,
        wheel_rate=np.zeros(3),
        velocity=0.0,
        pitch=0.02,
        slip=nothing,
        torque=nothing,
    )


def before(axles: int) -> list[Observation]:
    """Return the measurements up to the last with so many axles on the soft ground."""
    observations, inside = drive()
    return observations[: len(inside) - inside[::-1].index(axles)]


def test_before_anything_is_known_there_is_no_advice() -> None:
    given = planner()
    assert given.advise(0) is None
    given.believe(UNKNOWN)
    assert given.advise(0) is None


def test_until_both_are_identified_the_margins_are_unknown() -> None:
    found = advice(before(0), belief(FIRM, identified=False))
    assert not found.known
    assert math.isnan(found.margins.available.median)
    assert math.isnan(found.margins.stall_probability)
    assert math.isfinite(found.slip + found.sinkage + found.rim_speed)
    assert 0.0 < found.speed_limit < advice(before(0), belief(FIRM)).speed_limit


def test_an_estimate_of_a_model_that_does_not_fit_calls_nothing_safe() -> None:
    """Neither the ground under the rover nor that of its front wheels, though it would hold."""
    for known in (belief(FIRM, disagrees=True), belief(SOFT, identified=False, disagrees=True)):
        found = advice(before(0), known)
        assert (found.known, found.stop) == (False, False)
        assert math.isnan(found.margins.available.median)
        assert math.isnan(found.margins.stall_probability)
        assert math.isnan(found.front_stall_probability)
        unknown = advice(before(0), belief(FIRM, identified=False))
        assert found.speed_limit == unknown.speed_limit
        assert words(found) == (
            "margins unknown: the model of the estimate does not fit this rover or ground; go on;"
            " front wheels not judged: no model that fits"
        )


def test_what_is_measured_stops_a_rover_whose_model_does_not_fit() -> None:
    dug_in = [dataclasses.replace(each, slip=np.full(3, 0.9)) for each in before(0)]
    found = advice(dug_in, belief(FIRM, disagrees=True))
    assert (found.reason, found.speed_limit) == (Reason.SLIP, 0.0)


def test_the_status_of_the_message_tells_that_the_model_does_not_fit() -> None:
    made = {"soil": ["a"], "soil_probability": [1.0], "covariance": np.array([1.0, 0, 0, 1.0])}
    for status in Status:
        message = Types().make(ESTIMATE, status=int(status), **made)
        assert belief_of_message(message, ["a"]).disagrees is (status is Status.DISAGREES)


def test_on_ground_that_holds_it_goes_on() -> None:
    found = advice(before(0), belief(FIRM))
    assert (found.known, found.stop) == (True, False)
    assert found.margins.available.lower > found.margins.needed
    assert found.margins.slip.lower < found.slip < found.margins.slip.upper


def test_soft_ground_under_the_front_wheels_alone_stops_a_rover_that_still_drives_well() -> None:
    found = advice(before(1), UNKNOWN)
    assert found.reason is Reason.FRONT
    assert found.slip < 0.4
    assert found.speed_limit == 0.0


def test_without_torque_the_front_wheels_tell_nothing() -> None:
    blind = [dataclasses.replace(each, torque=np.full(3, math.nan)) for each in before(1)]
    found = advice(blind, belief(FIRM))
    assert math.isnan(found.front_stall_probability)
    assert not found.stop
    assert words(found) == "go on; front wheels not judged: no wheel torque"


def words(found: Advice, **estimate: Any) -> str:
    """Return the advice in words, after an estimate."""
    types = Types()
    return str(advice_message(found, types.make, 0, types.make(ESTIMATE, **estimate)).status_text)


def test_the_words_say_what_is_not_judged_and_what_is_left_out() -> None:
    moving = before(0)
    assert words(advice(moving, belief(FIRM))) == "go on"
    left_out = words(advice(moving, belief(FIRM)), effect=["payload", "grousers"])
    assert left_out == "go on; effects in the model are not taken into account: payload, grousers"
    no_depth = [dataclasses.replace(each, sinkage=np.full(3, math.nan)) for each in moving]
    assert words(advice(no_depth, belief(FIRM))).endswith(
        "no sinkage of the front wheels; sinkage not judged: no measurement"
    )
    assert words(advice([standing()], UNKNOWN)).endswith(
        "not identified; creep: no measurement while driving within the last seconds"
    )


def test_known_weak_ground_under_the_rover_is_a_reason_to_stop() -> None:
    assert advice(before(0), belief(SOFT, (50.0, 0.01))).reason is Reason.TRACTION


@pytest.mark.parametrize(
    ("name", "value", "reason"), [("slip", 0.7, Reason.SLIP), ("sinkage", 0.08, Reason.SINKAGE)]
)
def test_wheels_that_dig_in_are_a_reason_to_stop(name: str, value: float, reason: Reason) -> None:
    changes: dict[str, Any] = {name: np.full(3, value), "torque": np.full(3, math.nan)}
    dug = [dataclasses.replace(each, **changes) for each in before(0)]
    assert advice(dug, belief(FIRM)).reason is reason


@pytest.mark.parametrize("value", [5.0, -1e6, 1e308, math.inf])
@pytest.mark.parametrize(
    "name", ["slip", "sinkage", "torque", "contact_angle", "wheel_rate", "pitch", "velocity"]
)
def test_a_few_absurd_readings_are_no_reason_to_stop(name: str, value: float) -> None:
    """One slip of 1e6 in the mean of two seconds caused a stop that held until withdrawn."""
    moving = before(0)
    absurd: dict[str, Any] = {name: value if name in ("pitch", "velocity") else np.full(3, value)}
    for place in range(-9, 0, 3):
        moving[place] = dataclasses.replace(moving[place], **absurd)
    found, usual = advice(moving, belief(FIRM)), advice(before(0), belief(FIRM))
    assert (found.stop, found.known) == (usual.stop, True) == (False, True)
    assert found.slip == pytest.approx(usual.slip, abs=0.05)
    assert found.sinkage == pytest.approx(usual.sinkage, abs=0.003)
    assert found.slope == pytest.approx(usual.slope, abs=0.01)
    assert found.rim_speed == pytest.approx(usual.rim_speed, rel=0.1)
    assert found.front_stall_probability == pytest.approx(usual.front_stall_probability, abs=0.1)


def test_a_stop_holds_until_it_is_withdrawn_and_then_a_rover_that_stands_may_creep() -> None:
    given, moving = planner(), before(1)
    for observation in moving:
        given.observe(observation)
    given.believe(UNKNOWN)
    stamps = [moving[-1].stamp_ns + step * 100_000_000 for step in range(60)]
    stopped = given.advise(stamps[0])
    assert stopped is not None
    assert stopped.reason is Reason.FRONT
    for stamp in stamps[1:50]:
        given.observe(standing(stamp))
    again = given.advise(stamps[49])
    assert again is not None
    assert (again.reason, again.moving, again.speed_limit, again.rim_speed) == (
        Reason.FRONT,
        False,
        0.0,
        0.0,
    )
    given.resume()
    usual = advice(before(0), UNKNOWN).speed_limit
    for stamp in stamps[50:]:
        given.observe(standing(stamp))
        crept = given.advise(stamp)
        assert crept is not None
        assert not crept.stop
        assert 0.0 < crept.speed_limit < usual
    for observation in moving[-20:]:
        given.observe(
            dataclasses.replace(observation, stamp_ns=observation.stamp_ns + 10_000_000_000)
        )
    judged = given.advise(moving[-1].stamp_ns + 10_000_000_000)
    assert judged is not None
    assert judged.reason is Reason.FRONT  # what is measured on the move decides again


def test_a_rover_that_has_not_moved_yet_may_creep_but_is_not_judged() -> None:
    for known in (UNKNOWN, belief(SOFT, (50.0, 0.01))):
        found = advice([standing()], known)
        assert (found.known, found.moving, found.reason) == (known.identified, False, Reason.NONE)
        assert found.slope == 0.02
        assert math.isnan(found.slip)
        assert math.isnan(found.front_stall_probability)
        assert found.speed_limit > 0.02  # such a speed is told from standing


def test_ticking_encoders_are_told_from_driving() -> None:
    """The planner gave no advice while such a rover stood: standstill_speed has to decide."""
    ticking = dataclasses.replace(standing(), wheel_rate=np.full(3, 0.045 / ROVER.wheel_radius))
    given = planner()
    given.observe(ticking)
    given.believe(UNKNOWN)
    assert given.advise(0) is None, "it drives, and has no slip"
    found = advice([ticking], UNKNOWN, standstill_speed=0.05)
    assert (found.moving, found.speed_limit) == (
        False,
        0.1,
    ), "it may creep so that it is seen to move"
    with pytest.raises(
        ConfigError,
        match=r"too slow to be distinguished from standing \(0\.2 m/s\).*or lower standstill_speed",
    ):
        planner(standstill_speed=0.1)


BLIND: dict[str, dict[str, Any]] = {
    "pitch": {"pitch": math.nan},
    "velocity": {"velocity": math.nan},
    "slip of every wheel": {"slip": np.full(3, math.nan)},
    "driving forward": {"wheel_rate": np.full(3, -1.0), "velocity": -0.1},
    "pitch of a rover that stands": {"pitch": math.nan, "wheel_rate": np.zeros(3)},
    "slip and wheel rates": {
        "slip": np.full(3, math.nan),
        "wheel_rate": np.full(3, math.nan),
        "velocity": 0.0,
    },
}


@pytest.mark.parametrize("missing", BLIND)
def test_what_was_measured_before_the_window_is_no_advice_under_a_new_stamp(missing: str) -> None:
    given, moving = planner(), before(0)
    for observation in [*moving, standing(moving[-1].stamp_ns + 1)]:
        given.observe(observation)
    given.believe(belief(FIRM))
    last = moving[-1].stamp_ns
    assert given.advise(last + 1_900_000_000) is not None
    assert given.advise(last + 2_100_000_000) is None  # nothing paired any more
    assert given.advise(last - 60_000_000_000) is None  # estimates of a bag that loops came first
    for step in range(1, 31):
        given.observe(
            dataclasses.replace(moving[-1], stamp_ns=last + step * 100_000_000, **BLIND[missing])
        )
    assert given.advise(last + 3_000_000_000) is None


def test_without_its_pitch_a_rover_gets_no_advice_from_the_start() -> None:
    given, moving = planner(), before(0)
    for observation in moving:
        given.observe(dataclasses.replace(observation, pitch=math.nan))
    given.believe(belief(FIRM))
    assert given.advise(moving[-1].stamp_ns) is None


def test_a_speed_that_nobody_can_tell_from_standing_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"reaction_time and deceleration allow 0\.0058 m/s"):
        planner(reaction_time=60.0)


def test_a_bag_that_loops_starts_a_new_window() -> None:
    observations = before(0)
    given = planner()
    for observation in [*observations, *observations[:5]]:
        given.observe(observation)
    given.believe(belief(FIRM))
    found, alone = given.advise(observations[4].stamp_ns), advice(observations[:5], belief(FIRM))
    assert found is not None
    assert (found.slip, found.sinkage) == (alone.slip, alone.sinkage)


def test_each_parameter_changes_the_advice() -> None:
    unsure = belief((2000.0, 0.55), (900.0, 0.15))
    differences: dict[str, tuple[float, Callable[[Advice, Advice], bool]]] = {
        "slip_limit": (0.3, lambda a, b: b.margins.available.median < a.margins.available.median),
        "pull_deviation": (
            0.1,
            lambda a, b: b.margins.slope_limit.lower < a.margins.slope_limit.lower,
        ),
        "window": (0.3, lambda a, b: a.slip != b.slip),
        "reaction_time": (5.0, lambda a, b: b.speed_limit < a.speed_limit),
        "deceleration": (0.01, lambda a, b: b.speed_limit < a.speed_limit),
        "sinkage_limit": (0.02, lambda a, b: (a.reason, b.reason) == (Reason.NONE, Reason.SINKAGE)),
        "stop_probability": (
            0.001,
            lambda a, b: (a.reason, b.reason) == (Reason.NONE, Reason.TRACTION),
        ),
    }
    plain = advice(before(0), unsure)
    for name, (value, differs) in differences.items():
        assert differs(plain, advice(before(0), unsure, **{name: value})), name


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("soil", ["mud"], "its soils are mud"),
        ("tan_phi", math.inf, "not finite"),
        ("change_probability", math.nan, "not finite"),
        ("covariance", np.array([-1.0, 0.0, 0.0, 1.0]), "variance is negative"),
        ("soil_probability", np.array([1.0]), "one number for each soil"),
        ("soil_probability", np.array([2.0, -1.0]), "none negative"),
        ("soil_probability", np.zeros(2), "not all zero"),
        ("fit_spread", np.array([1.0, math.nan]), "not finite"),
        ("fit_offset", np.array([0.0, -1e200]), "is above 100"),
        ("fit_offset", np.zeros(3), "fit_offset has 3 numbers, fit_spread 2"),
    ],
)
def test_an_estimate_that_cannot_be_used_is_refused(name: str, value: Any, words: str) -> None:
    soils = ["loose_sand", "regolith"]
    fields = {
        "soil": soils,
        "soil_probability": np.array([0.75, 0.25]),
        "covariance": np.array([1.0, 0.0, 0.0, 1.0]),
        "fit_offset": np.zeros(2),
        "fit_spread": np.ones(2),
    }
    assert belief_of_message(Types().make(ESTIMATE, **fields), soils).soil_probability == (
        0.75,
        0.25,
    )
    with pytest.raises(ValueError, match=words):
        belief_of_message(Types().make(ESTIMATE, **fields | {name: value}), soils)


@pytest.mark.parametrize(
    ("offset", "spread", "factor"),
    [([], [], 1.0), ([0.1, 0.0], [0.9, 0.8], 1.0), ([0.0, 0.5], [1.2, 1.1], (1.44 + 1.46) / 2.0)],
)
def test_rows_that_miss_by_more_than_their_noise_widen_what_is_believed(
    offset: list[float], spread: list[float], factor: float
) -> None:
    covariance = np.array([4.0, 0.5, 0.5, 1.0])
    fit = {"fit_offset": np.array(offset), "fit_spread": np.array(spread)}
    message = Types().make(
        ESTIMATE, soil=["a"], soil_probability=[1.0], covariance=covariance, **fit
    )
    believed = belief_of_message(message, ["a"]).covariance
    np.testing.assert_allclose(believed, factor * covariance.reshape(2, 2))


def test_without_the_planner_the_same_drive_ends_in_the_sand() -> None:
    assert drive_gets_stuck()
