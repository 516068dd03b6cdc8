# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to observations, the same from rclpy and from a bag."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rover_parameters.parameters import configure
from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion import (
    Conversion,
    Converter,
    nose_up_pitch,
    roll_left_up,
)
from terrain_estimator.nodes.common import message_types
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import (
    LATERAL_IN_TWIST,
    PITCH_IN_ORIENTATION,
    PITCH_IN_POSE,
    YAW_IN_RATES,
    YAW_IN_TWIST,
    Make,
)
from terramechanics.presets import load_rover
from terramechanics.vehicle.rover import Rover

ROVER: Rover = load_rover("mars_rover")
WHEELS = list(ROVER.wheel_names)
STAMP = 12_500_000_000
FACTORIES = pytest.mark.parametrize(
    "make", [message_types.make, Types().make], ids=["rclpy", "bags"]
)
OFFLINE = Types().make


def spread(values: list[float], delta: float = 0.0) -> list[float]:
    """Return values per axle as values per wheel, left and right apart by twice ``delta``."""
    return [
        values[wheel.axle] + (delta if wheel.side == "left" else -delta) for wheel in ROVER.wheels
    ]


def quaternion(make: Make, nose_up: float) -> Any:
    """Return the orientation of a rover with its nose up: a negative rotation about y (REP-103)."""
    return make(
        "geometry_msgs/msg/Quaternion",
        x=0.0,
        y=math.sin(-nose_up / 2),
        z=0.0,
        w=math.cos(nose_up / 2),
    )


def vector(make: Make, **components: float) -> Any:
    return make("geometry_msgs/msg/Vector3", **components)


def covariance(size: int, **entries: float) -> Any:
    values = np.zeros(size)
    for key, value in entries.items():
        values[int(key[1:])] = value
    return values


def wheel_slip(make: Make, **changes: Any) -> Any:
    fields = {
        "wheel": WHEELS,
        "slip": spread([0.1, 0.2, 0.3], 0.02),
        "slip_stddev": [0.01] * 6,
        "header": header(make),
    }
    return make("msg_defs/msg/WheelSlip", **(fields | changes))


def wheel_sinkage(make: Make, **changes: Any) -> Any:
    fields = {
        "header": header(make),
        "wheel": WHEELS,
        "sinkage": spread([0.018, 0.02, 0.016]),
        "sinkage_stddev": [0.001] * 6,
        "contact_angle": spread([0.05, 0.0, -0.05]),
        "contact_angle_stddev": [0.005] * 6,
    }
    return make("msg_defs/msg/WheelSinkage", **(fields | changes))


def header(make: Make, frame: str = "base_link") -> Any:
    return make(
        "std_msgs/msg/Header",
        stamp=make("builtin_interfaces/msg/Time", sec=12, nanosec=500_000_000),
        frame_id=frame,
    )


def odom(
    make: Make,
    velocity_variance: float = 1e-4,
    pitch_variance: float = 4e-4,
    frame: str = "base_link",
) -> Any:
    pose = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point"),
        orientation=quaternion(make, 0.03),
    )
    twist = make("geometry_msgs/msg/Twist", linear=vector(make, x=0.17), angular=vector(make))
    return make(
        "nav_msgs/msg/Odometry",
        header=header(make, "odom"),
        child_frame_id=frame,
        pose=make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=pose,
            covariance=covariance(36, _28=pitch_variance),
        ),
        twist=make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=twist,
            covariance=covariance(36, _0=velocity_variance),
        ),
    )


def joint_states(make: Make, **changes: Any) -> Any:
    fields = {
        "header": header(make, ""),
        "name": ["rocker", *reversed(WHEELS), "bogie"],
        "position": [0.0] * 8,
        "velocity": [0.0, *reversed(spread([1.5, 1.6, 1.7])), 0.0],
        "effort": [0.0, *reversed(spread([10.0, 12.0, 14.0], 0.5)), 0.0],
    }
    return make("sensor_msgs/msg/JointState", **(fields | changes))


