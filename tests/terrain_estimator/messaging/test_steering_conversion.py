# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Angles of the wheels of a model by wheel, from joint_states."""

import math

import numpy as np
import pytest

from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion import STRAIGHT, Conversion, Converter
from terrain_estimator.outcome import Outcome
from tests.terrain_estimator.messaging.input_messages import (
    OFFLINE,
    ROVER,
    STAMP,
    WHEELS,
    joint_states,
    messages,
    observed,
)

FRONT = (True, True, False, False, False, False)
"""The front wheels are steered."""


def converted(steered: tuple[bool, ...], angles: dict[str, float]) -> Conversion:
    """Convert a set whose joint_states has these angles of joints [rad] beside the wheels."""
    plain = joint_states(OFFLINE)
    more = len(angles)
    joints = joint_states(
        OFFLINE,
        name=[*plain.name, *angles],
        position=[*plain.position, *angles.values()],
        velocity=[*plain.velocity, *[math.nan] * more],
        effort=[*plain.effort, *[math.nan] * more],
    )
    converter = Converter(ROVER, ConversionConfig(), CoreConfig(), steered)
    return converter.convert(STAMP, tuple((messages() | {"joint_states": joints}).values()))


def test_steered_wheels_have_the_angle_of_their_joint_and_others_none() -> None:
    angles = {"front_right_steering": -0.2, "front_left_steering": 0.3}
    result = observed(converted(FRONT, angles))
    assert result.steering is not None
    np.testing.assert_array_equal(result.steering, [0.3, -0.2, 0.0, 0.0, 0.0, 0.0])


def test_a_missing_joint_is_an_angle_that_was_not_measured() -> None:
    result = observed(converted(FRONT, {"front_left_steering": 0.3}))
    assert result.steering is not None
    np.testing.assert_array_equal(result.steering[:3], [0.3, math.nan, 0.0])


@pytest.mark.parametrize("steered", [FRONT, (False,) * len(WHEELS)])
def test_a_wheel_that_the_model_takes_as_straight_must_not_be_steered(
    steered: tuple[bool, ...],
) -> None:
    front = {"front_left_steering": 0.0, "front_right_steering": 0.0}
    assert converted(steered, front | {"rear_left_steering": 0.5 * STRAIGHT}).observation
    refused = converted(steered, front | {"rear_left_steering": -2.0 * STRAIGHT})
    assert refused.outcome is Outcome.WRONG_WHEELS
    assert "rear_left_steering is -0.04 rad" in refused.detail
    assert "model_by_wheel --steered" in refused.detail


def test_a_model_by_axle_has_no_steered_wheels() -> None:
    assert observed(converted((), {"rear_left_steering": 0.5})).steering is None
