# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A node logs why no messages arrive, and what to do."""

import itertools
import re
from types import SimpleNamespace

import pytest
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from terrain_estimator.nodes.common.inactivity import (
    InactivityMonitor,
    PairingMonitor,
    explain_silence,
    merged,
)
from tests.system.listening import Listener

QOS = QoSProfile(depth=5)
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
KIND = "nav_msgs/msg/Odometry"


def test_the_reason_names_what_is_there_instead_and_how_to_hear_it(listener: Listener) -> None:
    node, name = listener.node, listener.node.get_fully_qualified_name()
    assert re.fullmatch(
        r"nobody publishes /a in ROS domain \d+: .*ROS_DOMAIN_ID",
        explain_silence(node, "a", KIND, QOS),
    )
    for topic, kind, qos in (
        ("elsewhere", Odometry, QOS),
        ("/rover1/b", Odometry, QOS),
        ("c", String, QOS),
        ("d", Odometry, SENSOR),
    ):
        node.create_publisher(kind, topic, qos)
    node.create_publisher(Odometry, "e", QOS)
    assert "/elsewhere" in explain_silence(node, "a", KIND, QOS)
    assert explain_silence(node, "b", KIND, QOS).startswith(
        "nobody publishes /b; of its type there is /rover1/b, "
    )
    assert explain_silence(node, "b", KIND, QOS).endswith(
        "or this node with --ros-args -r __ns:=/rover1"
    )
    assert explain_silence(node, "a", KIND, QOS).endswith("-r a:=NAME")
    for reason in (explain_silence(node, "c", KIND, QOS), explain_silence(node, "d", KIND, QOS)):
        assert reason.endswith(
            ": set its publisher to type and quality of service of docs/messages.md"
        )
    assert explain_silence(node, "c", KIND, QOS).startswith(
        f"{name} publishes std_msgs/msg/String, not {KIND}: "
    )
    assert explain_silence(node, "d", KIND, QOS).startswith(
        f"incompatible quality of service with {name}: best effort publisher"
    )
    assert (
        explain_silence(node, "e", KIND, QOS) == "/e has a publisher, which says nothing: check it"
    )


def test_it_is_said_once_for_each_topic_on_which_nothing_comes_or_nothing_any_more(
    listener: Listener, capfd: pytest.CaptureFixture[str]
) -> None:
    said: list[str] = []

    def more() -> str:
        said.append(capfd.readouterr().err)
        return "".join(said)

    patience = InactivityMonitor(
        listener.node, {"heard": KIND, "silent": KIND}, QOS, patience_s=0.1
    )
    patience.received("heard")
    listener.node.create_publisher(Odometry, "/rover1/silent", QOS)
    listener.spin_until(lambda: "no data" in more(), "it is said")
    patience.received("silent")
    listener.spin_until(lambda: "come now" in more(), "it is taken back")
    listener.spin_until(lambda: "no data on silent for" in more(), "that it ended is said, too")
    text = more()
    assert (
        "no data on silent since the start: nobody publishes /silent; of its type there is"
        " /rover1/silent: start its publisher" in text
    )
    assert "--ros-args -r __ns:=/rover1" in text
    assert (
        text.count("no data on silent since the start") == text.count("no data on silent for") == 1
    )
    assert text.count("no data on heard for") == 1
    assert "silent: messages come now" in text


def test_messages_that_are_never_of_one_instant_are_said_once_and_taken_back(
    listener: Listener, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = itertools.count()
    monkeypatch.setattr(
        "terrain_estimator.nodes.common.inactivity.time",
        SimpleNamespace(monotonic=lambda: next(now)),
    )
    pairs = PairingMonitor(listener.node, ("a", "b"), patience_s=5.0)

    def said(topics: str, *, paired: bool = False) -> str:
        for topic in topics:
            pairs.received(topic, paired=paired)
        return capfd.readouterr().err

    assert said("a" * 20) == ""  # b is silent, which is another fault
    text = said("ab" * 20)
    assert text.count("messages come on a and b, but for 5 s none of one instant") == 1
    assert "set pairing_tolerance" in text
    assert "a and b: messages of one instant come now" in said("a", paired=True)
    assert said("a" * 20) == ""
    assert said("ab" * 20).count("none of one instant") == 1


def test_topics_that_are_silent_for_one_reason_share_one_line() -> None:
    lines = {"odom": "no data on odom: a", "imu": "no data on imu: a", "slip": "no data on slip: b"}
    assert merged(lines) == ["no data on odom: a; likewise imu", "no data on slip: b"]
    assert merged({}) == []
