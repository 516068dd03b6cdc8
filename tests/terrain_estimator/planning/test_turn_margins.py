# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Margins of a rover that turns without steering: is this turn held, and which is the tightest."""

import dataclasses
import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import Types
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.observation import Observation
from terrain_estimator.planning.belief import draw
from terrain_estimator.planning.margins import CredibleRange, Margins, margins, turn_limit
from terrain_estimator.planning.messages import advice_message
from terrain_estimator.planning.planner import Advice, Planner, Reason
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.statics import NOT_HELD, TURNS, read_statics, write_statics
from terrain_estimator.planning.table import TractionTable
from terrain_estimator.topics import ESTIMATE
from terramechanics.vehicle.turning import NO_PULL
from terramechanics.vehicle.wheel_places import WheelPlaces
from tests.rovers import FOUR_WHEELS
from tests.terrain_estimator.planning.support import METADATA, SOIL, belief, drive

TRACK = 0.8
FIRM, WEAK = (5000.0, 1.0), (500.0, 0.43)
"""c [Pa] and tan phi of ground that holds a turn on the spot, and of ground that does not."""


@cache
def skid_steer() -> TractionTable:
    statics = solve_statics(FOUR_WHEELS, (SOIL,), WheelPlaces.of(FOUR_WHEELS, TRACK))
    return TractionTable(FOUR_WHEELS, statics, 0.5 * TRACK)


def judged(
    ground: tuple[float, float], turn: float = 0.0, slope: float = 0.0, sd: float = 0.05
) -> Margins:
    """Return the margins of a ground known to a share ``sd``."""
    mean = np.array(ground)
    samples = draw(mean, np.diag((sd * mean) ** 2), (1.0,))
    config = AdviceConfig()
    return margins(skid_steer(), samples, slope, config.slip_limit, config.pull_deviation, turn)


def limit_of(ground: tuple[float, float], slope: float = 0.0) -> CredibleRange:
    """Return the share up to which a ground that is known to 5 % holds every turn."""
    mean, config = np.array(ground), AdviceConfig()
    samples = draw(mean, np.diag((0.05 * mean) ** 2), (1.0,))
    return turn_limit(skid_steer(), samples, slope, config.slip_limit, config.pull_deviation)


def turned(velocity: float, yaw_rate: float) -> list[Observation]:
    """Return four seconds of a rover that turns like that, with wheels that slip a lot."""
    arrays: dict[str, Any] = {
        "slip": np.full(2, 0.5),
        "sinkage": np.full(2, 0.02),
        "torque": np.full(2, math.nan),
        "contact_angle": np.zeros(2),
        "wheel_rate": np.full(2, velocity / FOUR_WHEELS.wheel_radius),
    }
    return [
        dataclasses.replace(
            each,
            **arrays,
            pitch=0.0,
            velocity=velocity,
            yaw_rate=yaw_rate,
            yaw_rate_sd=0.003,
            lateral_velocity=0.0,
            lateral_velocity_sd=0.005,
        )
        for each in drive()[0][:40]
    ]


def advice(ground: tuple[float, float], velocity: float, yaw_rate: float) -> Advice:
    planner = Planner(skid_steer(), METADATA.prior_mean, METADATA.prior_sd, AdviceConfig())
    observations = turned(velocity, yaw_rate)
    for observation in observations:
        planner.observe(observation)
    planner.believe(belief(ground, (0.05 * ground[0], 0.05 * ground[1])))
    found = planner.advise(observations[-1].stamp_ns)
    assert found is not None
    return found


def test_the_share_that_turns_is_that_of_the_outer_wheels() -> None:
    table = skid_steer()
    assert table.turn_of(0.1, 0.0) == 0.0
    assert table.turn_of(0.0, 0.0) == 0.0
    assert table.turn_of(0.0, -0.3) == 1.0
    assert table.turn_of(0.5 * TRACK * 0.3, 0.3) == pytest.approx(0.5)  # the inner side stands
    assert table.turn_of(0.1, 0.1) == table.turn_of(0.1, -0.1)


def test_a_turn_on_the_spot_stalls_on_ground_that_a_straight_drive_holds() -> None:
    assert judged(WEAK).stall_probability < 0.01
    assert judged(WEAK, 1.0).stall_probability > 0.99
    assert judged(FIRM, 1.0).stall_probability < 0.01


