# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Reference of the live figures: a node with the estimator's topics that estimates nothing.

It answers every imu message, and counts what it receives.
"""

import contextlib
from functools import partial

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from terrain_estimator.nodes.common import message_types
from terrain_estimator.topics import ESTIMATE, HEALTH, INPUT_TYPES, Message

QOS = QoSProfile(depth=50)
PERIOD_S = 1.0
"""[s] Period of its health, as the estimator's."""


class EmptyNode(Node):
    """Node with the inputs of the estimator."""

    def __init__(self) -> None:
        """Subscribe to the inputs; the imu's message is the last of a set."""
        super().__init__("empty")
        self._output = self.create_publisher(
            message_types.message_class(ESTIMATE), "terrain_estimate", QOS
        )
        self._health = self.create_publisher(
            message_types.message_class(HEALTH), "estimator_health", QOS
        )
        self._received = dict.fromkeys(INPUT_TYPES, 0)
        for name, type_name in INPUT_TYPES.items():
            self.create_subscription(
                message_types.message_class(type_name), name, partial(self._take, name), QOS
            )
        self.create_timer(PERIOD_S, self._report)
        self.get_logger().info("ready")

    def _take(self, topic: str, message: Message) -> None:
        self._received[topic] += 1
        if topic == "imu":
            self._output.publish(message_types.make(ESTIMATE, header=message.header))

    def _report(self) -> None:
        self._health.publish(
            message_types.make(
                HEALTH,
                input_topic=list(self._received),
                input_received=list(self._received.values()),
            )
        )


def main() -> None:
    """Spin until SIGINT."""
    # rclpy's own handlers invalidate the context while spin prepares to wait, which then raises
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with contextlib.suppress(KeyboardInterrupt):
        rclpy.spin(EmptyNode())
    rclpy.shutdown()


if __name__ == "__main__":
    main()