def imu(make: Make, **changes: Any) -> Any:
    fields = {
        "header": header(make),
        "orientation": quaternion(make, 0.05),
        "orientation_covariance": covariance(9, _4=2.5e-5),
        "angular_velocity": vector(make),
        "linear_acceleration": vector(make, x=0.25),
        "linear_acceleration_covariance": covariance(9, _0=4e-4),
    }
    return make("sensor_msgs/msg/Imu", **(fields | changes))


def messages(make: Make = OFFLINE) -> dict[str, Any]:
    makers: dict[str, Callable[[Make], Any]] = {
        "wheel_slip": wheel_slip,
        "wheel_sinkage": wheel_sinkage,
        "odom": odom,
        "joint_states": joint_states,
        "imu": imu,
    }
    return {name: build(make) for name, build in makers.items()}


def convert(
    core: CoreConfig | None = None, config: ConversionConfig | None = None, **changes: Any
) -> Conversion:
    converter = Converter(ROVER, config or ConversionConfig(), core or CoreConfig())
    return converter.convert(STAMP, tuple((messages() | changes).values()))


def observed(conversion: Conversion) -> Observation:
    assert conversion.observation is not None, conversion.detail
    return conversion.observation


@FACTORIES
def test_a_complete_set_becomes_an_observation(make: Make) -> None:
    conversion = Converter(ROVER, ConversionConfig(), CoreConfig()).convert(
        STAMP, tuple(messages(make).values())
    )
    result = observed(conversion)
    assert conversion.notes == ()
    assert result.stamp_ns == STAMP
    np.testing.assert_allclose(result.slip, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(result.slip_sd, 0.01 / math.sqrt(2))
    np.testing.assert_allclose(result.sinkage, [0.018, 0.02, 0.016])
    np.testing.assert_allclose(result.contact_angle, [0.05, 0.0, -0.05])
    np.testing.assert_allclose(result.wheel_rate, [1.5, 1.6, 1.7])
    np.testing.assert_allclose(result.torque, [10.0, 12.0, 14.0])
    assert (result.velocity, result.velocity_sd) == (0.17, 0.01)
    assert (result.pitch, result.pitch_sd) == pytest.approx((0.05, 0.005))
    assert (result.acceleration, result.acceleration_sd) == (0.25, 0.02)


def test_rclpy_and_bag_messages_give_the_same_bits() -> None:
    results = [
        observed(
            Converter(ROVER, ConversionConfig(), CoreConfig()).convert(
                STAMP, tuple(messages(make).values())
            )
        )
        for make in (message_types.make, OFFLINE)
    ]
    live, offline = [
        b"".join(
            np.asarray(getattr(each, entry.name)).tobytes() for entry in dataclasses.fields(each)
        )
        for each in results
    ]
    assert live == offline


def test_the_torque_noise_is_that_of_the_mean_of_the_wheels() -> None:
    absolute = 0.01 * 0.3 * ROVER.wheel_radius * ROVER.mass * ROVER.gravity / 6
    expected = math.hypot(math.hypot(0.03 * 10.5, absolute), math.hypot(0.03 * 9.5, absolute)) / 2
    assert observed(convert()).torque_sd[0] == pytest.approx(expected)
    config = ConversionConfig(torque_relative_sd=0.0, torque_absolute_sd=2.0)
    np.testing.assert_allclose(observed(convert(config=config)).torque_sd, 2.0 / math.sqrt(2))


def test_wheels_are_found_by_name_in_any_order() -> None:
    shuffled = wheel_slip(OFFLINE, wheel=WHEELS[::-1], slip=spread([0.1, 0.2, 0.3])[::-1])
    np.testing.assert_allclose(observed(convert(wheel_slip=shuffled)).slip, [0.1, 0.2, 0.3])


def test_the_order_of_the_wheels_may_change_from_message_to_message() -> None:
    converter = Converter(ROVER, ConversionConfig(), CoreConfig())
    for names, slips in (
        (WHEELS, spread([0.1, 0.2, 0.3])),
        (WHEELS[::-1], spread([0.1, 0.2, 0.3])[::-1]),
    ):
        parts = messages() | {"wheel_slip": wheel_slip(OFFLINE, wheel=names, slip=slips)}
        np.testing.assert_allclose(
            observed(converter.convert(STAMP, tuple(parts.values()))).slip, [0.1, 0.2, 0.3]
        )


@pytest.mark.parametrize(
    ("wheels", "named"),
    [
        (WHEELS[:-1], "rear_right"),
        ([*WHEELS[:-1], WHEELS[0]], "rear_right"),
        ([*WHEELS, "spare"], "spare"),
        (["a", "b", "c"], "front_left"),
        ([], "front_left"),
    ],
)
def test_wrong_wheel_names_are_refused_and_named(wheels: list[str], named: str) -> None:
    for changes in (
        {
            "wheel_slip": wheel_slip(
                OFFLINE, wheel=wheels, slip=[0.1] * len(wheels), slip_stddev=[0.01] * len(wheels)
            )
        },
        {"wheel_sinkage": wheel_sinkage(OFFLINE, wheel=wheels)},
    ):
        conversion = convert(**changes)
        assert conversion.outcome is Outcome.WRONG_WHEELS
        assert conversion.observation is None
        assert named in conversion.detail


@pytest.mark.parametrize("field", ["slip", "slip_stddev"])
def test_arrays_of_another_length_than_the_names_are_refused(field: str) -> None:
    conversion = convert(wheel_slip=wheel_slip(OFFLINE, **{field: [0.1] * 3}))
    assert conversion.outcome is Outcome.WRONG_WHEELS
    assert "6 wheels" in conversion.detail


@pytest.mark.parametrize("topic", ["wheel_slip", "wheel_sinkage", "odom", "imu"])
def test_another_frame_is_refused_and_named_unless_any_is_accepted(topic: str) -> None:
    builders: dict[str, Any] = {
        "wheel_slip": lambda: wheel_slip(OFFLINE, header=header(OFFLINE, "map")),
        "wheel_sinkage": lambda: wheel_sinkage(OFFLINE, header=header(OFFLINE, "map")),
        "odom": lambda: odom(OFFLINE, frame="map"),
        "imu": lambda: imu(OFFLINE, header=header(OFFLINE, "map")),
    }
    conversion = convert(**{topic: builders[topic]()})
    assert conversion.outcome is Outcome.WRONG_FRAME
    assert topic in conversion.detail
    assert "map" in conversion.detail
    assert (
        observed(
            convert(
                config=configure(ConversionConfig, {"body_frame": ""}), **{topic: builders[topic]()}
            )
        ).velocity
        == 0.17
    )


def test_a_wheel_without_measurement_leaves_its_axle_to_the_other() -> None:
    slips = spread([0.1, 0.2, 0.3], 0.02)
    slips[WHEELS.index("front_left")] = math.nan
    conversion = convert(wheel_slip=wheel_slip(OFFLINE, slip=slips))
    np.testing.assert_allclose(observed(conversion).slip, [0.08, 0.2, 0.3])
    np.testing.assert_allclose(
        observed(conversion).slip_sd, [0.01, 0.01 / math.sqrt(2), 0.01 / math.sqrt(2)]
    )
    assert conversion.notes == ()


@pytest.mark.parametrize("value", [-0.01, 0.14, 5.0, math.inf])
def test_an_impossible_wheel_is_left_out_of_its_axle_and_named(value: float) -> None:
    depths = spread([0.018, 0.02, 0.016])
    depths[WHEELS.index("middle_right")] = value
    conversion = convert(wheel_sinkage=wheel_sinkage(OFFLINE, sinkage=depths))
    np.testing.assert_allclose(observed(conversion).sinkage, [0.018, 0.02, 0.016])
    assert "middle_right" in conversion.notes[0]


def test_a_sinkage_that_noise_makes_negative_stays_in_the_mean() -> None:
    depths = spread([0.00014, 0.00014, 0.00014])
    depths[0] = -0.00002
    result = observed(
        convert(wheel_sinkage=wheel_sinkage(OFFLINE, sinkage=depths, sinkage_stddev=[0.00006] * 6))
    )
    assert result.sinkage[0] == pytest.approx(0.00006)


def test_where_no_wheel_of_an_axle_is_possible_the_screening_gets_to_see_it() -> None:
    assert observed(
        convert(wheel_sinkage=wheel_sinkage(OFFLINE, sinkage=spread([-0.05, 0.02, 0.016])))
    ).sinkage[0] == pytest.approx(-0.05)
    assert math.isnan(
        observed(convert(wheel_slip=wheel_slip(OFFLINE, slip=[math.nan] * 6))).slip[0]
    )


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_bad_deviation_is_not_averaged_away(value: float) -> None:
    result = observed(convert(wheel_slip=wheel_slip(OFFLINE, slip_stddev=[value] * 6)))
    assert not (result.slip_sd > 0.0).any() or math.isinf(result.slip_sd[0])


def test_without_joint_states_torque_and_rate_are_not_measured() -> None:
    result = observed(convert(joint_states=None))
    assert np.isnan([result.wheel_rate, result.torque, result.torque_sd]).all()


def test_empty_or_short_joint_arrays_are_not_measured() -> None:
    empty = convert(joint_states=joint_states(OFFLINE, velocity=[], effort=[]))
    assert np.isnan([observed(empty).wheel_rate, observed(empty).torque]).all()
    assert empty.notes == ()
    short = convert(joint_states=joint_states(OFFLINE, effort=[1.0]))
    assert np.isnan(observed(short).torque).all()
    np.testing.assert_allclose(observed(short).wheel_rate, [1.5, 1.6, 1.7])
    assert "effort" in short.notes[0]


def test_an_infinite_torque_is_left_out_and_said() -> None:
    conversion = convert(
        joint_states=joint_states(OFFLINE, effort=[0.0, math.inf, *[12.0] * 5, 0.0])
    )
    np.testing.assert_allclose(observed(conversion).torque, 12.0)
    assert "infinite effort" in conversion.notes[0]


def test_the_bogie_angle_is_the_mean_of_the_named_joints_nose_up() -> None:
    def angle(config: ConversionConfig | None = None, **changes: Any) -> float:
        return observed(
            convert(
                config=config or ConversionConfig(), joint_states=joint_states(OFFLINE, **changes)
            )
        ).bogie_angle

    position = [9.0, *[5.0] * 6, 0.04]
    assert angle(position=position) == pytest.approx(0.04)
    assert angle(ConversionConfig(bogie_nose_down=True), position=position) == pytest.approx(-0.04)
    both: dict[str, Any] = {
        "name": ["left_bogie", *WHEELS, "right_bogie"],
        "position": [0.02, *[5.0] * 6, 0.04],
    }
    assert angle(ConversionConfig(bogie_joint="left_bogie, right_bogie"), **both) == pytest.approx(
        0.03
    )
    assert math.isnan(angle(**both))
    assert math.isnan(angle(position=[]))


def test_joint_states_of_something_else_are_not_measured() -> None:
    other = joint_states(OFFLINE, name=["arm"], velocity=[1.0], effort=[1.0], position=[0.0])
    result = observed(convert(joint_states=other))
    assert np.isnan([result.wheel_rate, result.torque]).all()


def test_sensors_that_are_switched_off_are_not_used() -> None:
    result = observed(convert(CoreConfig(use_torque=False, use_imu=False)))
    assert np.isnan(result.torque).all()
    assert math.isnan(result.acceleration)
    np.testing.assert_allclose(result.wheel_rate, [1.5, 1.6, 1.7])
    assert (result.pitch, result.pitch_sd) == pytest.approx((0.03, 0.02))


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
