# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages to observations, the same from rclpy and from a bag."""

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rover_parameters.parameters import configure
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion import (
    Converter,
)
from terrain_estimator.nodes.common import message_types
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import (
    Make,
)
from tests.terrain_estimator.messaging.input_messages import (
    FACTORIES,
    OFFLINE,
    ROVER,
    STAMP,
    WHEELS,
    convert,
    header,
    imu,
    joint_states,
    messages,
    observed,
    odom,
    spread,
    wheel_sinkage,
    wheel_slip,
)


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


@pytest.mark.parametrize("length", [0, 3, 6, 7])
def test_motion_across_is_not_read_whatever_its_length(length: int) -> None:
    plain, aside = observed(convert()), [0.3] * length
    given = wheel_slip(OFFLINE, lateral_slip=aside, slip_angle=aside[1:])
    np.testing.assert_equal(
        dataclasses.asdict(observed(convert(wheel_slip=given))), dataclasses.asdict(plain)
    )


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


@pytest.mark.parametrize("reference", ["Local", "Undisturbed", "undisturbed "])
def test_sinkage_from_other_ground_is_refused_by_field_and_value(reference: str) -> None:
    conversion = convert(wheel_sinkage=wheel_sinkage(OFFLINE, reference=reference))
    assert conversion.outcome is Outcome.WRONG_FRAME
    assert conversion.observation is None
    assert f"wheel_sinkage: reference is {reference!r}, expected 'undisturbed', for ground" in (
        conversion.detail
    )
    assert "or 'local', for the ground right before the wheel" in conversion.detail


@FACTORIES
def test_a_local_sinkage_is_said_to_be_one_and_may_be_negative(make: Make) -> None:
    """A wheel that rides above the bottom of a track by 5 mm is possible; from fresh ground not."""
    risen = [-0.005 if wheel.axle else 0.018 for wheel in ROVER.wheels]
    given = wheel_sinkage(make, sinkage=risen, reference="local")
    found = convert(wheel_sinkage=given)
    assert observed(found).local
    assert found.notes == ()
    assert observed(found).sinkage.tolist() == pytest.approx([0.018, -0.005, -0.005])
    assert not observed(convert(wheel_sinkage=wheel_sinkage(make))).local
    mixed = [-0.005 if wheel.side == "left" else 0.018 for wheel in ROVER.wheels]
    undisturbed = convert(wheel_sinkage=wheel_sinkage(make, sinkage=mixed))
    assert len(undisturbed.notes) == 3
    assert observed(undisturbed).sinkage.tolist() == pytest.approx([0.018] * 3)
    local = convert(wheel_sinkage=wheel_sinkage(make, sinkage=mixed, reference="local"))
    assert observed(local).sinkage.tolist() == pytest.approx([0.0065] * 3)


@FACTORIES
def test_sinkage_from_undisturbed_ground_is_used_said_or_not(make: Make) -> None:
    for given in (wheel_sinkage(make), wheel_sinkage(make, reference="undisturbed")):
        assert observed(convert(wheel_sinkage=given)).sinkage[0] == 0.018
    before = SimpleNamespace(**vars(wheel_sinkage(OFFLINE)))
    del before.reference
    assert observed(convert(wheel_sinkage=before)).sinkage[0] == 0.018


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
