# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Compute wheel slip as a node: wheel rates and velocity in, wheel_slip out.

With empty_sinkage also wheel_sinkage, for a rover that measures neither sinkage nor contact angle.
"""

import sys
from collections.abc import Iterator
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from rover_parameters.command_line import run
from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.messaging.diagnostics import REFUSED, CheckResult
from terrain_estimator.messaging.pairing import MessageSet
from terrain_estimator.messaging.slip_source import (
    JOINTS,
    TWICE,
    VELOCITY,
    VELOCITY_TYPES,
    SlipSource,
    SlipSourceError,
)
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.diagnostics import DiagnosticsPublisher
from terrain_estimator.nodes.common.inactivity import InactivityMonitor, PairingMonitor
from terrain_estimator.nodes.common.message_types import make, message_class
from terrain_estimator.nodes.common.qos import subscribe
from terrain_estimator.nodes.common.running import guarded, serve
from terrain_estimator.topics import INPUT_TYPES, Message
from terramechanics.presets import load_rover

QOS = QoSProfile(depth=50)  # reliable, volatile, keep last


class SlipSourceNode(Node):
    """Publish the slip of all wheels for every pair of wheel rates and velocity."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and subscribe; ``options`` are rclpy's.

        Raises ConfigError where a parameter is wrong.
        """
        super().__init__(
            "slip_source", automatically_declare_parameters_from_overrides=True, **options
        )
        config = declare(
            self, SlipSourceConfig, (JOINTS, VELOCITY), arguments=options.get("cli_args")
        )
        rover = load_rover(config.rover)
        self._source = SlipSource(rover, config)
        self._output = self.create_publisher(
            message_class(INPUT_TYPES["wheel_slip"]), "wheel_slip", QOS
        )
        self._empty = (
            self.create_publisher(message_class(INPUT_TYPES["wheel_sinkage"]), "wheel_sinkage", QOS)
            if config.empty_sinkage
            else None
        )
        topics = {JOINTS: INPUT_TYPES[JOINTS], VELOCITY: VELOCITY_TYPES[config.velocity_type]}
        self._inactivity = InactivityMonitor(self, topics, QOS)
        self._pairing = PairingMonitor(self, topics)
        # since the last report: pairs that were used, and why the others were refused
        self._used, self._refused = 0, list[str]()
        self._diagnostics = DiagnosticsPublisher(self, self._findings)
        for topic, kind in topics.items():
            self._subscribe(topic, kind)
        if self.resolve_topic_name(VELOCITY) == self.resolve_topic_name("odom"):
            self.get_logger().warning(TWICE)
        self.get_logger().info(f"ready: rover {rover.name}, wheels {', '.join(rover.wheel_names)}")

    def _subscribe(self, topic: str, kind: str) -> None:
        def receive(message: Message) -> None:
            self._inactivity.received(topic)
            pairs = self._source.pair(topic, message)
            self._pairing.received(topic, paired=bool(pairs))
            for pair in pairs:
                self._publish(pair)

        subscribe(self, kind, topic, guarded(self, receive), QOS)

    def _publish(self, pair: MessageSet) -> None:
        try:
            message = self._source.slip_message(pair, make)
        except SlipSourceError as error:
            self._refused.append(str(error))
            return
        self._output.publish(message)
        if self._empty:
            self._empty.publish(self._source.sinkage_message(message, make))
        self._used += 1

    def _findings(self) -> Iterator[CheckResult]:
        count = len(self._refused)
        words = f"{count} of {self._used + count} pairs: {self._refused[-1]}" if count else "none"
        yield REFUSED.judge(count / max(self._used + count, 1), text=f"refused: {words}")
        self._used, self._refused = 0, []


def main() -> int:
    """Publish until SIGINT or SIGTERM; return 0, or 2 for wrong parameters."""
    return run(
        "slip_source", "rover:=FILE", SlipSourceConfig, lambda stop: serve(SlipSourceNode(), stop)
    )


if __name__ == "__main__":
    sys.exit(main())
