# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of a bag are found by name, namespace and remapping, in both orders that ROS tools use."""

import pytest

from terrain_estimator.offline.topic_mapping import (
    TopicError,
    bag_topics,
    check_inputs,
    parse_remap,
    perhaps_renamed,
)


@pytest.mark.parametrize(
    "rule", ["wheel_slip:=/rover1/slip", "/rover1/slip:=wheel_slip", "/wheel_slip:=/rover1/slip"]
)
def test_a_remap_may_be_written_in_either_order(rule: str) -> None:
    assert parse_remap(rule) == ("wheel_slip", "/rover1/slip")
    assert bag_topics([rule], "")["wheel_slip"] == "/rover1/slip"


@pytest.mark.parametrize("rule", ["wheel_slip", "a:=b", ":=wheel_slip", "wheel_slip:="])
def test_another_form_of_remap_is_refused(rule: str) -> None:
    with pytest.raises(TopicError, match="remap"):
        parse_remap(rule)


def test_a_namespace_goes_before_relative_names() -> None:
    names = bag_topics(["odom:=/odometry"], "/rover1")
    assert (names["wheel_slip"], names["odom"], names["terrain_estimate"]) == (
        "/rover1/wheel_slip",
        "/odometry",
        "/rover1/terrain_estimate",
    )


def test_a_missing_topic_is_named_with_what_looks_like_it() -> None:
    with pytest.raises(TopicError, match=r"no topic /wheel_slip.*/r/wheel_slip.*--namespace"):
        check_inputs("bag", {"/r/wheel_slip": None}, bag_topics([], ""))
    with pytest.raises(TopicError, match="/camera"):
        check_inputs("bag", {"/camera": None}, bag_topics([], ""))


def test_an_optional_topic_of_another_name_is_noted_with_the_remap() -> None:
    imu, joints = "sensor_msgs/msg/Imu", "sensor_msgs/msg/JointState"
    present = {"/imu/data": imu, "/joint_states": joints, "/arm": joints}
    [note] = perhaps_renamed("bag", present, bag_topics([], ""))
    assert note == (
        "bag: no topic /imu, whose rows are missing; of its type there is /imu/data: if that is"
        " meant, give --remap imu:=/imu/data"
    )
    assert perhaps_renamed("bag", present, bag_topics(["imu:=/imu/data"], "")) == []
    assert perhaps_renamed("bag", {"/joint_states": joints}, bag_topics([], "")) == []


def test_one_topic_is_not_read_as_two() -> None:
    with pytest.raises(
        TopicError, match="/vo would be both wheel_slip and odom: remap each to a topic of its own"
    ):
        bag_topics(["wheel_slip:=/vo", "odom:=/vo"], "/rover1")
