# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Says why nothing comes on a topic, or of messages that come: a newcomer's first questions, which ROS leaves open."""

import time
from collections.abc import Iterable, Mapping

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

from terrain_estimator.nodes.common.plain import guarded
from terrain_estimator.nodes.common.watchdog import unheard_publishers

PATIENCE_S = 5.0
SHOWN = 3
"""Topics of the same type that are named."""


def why_silent(node: Node, topic: str, type_name: str, qos: QoSProfile) -> str:
    """What the graph of this domain tells about a topic on which nothing came, and what to do."""
    finding = unheard_publishers(node, topic, type_name, qos)
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


class Pairs:
    """Says once that none of the messages are of one instant, where all topics are heard; and when some are."""

    def __init__(self, node: Node, topics: Iterable[str], patience_s: float = PATIENCE_S) -> None:
        """Nothing came yet."""
        self._node, self._topics, self._patience_s = node, tuple(topics), patience_s
        self._said = False
        self._begin()

    def _begin(self) -> None:
        self._since_s, self._unpaired = time.monotonic(), set[str]()

    def heard(self, topic: str, *, paired: bool) -> None:
        """A message came; whether it made messages of one instant complete."""
        if paired:
            if self._said:
                self._node.get_logger().info(
                    f"{' and '.join(self._topics)}: messages of one instant come now"
                )
            self._said = False
            self._begin()
            return
        self._unpaired.add(topic)
        if time.monotonic() - self._since_s < self._patience_s:
            return
        if not self._said and self._unpaired.issuperset(self._topics):
            self._said = True
            self._node.get_logger().warning(
                f"messages come on {' and '.join(self._topics)}, but for {self._patience_s:g} s"
                " none of one instant: publish them with equal stamps, or set pairing_tolerance of"
                " this node"
            )
        self._begin()


class Patience:
    """Says once of each topic that nothing comes, from the start or any more, and why; and when it comes again."""

    def __init__(
        self, node: Node, topics: Mapping[str, str], qos: QoSProfile, patience_s: float = PATIENCE_S
    ) -> None:
        """``topics`` gives the type by name."""
        self._node, self._qos, self._patience_s, self._topics = node, qos, patience_s, dict(topics)
        self._begun_s, self._heard_s, self._said = time.monotonic(), dict[str, float](), set[str]()
        node.create_timer(
            patience_s, guarded(node, self._say), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def heard(self, topic: str) -> None:
        """A message came."""
        self._heard_s[topic] = time.monotonic()
        if topic in self._said:
            self._said.remove(topic)
            self._node.get_logger().info(f"{topic}: messages come now")

    def _say(self) -> None:
        now = time.monotonic()
        for topic, kind in self._topics.items():
            silent_s = now - self._heard_s.get(topic, self._begun_s)
            if topic in self._said or silent_s < 0.9 * self._patience_s:  # a timer may be early
                continue
            self._said.add(topic)
            since = f"for {silent_s:.1f} s" if topic in self._heard_s else "since the start"
            self._node.get_logger().warning(
                f"no data on {topic} {since}: {why_silent(self._node, topic, kind, self._qos)}"
            )
