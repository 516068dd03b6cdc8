# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Publish the map as a node: the estimates along the track, latched for late subscribers."""

import sys

from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from rover_parameters.command_line import run
from terrain_estimator.config.map import MapConfig
from terrain_estimator.messaging.map_track import MapTrack, cloud_message
from terrain_estimator.messaging.pairing import InputTopic, Synchronizer
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.inactivity import InactivityMonitor, PairingMonitor
from terrain_estimator.nodes.common.message_types import make, message_class
from terrain_estimator.nodes.common.qos import subscribe
from terrain_estimator.nodes.common.running import guarded, serve
from terrain_estimator.topics import ESTIMATE, INPUT_TYPES, Message, stamp_ns

QOS = QoSProfile(depth=50)  # reliable, volatile, keep last
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
TOPICS = {"terrain_estimate": ESTIMATE, "odom": INPUT_TYPES["odom"]}


class MapNode(Node):
    """Publish the whole cloud once a period of the stamps, where it has changed."""

    def __init__(self) -> None:
        """Read the parameters and subscribe. Raises ConfigError where one is wrong."""
        super().__init__("terrain_map", automatically_declare_parameters_from_overrides=True)
        config = declare(self, MapConfig, TOPICS)
        self._track = MapTrack(config.spacing_m, config.points)
        topics = tuple(InputTopic(name, required=True) for name in TOPICS)
        self._synchronizer = Synchronizer(topics, round(config.tolerance_s * 1e9))
        self._period_ns, self._published_ns, self._changed = round(config.period_s * 1e9), 0, False
        self._output = self.create_publisher(
            message_class("sensor_msgs/msg/PointCloud2"), "terrain_map", LATCHED
        )
        self._inactivity = InactivityMonitor(self, TOPICS, QOS)
        self._pairing = PairingMonitor(self, TOPICS)
        for index, (topic, kind) in enumerate(TOPICS.items()):
            self._subscribe(index, topic, kind)
        self.get_logger().info("ready")

    def _subscribe(self, index: int, topic: str, kind: str) -> None:
        def receive(message: Message) -> None:
            self._inactivity.received(topic)
            pairs = self._synchronizer.add(index, stamp_ns(message), message)
            self._pairing.received(topic, paired=bool(pairs))
            for pair in pairs:
                self._take(*pair.messages)

        subscribe(self, kind, topic, guarded(self, receive), QOS)

    def _take(self, estimate: Message, odometry: Message) -> None:
        self._changed = self._track.add(estimate, odometry) or self._changed
        now = stamp_ns(estimate)
        if self._changed and not 0 <= now - self._published_ns < self._period_ns:
            header = make(
                "std_msgs/msg/Header",
                stamp=estimate.header.stamp,
                frame_id=odometry.header.frame_id,
            )
            self._output.publish(cloud_message(self._track, make, header))
            self._published_ns, self._changed = now, False


def main() -> int:
    """Publish until SIGINT or SIGTERM; return 0, or 2 for wrong parameters."""
    return run("terrain_map", "spacing:=0.2", MapConfig, lambda stop: serve(MapNode(), stop))


if __name__ == "__main__":
    sys.exit(main())
