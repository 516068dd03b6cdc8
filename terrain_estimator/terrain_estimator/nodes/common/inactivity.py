# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Log why no messages arrive on a topic, or why none of those that arrive belong together.

ROS itself reports neither.
"""

import time
from collections.abc import Iterable, Mapping

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from terrain_estimator.nodes.common.publishers import incompatible_publishers
from terrain_estimator.nodes.common.running import guarded

PATIENCE_S = 5.0
SHOWN = 3
"""Largest number of topics of the same type that a message names."""


def explain_silence(node: Node, topic: str, type_name: str, qos: QoSProfile) -> str:
    """Explain from the ROS graph why nothing arrived on a topic, and what to do about it."""
    finding = incompatible_publishers(node, topic, type_name, qos)
    if finding.level:
        return (
            f"{finding.text.removeprefix(f'{topic}: ')}: set its publisher to type and quality of"
            " service of docs/messages.md"
        )
    name = node.resolve_topic_name(topic)
    if node.count_publishers(name):
        return f"{name} has a publisher, which says nothing: check it"
    graph = node.get_topic_names_and_types()
    others = [
        other
        for other, kinds in graph
        if type_name in kinds and other != name and node.count_publishers(other)
    ]
    if not others:
        return (
            f"nobody publishes {name} in ROS domain {node.context.get_domain_id()}: start its"
            " publisher, or compare ROS_DOMAIN_ID"
        )
    others.sort(key=lambda other: not other.endswith(f"/{topic}"))  # of the same name first
    listed, namespace = ", ".join(others[:SHOWN]), others[0].removesuffix(f"/{topic}")
    rule = f"__ns:={namespace}" if namespace not in {"", others[0]} else f"{topic}:=NAME"
    return (
        f"nobody publishes {name}; of its type there is {listed}: start its publisher, or this node"
        f" with --ros-args -r {rule}"
    )


def merged(lines: Mapping[str, str]) -> list[str]:
    """Merge the log lines that differ in nothing but the topic that they are about, the key.

    A node that starts before the rover would else log the same line for each of its inputs.
    """
    groups: dict[str, list[str]] = {}
    for topic, line in lines.items():
        groups.setdefault(line.replace(topic, ""), []).append(topic)
    return [
        "; likewise ".join([lines[first], *filter(None, [", ".join(others)])])
        for first, *others in groups.values()
    ]


class PairingMonitor:
    """Log once that messages arrive on all topics without matching stamps, and when they match."""

    def __init__(self, node: Node, topics: Iterable[str], patience_s: float = PATIENCE_S) -> None:
        """Begin with no message received; wait ``patience_s`` before a warning."""
        self._node, self._topics, self._patience_s = node, tuple(topics), patience_s
        self._warned = False
        self._begin()

    def _begin(self) -> None:
        self._since_s, self._unpaired = time.monotonic(), set[str]()

    def received(self, topic: str, *, paired: bool) -> None:
        """Note a message, and whether it completed a set of messages of one instant."""
        if paired:
            if self._warned:
                self._node.get_logger().info(
                    f"{' and '.join(self._topics)}: messages of one instant come now"
                )
            self._warned = False
            self._begin()
            return
        self._unpaired.add(topic)
        if time.monotonic() - self._since_s < self._patience_s:
            return
        if not self._warned and self._unpaired.issuperset(self._topics):
            self._warned = True
            self._node.get_logger().warning(
                f"messages come on {' and '.join(self._topics)}, but for {self._patience_s:g} s"
                " none of one instant: publish them with equal stamps, or set pairing_tolerance of"
                " this node"
            )
        self._begin()


class InactivityMonitor:
    """Log once for each topic that no messages arrive, and why, and when they arrive again."""

    def __init__(
        self, node: Node, topics: Mapping[str, str], qos: QoSProfile, patience_s: float = PATIENCE_S
    ) -> None:
        """Start a timer; ``topics`` gives the type of each topic by name."""
        self._node, self._qos, self._patience_s, self._topics = node, qos, patience_s, dict(topics)
        self._begun_s, self._received_s, self._warned = (
            time.monotonic(),
            dict[str, float](),
            set[str](),
        )
        node.create_timer(
            patience_s, guarded(node, self._check), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def received(self, topic: str) -> None:
        """Note a message."""
        self._received_s[topic] = time.monotonic()
        if topic in self._warned:
            self._warned.remove(topic)
            self._node.get_logger().info(f"{topic}: messages come now")

    def _check(self) -> None:
        now, never = time.monotonic(), dict[str, str]()
        for topic, kind in self._topics.items():
            silent_s = now - self._received_s.get(topic, self._begun_s)
            if topic in self._warned or silent_s < 0.9 * self._patience_s:  # a timer may be early
                continue
            self._warned.add(topic)
            reason = explain_silence(self._node, topic, kind, self._qos)
            if topic in self._received_s:
                self._node.get_logger().warning(
                    f"no data on {topic} for {silent_s:.1f} s: {reason}"
                )
            else:
                never[topic] = f"no data on {topic} since the start: {reason}"
        for line in merged(never):
            self._node.get_logger().warning(line)