def test_margins_without_a_turn_are_those_of_the_table_without_turns() -> None:
    """Both solve the same equations, one with two wheels for one."""
    plain = TractionTable(FOUR_WHEELS, solve_statics(FOUR_WHEELS, (SOIL,)))
    assert not plain.knows_turns
    samples = draw(np.array(FIRM), np.diag([200.0**2, 0.03**2]), (1.0,))
    ours, theirs = (margins(each, samples, 0.1, 0.6, 0.015) for each in (skid_steer(), plain))
    for name in ("available", "slope_limit", "slip", "sinkage"):
        one, other = getattr(ours, name), getattr(theirs, name)
        assert one.median == pytest.approx(other.median, rel=0.01)
        assert one.lower == pytest.approx(other.lower, rel=0.02)
    assert math.isnan(turn_limit(plain, samples, 0.1, 0.6, 0.015).median)


def test_the_tightest_turn_is_where_half_of_the_samples_stall() -> None:
    for ground in (WEAK, (1500.0, 0.7)):
        limit = limit_of(ground)
        assert 0.0 < limit.lower < limit.median <= limit.upper
        assert judged(ground, limit.median).stall_probability == pytest.approx(0.5, abs=0.1)
        assert judged(ground, limit.lower).stall_probability < 0.15


def test_slopes_and_weak_ground_leave_wider_turns() -> None:
    level, uphill = (limit_of((1500.0, 0.7), slope) for slope in (0.0, 0.1))
    assert uphill.median < level.median
    assert limit_of(FIRM).lower == 1.0
    assert limit_of((0.0, 0.05)).upper == -1.0  # not even straight on


def test_the_planner_judges_the_turn_that_it_measures() -> None:
    on_the_spot = advice(WEAK, 0.0, 0.3)
    assert on_the_spot.turning
    assert on_the_spot.turn == 1.0
    assert on_the_spot.reason is Reason.TRACTION
    assert advice(FIRM, 0.0, 0.3).reason is Reason.NONE
    wide = advice(WEAK, 0.2, 0.1)
    assert wide.turn == pytest.approx(0.04 / 0.24)
    assert wide.reason is Reason.NONE


def test_a_turn_that_no_wheel_rates_hold_has_no_pull_and_no_slope() -> None:
    """Its stall probability is known all the same."""
    assert NO_PULL < NOT_HELD
    found = judged((300.0, 0.3), 1.0)
    assert found.stall_probability > 0.99
    assert math.isnan(found.available.median)
    assert math.isnan(found.slope_limit.median)


def test_weaving_is_judged_by_its_turns_and_not_by_their_mean() -> None:
    left, right = turned(0.05, 0.3), turned(0.05, -0.3)
    planner = Planner(skid_steer(), METADATA.prior_mean, METADATA.prior_sd, AdviceConfig())
    for one, other in zip(left[::2], right[1::2], strict=True):
        planner.observe(one)
        planner.observe(other)
    planner.believe(belief(FIRM))
    found = planner.advise(right[-1].stamp_ns)
    assert found is not None
    assert found.turn == pytest.approx(0.12 / 0.17)


def test_a_gyroscope_that_is_off_does_not_turn_a_rover_that_stands() -> None:
    """Wheels at rest, slips that a slip source gives all the same, and a bias of 0.01 rad/s."""
    planner = Planner(skid_steer(), METADATA.prior_mean, METADATA.prior_sd, AdviceConfig())
    observations = turned(0.0, 0.01)
    for observation in observations:
        planner.observe(observation)
    planner.believe(belief(WEAK))
    found = planner.advise(observations[-1].stamp_ns)
    assert found is not None
    assert not found.moving
    assert found.reason is Reason.NONE


def test_the_message_tells_the_turn_and_its_limit() -> None:
    types = Types()
    estimate = types.make(ESTIMATE)
    message = advice_message(advice(WEAK, 0.0, 0.3), types.make, 0, estimate)
    assert message.turn == 1.0
    assert 0.0 < message.turn_limit < message.turn_limit_median < 1.0
    assert math.isnan(message.expected_velocity)
    assert "in this turn" in message.status_text
    assert "straight on" not in message.status_text


def test_a_file_keeps_the_turns(tmp_path: Path) -> None:
    write_statics(tmp_path / "turns.npz", skid_steer().statics, "a" * 64)
    found = read_statics(tmp_path / "turns.npz", "a" * 64)
    assert found.pulls.shape[4] == len(TURNS)
    np.testing.assert_array_equal(found.pulls, skid_steer().statics.pulls)


def test_wheels_that_steer_follow_their_turns_so_these_are_not_in_the_table() -> None:
    steered = dataclasses.replace(
        WheelPlaces.of(FOUR_WHEELS, TRACK), steered=(FOUR_WHEELS.wheel_names[0],)
    )
    assert solve_statics(FOUR_WHEELS, (SOIL,), steered).pulls.shape[4] == 1
