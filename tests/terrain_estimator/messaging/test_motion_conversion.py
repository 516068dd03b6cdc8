# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pitch, roll and motion beside it, from odom and imu: conversion to observations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion import (
    nose_up_pitch,
    roll_left_up,
)
from terrain_estimator.topics import (
    LATERAL_IN_TWIST,
    PITCH_IN_ORIENTATION,
    PITCH_IN_POSE,
    YAW_IN_RATES,
    YAW_IN_TWIST,
)
from tests.terrain_estimator.messaging.input_messages import (
    OFFLINE,
    convert,
    covariance,
    imu,
    observed,
    odom,
    quaternion,
    vector,
)


def test_the_pitch_comes_from_odom_where_imu_has_no_orientation() -> None:
    without = imu(OFFLINE, orientation_covariance=covariance(9, _0=-1.0))
    for changes in ({"imu": without}, {"imu": None}):
        result = observed(convert(**changes))
        assert (result.pitch, result.pitch_sd) == pytest.approx((0.03, 0.02))


def test_an_imu_without_acceleration_is_accepted() -> None:
    for changed in (-1.0, 0.0):
        result = observed(
            convert(imu=imu(OFFLINE, linear_acceleration_covariance=covariance(9, _0=changed)))
        )
        assert math.isnan(result.acceleration)
        assert result.pitch == pytest.approx(0.05)


def test_an_unknown_covariance_takes_the_configured_deviation_and_else_none() -> None:
    unknown = {"odom": odom(OFFLINE, 0.0, 0.0), "imu": None}
    assert (observed(convert(**unknown)).velocity_sd, observed(convert(**unknown)).pitch_sd) == (
        0.0,
        0.0,
    )
    config = ConversionConfig(
        default_velocity_sd=0.02, default_pitch_sd=0.01, default_acceleration_sd=0.3
    )
    result = observed(convert(config=config, **unknown))
    assert (result.velocity_sd, result.pitch_sd) == (0.02, 0.01)
    assert (
        observed(
            convert(config=config, imu=imu(OFFLINE, linear_acceleration_covariance=covariance(9)))
        ).acceleration_sd
        == 0.3
    )


@pytest.mark.parametrize("variance", [-1.0, math.nan])
def test_a_variance_that_is_none_gives_a_deviation_that_is_refused(variance: float) -> None:
    assert math.isnan(observed(convert(odom=odom(OFFLINE, variance))).velocity_sd)


def test_the_pitch_is_nose_up_for_any_heading() -> None:
    for yaw in (0.0, 1.0, 2.5):
        about_y, about_z = quaternion(OFFLINE, 0.2), (math.cos(yaw / 2), math.sin(yaw / 2))
        turned = OFFLINE(
            "geometry_msgs/msg/Quaternion",
            w=about_z[0] * about_y.w,
            x=-about_z[1] * about_y.y,
            y=about_z[0] * about_y.y,
            z=about_z[1] * about_y.w,
        )
        assert nose_up_pitch(turned) == pytest.approx(0.2)


@given(roll=st.floats(-0.5, 0.5), pitch=st.floats(-0.5, 0.5), heading=st.floats(-math.pi, math.pi))
def test_the_roll_is_that_of_the_left_side_for_any_pitch_and_heading(
    roll: float, pitch: float, heading: float
) -> None:
    """Against scipy: heading, then pitch nose up, then a turn about body x."""
    turned = Rotation.from_euler("ZYX", [heading, -pitch, roll])
    x, y, z, w = turned.as_quat()
    quaternion_message = OFFLINE("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    left = turned.apply([0.0, 1.0, 0.0])
    assert roll_left_up(quaternion_message) == pytest.approx(math.asin(left[2]), abs=1e-9)
    assert math.copysign(1.0, left[2]) == math.copysign(1.0, roll) or abs(roll) < 1e-12


def test_lateral_velocity_and_yaw_rate_are_read_with_their_deviations() -> None:
    message = odom(OFFLINE)
    message.twist.twist.linear.y, message.twist.twist.angular.z = -0.02, 0.3
    message.twist.covariance = covariance(36, _0=1e-4, _7=4e-4, _35=9e-4)
    unmeasured = imu(OFFLINE, angular_velocity_covariance=covariance(9, _0=-1.0))
    result = observed(convert(odom=message, imu=unmeasured))
    assert (result.lateral_velocity, result.lateral_velocity_sd) == (-0.02, 0.02)
    assert (result.yaw_rate, result.yaw_rate_sd) == pytest.approx((0.3, 0.03))


def test_the_imu_gives_the_yaw_rate_where_it_measures_rates() -> None:
    turning = imu(
        OFFLINE,
        angular_velocity=vector(OFFLINE, z=0.2),
        angular_velocity_covariance=covariance(9, _8=1e-4),
    )
    result = observed(convert(imu=turning))
    assert (result.yaw_rate, result.yaw_rate_sd) == (0.2, 0.01)
    without = observed(convert(CoreConfig(use_imu=False), imu=turning))
    assert without.yaw_rate == 0.0


@pytest.mark.parametrize("unusable", ["value", "variance"])
def test_the_yaw_rate_is_odom_s_where_the_imu_s_is_unusable(unusable: str) -> None:
    message = odom(OFFLINE)
    message.twist.twist.angular.z = 0.5
    message.twist.covariance = covariance(36, _0=1e-4, _35=1e-4)
    broken = imu(
        OFFLINE,
        angular_velocity=vector(OFFLINE, z=math.nan if unusable == "value" else 0.1),
        angular_velocity_covariance=covariance(9, _8=-1.0 if unusable == "variance" else 1e-4),
    )
    result = observed(convert(odom=message, imu=broken))
    assert (result.yaw_rate, result.yaw_rate_sd) == (0.5, 0.01)


def test_a_negative_variance_says_that_a_motion_is_not_measured() -> None:
    message = odom(OFFLINE)
    message.twist.covariance = covariance(36, _0=1e-4, _7=-1.0)
    result = observed(convert(odom=message))
    assert math.isnan(result.lateral_velocity)
    assert math.isnan(result.lateral_velocity_sd)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_rover_on_its_nose_has_a_pitch_though_rounding_takes_the_sine_beyond_one(
    way: float,
) -> None:
    x, w = 0.6810861359424861, -0.19005703203757887
    upright = OFFLINE("geometry_msgs/msg/Quaternion", x=x, y=way * w, z=-way * x, w=w)
    assert nose_up_pitch(upright) == pytest.approx(-way * math.pi / 2.0)


@pytest.mark.parametrize("w", [0.0, 0.5, 10.0, math.nan, math.inf])
def test_a_quaternion_that_is_no_orientation_gives_no_pitch(w: float) -> None:
    message = OFFLINE("geometry_msgs/msg/Quaternion", w=w)
    assert math.isnan(nose_up_pitch(message))
    assert math.isnan(roll_left_up(message))


def test_the_entries_of_the_rates_are_those_of_ros() -> None:
    assert np.arange(36).reshape(6, 6)[1, 1] == LATERAL_IN_TWIST
    assert np.arange(36).reshape(6, 6)[5, 5] == YAW_IN_TWIST
    assert np.arange(9).reshape(3, 3)[2, 2] == YAW_IN_RATES


def test_the_pitch_is_the_entry_about_y_of_both_covariances() -> None:
    assert np.arange(36).reshape(6, 6)[4, 4] == PITCH_IN_POSE
    assert np.arange(9).reshape(3, 3)[1, 1] == PITCH_IN_ORIENTATION
