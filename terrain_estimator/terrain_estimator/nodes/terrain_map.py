# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Publish the map as a node: estimates and costs along the track, latched for late subscribers."""

import math
import sys
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from rover_parameters.command_line import run
from terrain_estimator.config.map import MapConfig
from terrain_estimator.messaging.map_grid import drawn, grid_message
from terrain_estimator.messaging.map_track import MapTrack, cloud_message
from terrain_estimator.messaging.pairing import InputTopic, Synchronizer
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.inactivity import InactivityMonitor, PairingMonitor
from terrain_estimator.nodes.common.message_types import make, message_class
from terrain_estimator.nodes.common.qos import subscribe
from terrain_estimator.nodes.common.running import LOG_PERIOD_S, guarded, serve
from terrain_estimator.nodes.common.traction import read_traction
from terrain_estimator.planning.belief import Belief, draw
from terrain_estimator.planning.margins import margins
from terrain_estimator.planning.messages import belief_of_message
from terrain_estimator.topics import ESTIMATE, INPUT_TYPES, Message, stamp_ns

QOS = QoSProfile(depth=50)  # reliable, volatile, keep last
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
TOPICS = {"terrain_estimate": ESTIMATE, "odom": INPUT_TYPES["odom"]}


class MapNode(Node):
    """Publish the whole cloud and grid once a period of the stamps, where they have changed."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and the model, and subscribe; ``options`` are rclpy's.

        Raises ConfigError where a parameter is wrong, or the model file.
        """
        super().__init__(
            "terrain_map", automatically_declare_parameters_from_overrides=True, **options
        )
        config = declare(self, MapConfig, TOPICS, arguments=options.get("cli_args"))
        self._config, traction = config, read_traction(config.model, config.rover)
        self._model, self._table = traction.metadata, traction.table
        if traction.solved:
            self.get_logger().warning(traction.solved)
        self._track = MapTrack(config.spacing_m, config.points)
        topics = tuple(InputTopic(name, required=True) for name in TOPICS)
        self._synchronizer = Synchronizer(topics, round(config.tolerance_s * 1e9))
        self._period_ns, self._published_ns, self._changed = round(config.period_s * 1e9), 0, False
        self._output = self.create_publisher(
            message_class("sensor_msgs/msg/PointCloud2"), "terrain_map", LATCHED
        )
        self._grid_output = self.create_publisher(
            message_class("nav_msgs/msg/OccupancyGrid"), "terrain_grid", LATCHED
        )
        self._inactivity = InactivityMonitor(self, TOPICS, QOS)
        self._pairing = PairingMonitor(self, TOPICS)
        for index, (topic, kind) in enumerate(TOPICS.items()):
            self._subscribe(index, topic, kind)
        self.get_logger().info("ready")

    def _belief(self, estimate: Message) -> Belief:
        """Read an estimate; ValueError if it is invalid, or by another model than this node's."""
        if estimate.model_sha256 != self._model.sha256:
            raise ValueError(f"this node has {self._model.model_id}: give both the same")
        return belief_of_message(estimate, [soil.name for soil in self._model.soils])

    def _slope_limit(self, estimate: Message) -> float:
        """Return the slope that the rover climbs with 95 % confidence [rad]; NaN: not known."""
        try:
            belief = self._belief(estimate)
        except ValueError as error:
            text = f"terrain_grid lacks an estimate of model {estimate.model_id}: {error}"
            self.get_logger().error(text, throttle_duration_sec=LOG_PERIOD_S)
            return math.nan
        if not belief.identified or belief.disagrees:
            return math.nan
        ground = draw(belief.mean, belief.covariance, belief.soil_probability)
        doubts = (self._config.slip_limit, self._config.pull_deviation)
        return margins(self._table, ground, 0.0, *doubts).slope_limit.lower

    def _subscribe(self, index: int, topic: str, kind: str) -> None:
        def receive(message: Message) -> None:
            self._inactivity.received(topic)
            pairs = self._synchronizer.add(index, stamp_ns(message), message)
            self._pairing.received(topic, paired=bool(pairs))
            for pair in pairs:
                self._take(*pair.messages)

        subscribe(self, kind, topic, guarded(self, receive), QOS)

    def _take(self, estimate: Message, odometry: Message) -> None:
        self._changed = self._track.add(estimate, odometry, self._slope_limit) or self._changed
        now = stamp_ns(estimate)
        if self._changed and not 0 <= now - self._published_ns < self._period_ns:
            header = make(
                "std_msgs/msg/Header",
                stamp=estimate.header.stamp,
                frame_id=odometry.header.frame_id,
            )
            self._output.publish(cloud_message(self._track, make, header))
            grid = drawn(self._track.points(), self._config.grid)
            if grid is not None:
                self._grid_output.publish(grid_message(grid, make, header))
            self._published_ns, self._changed = now, False


def main() -> int:
    """Publish until SIGINT or SIGTERM; return 0, or 2 for wrong parameters."""
    return run("terrain_map", "spacing:=0.2", MapConfig, lambda stop: serve(MapNode(), stop))


if __name__ == "__main__":
    sys.exit(main())
