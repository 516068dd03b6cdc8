# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes offer and request the table of docs/messages.md, unless a user overrides it."""

import re
import threading
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from msg_defs.msg import EstimatorHealth
from rover_parameters.records import ConfigError
from terrain_estimator.nodes.estimator import EstimatorNode
from tests.system.listening import Listener
from tests.system.processes import Starter

ROW = re.compile(
    r"^\| `([\w/]+)` \| `([\w/]+)` \| (\w+) \| [^|]+ \| (\w+) \| (\w+) \| (\d+) \|$", re.MULTILINE
)
TABLE = ROW.findall((Path(__file__).parents[2] / "docs/messages.md").read_text(encoding="utf-8"))
PACKAGE_OF = {
    "simulator": "rover_sim_node",
    "estimator": "terrain_estimator",
    "planner": "terrain_estimator",
    "terrain_map": "terrain_estimator",
}


class Offer(NamedTuple):
    """Return what discovery has about a publisher, which is all but the depth."""

    topic: str
    type: str
    reliability: str
    durability: str


@pytest.mark.parametrize("node", sorted(PACKAGE_OF))
def test_a_node_offers_what_the_table_says(node: str, start: Starter, listener: Listener) -> None:
    documented = {
        Offer(topic, kind, reliability, durability)
        for topic, kind, publisher, reliability, durability, _ in TABLE
        if publisher == node
    }
    process = start(PACKAGE_OF[node], node)

    def offered() -> set[Offer]:
        assert process.running, process.output
        return {
            Offer(
                topic,
                info.topic_type,
                info.qos_profile.reliability.name.lower(),
                info.qos_profile.durability.name.lower(),
            )
            for topic, *_ in TABLE
            for info in listener.node.get_publishers_info_by_topic(topic)
            if info.node_name == node
        }

    listener.spin_until(
        lambda: offered() == documented,
        "the offers are those of the table",
        seen=lambda: f"{offered()} not {documented}",
    )
    assert documented
    assert process.interrupt() == 0


def estimator(listener: Listener, **overrides: Any) -> EstimatorNode:
    """With overrides of /rover1/imu by the policy's name."""
    given = [
        Parameter(f"qos_overrides./rover1/imu.subscription.{name}", value=value)
        for name, value in overrides.items()
    ]
    return listener.host(
        partial(EstimatorNode, threading.Event()), namespace="/rover1", parameter_overrides=given
    )


def test_a_best_effort_publisher_is_heard_by_an_estimator_that_is_told_so(
    listener: Listener,
) -> None:
    node = estimator(listener, reliability="best_effort", depth=5)
    sensor = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    health = listener.collect(EstimatorHealth, "/rover1/estimator_health")
    for _ in range(2):  # the first subscription declares the parameters, the second one finds them
        node.start()
        publisher = listener.publisher(Imu, "/rover1/imu", sensor)
        taken = {each.topic: each.qos_profile for each in node.subscriptions}
        assert (taken["imu"].reliability, taken["imu"].depth) == (ReliabilityPolicy.BEST_EFFORT, 5)
        assert (taken["odom"].reliability, taken["odom"].depth) == (ReliabilityPolicy.RELIABLE, 50)
        assert [each.text for each in node.findings() if each.level and each.subject == "imu"] == []
        assert node.describe_parameter("qos_overrides./rover1/imu.subscription.depth").read_only
        health.clear()
        publisher.publish(Imu())
        listener.spin_until(
            lambda: any(sum(each.input_received) == 1 for each in health), "the message is heard"
        )
        listener.node.destroy_publisher(publisher)
        node.end()
    listener.leave(node)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            {"reliabilty": "best_effort"},
            (
                "unknown parameter .*/rover1/imu.subscription.reliabilty: did you mean"
                " .*imu.subscription.reliability"
            ),
        ),
        ({"durability": "volatile"}, "unknown parameter .*durability: did you mean"),
        ({"reliability": "best-effort"}, "expected reliable or best_effort, got 'best-effort'"),
        ({"depth": 0}, "expected a whole number from 1 to 10000, got 0"),
    ],
)
def test_an_override_that_cannot_be_is_named(
    listener: Listener, overrides: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        estimator(listener, **overrides)
