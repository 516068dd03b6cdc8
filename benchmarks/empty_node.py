# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The reference of the live figures: a node with the estimator's topics that answers every imu message and estimates nothing."""

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile

from terrain_estimator.nodes import factory
from terrain_estimator.ros_types import ESTIMATE, INPUT_TYPES, Message

QOS = QoSProfile(depth=50)


class EmptyNode(Node):
    """Takes what the estimator takes."""

    def __init__(self) -> None:
        """Subscribe to the inputs; the imu's message is the last of a set."""
        super().__init__("empty")
        self._output = self.create_publisher(factory.message_class(ESTIMATE), "terrain_estimate", QOS)
        for name, type_name in INPUT_TYPES.items():
            self.create_subscription(factory.message_class(type_name), name, self._answer if name == "imu" else _forget, QOS)
        self.get_logger().info("ready")

    def _answer(self, message: Message) -> None:
        self._output.publish(factory.make(ESTIMATE, header=message.header))


def _forget(_: Message) -> None:
    """Deserialised, and that is all."""


def main() -> None:
    """Spin until SIGINT."""
    rclpy.init()
    try:
        rclpy.spin(EmptyNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
