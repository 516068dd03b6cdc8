# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""In a turn the planner judges neither slip nor the front wheels, and says so.

Where it knows the rover's turns it judges whether the ground holds this one.
"""

import dataclasses
import math

import numpy as np
import pytest

from terrain_estimator.bags import Types
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.observation import Observation
from terrain_estimator.planning.messages import advice_message
from terrain_estimator.planning.planner import Advice, Planner, Reason
from terrain_estimator.topics import ESTIMATE
from tests.terrain_estimator.planning.support import FIRM, METADATA, ROVER, belief, drive, table

SPINNING = 0.8
SECOND = 10
"""Observations in a second."""


def moved(yaw_rate: float, slip: float, sinkage: float = math.nan) -> list[Observation]:
    """Return four seconds on firm ground at that yaw rate, with that slip."""
    found = []
    for each in drive()[0][: 4 * SECOND]:
        depth = each.sinkage if math.isnan(sinkage) else np.full(3, sinkage)
        found.append(
            dataclasses.replace(
                each,
                slip=np.full(3, slip),
                sinkage=depth,
                yaw_rate=yaw_rate,
                yaw_rate_sd=0.003,
                lateral_velocity=0.0,
                lateral_velocity_sd=0.005,
            )
        )
    return found


def advice(observations: list[Observation]) -> Advice:
    planner = Planner(table(), METADATA.prior_mean, METADATA.prior_sd, AdviceConfig())
    for observation in observations:
        planner.observe(observation)
    planner.believe(belief(FIRM))
    found = planner.advise(observations[-1].stamp_ns)
    assert found is not None
    return found


def test_slip_straight_ahead_stops_the_rover_and_in_a_turn_it_does_not() -> None:
    assert advice(moved(0.0, SPINNING)).reason is Reason.SLIP
    turned = advice(moved(0.3, SPINNING))
    assert turned.turning
    assert turned.reason is Reason.NONE
    assert turned.slip == pytest.approx(SPINNING)  # as measured
    assert math.isnan(turned.front_stall_probability)
    assert turned.known  # margins are those of the ground, for driving straight
    assert math.isnan(turned.turn)
    assert math.isnan(turned.turn_limit.lower)
    assert not math.isnan(turned.margins.stall_probability)


def test_a_rover_that_spins_and_hardly_turns_is_stopped() -> None:
    """What is stuck does not turn, whatever is commanded."""
    assert advice(moved(0.005, SPINNING)).reason is Reason.SLIP


def test_deep_wheels_stop_it_in_a_turn_too() -> None:
    deep = AdviceConfig().sinkage_limit * ROVER.wheel_radius * 1.1
    assert advice(moved(0.3, 0.3, deep)).reason is Reason.SINKAGE


def test_the_last_straight_readings_are_judged_until_most_of_the_window_is_a_turn() -> None:
    straight, turn = moved(0.0, SPINNING), moved(0.3, SPINNING)
    short = straight[: -SECOND // 2] + turn[-SECOND // 2 :]
    assert not advice(short).turning
    assert advice(short).reason is Reason.SLIP
    assert advice(straight[: -3 * SECOND // 2] + turn[-3 * SECOND // 2 :]).turning


@pytest.mark.parametrize("lateral", [math.nan, 0.0, 0.06])
def test_without_a_measured_yaw_rate_slip_counts(lateral: float) -> None:
    unknown = [
        dataclasses.replace(each, yaw_rate=math.nan, lateral_velocity=lateral)
        for each in moved(0.3, SPINNING)
    ]
    assert advice(unknown).reason is Reason.SLIP


def test_a_rover_that_spins_and_slides_to_a_side_is_stopped_by_slip() -> None:
    """As one that is stuck across a slope; its front wheels are judged by nothing planar."""
    slides = [dataclasses.replace(each, lateral_velocity=-0.06) for each in moved(0.0, SPINNING)]
    found = advice(slides)
    assert not found.turning
    assert found.reason is Reason.SLIP
    crabs = [dataclasses.replace(each, lateral_velocity=-0.06) for each in moved(0.0, 0.2)]
    assert advice(crabs).reason is Reason.NONE
    assert math.isnan(advice(crabs).front_stall_probability)
    assert advice(crabs).front_lacks == "straight motion"


def test_on_the_spot_deep_wheels_stop_it_and_slip_does_not() -> None:
    """Rates of left and right wheels are averaged to nothing: yet such a rover does not stand."""
    deep = AdviceConfig().sinkage_limit * ROVER.wheel_radius * 1.1
    for sinkage, reason in ((deep, Reason.SINKAGE), (0.01, Reason.NONE)):
        turned = [
            dataclasses.replace(each, wheel_rate=np.zeros(3), velocity=0.0)
            for each in moved(0.3, SPINNING, sinkage)
        ]
        assert advice(turned).reason is reason
        assert advice(turned).moving


def test_the_status_says_what_is_not_judged() -> None:
    types = Types()
    estimate = types.make(ESTIMATE)
    said = advice_message(advice(moved(0.3, 0.2)), types.make, 0, estimate).status_text
    assert "slip and front wheels not judged: the rover turns" in said
    assert "margins are for driving straight on" in said
    said = advice_message(advice(moved(0.0, 0.2)), types.make, 0, estimate).status_text
    assert "turns" not in said
