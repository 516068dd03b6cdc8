# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Creeps until the planner has said something, then drives as it allows; stops when it says so, or when it falls silent."""

import contextlib

import rclpy
from geometry_msgs.msg import Twist
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time

from msg_defs.msg import TractionAdvice

SILENCE_S = 5.0
CREEP = 0.05  # [m/s] of a rover that the planner has not seen move yet


class Driver(Node):
    """Turns traction_advice into cmd_vel."""

    def __init__(self) -> None:
        super().__init__("driver")
        self.wanted = float(self.declare_parameter("speed", 0.15).value)
        self.obey = bool(self.declare_parameter("obey", value=True).value)
        self.allowed, self.stopped = min(self.wanted, CREEP), False
        self.heard: Time | None = None
        self.output = self.create_publisher(Twist, "cmd_vel", QoSProfile(depth=50))
        self.create_subscription(TractionAdvice, "traction_advice", self.take, QoSProfile(depth=50))
        self.create_timer(0.02, self.drive)

    def take(self, advice: TractionAdvice) -> None:
        """Remember what is allowed; say why where it is nothing."""
        self.heard = self.get_clock().now()
        self.allowed = min(self.wanted, advice.speed_limit)
        if advice.stop and not self.stopped:
            self.stopped = True
            self.get_logger().info(f"{advice.status_text}; slip {advice.measured_slip:.2f}")

    def drive(self) -> None:
        """Command the wheels."""
        silent = self.heard is not None and (self.get_clock().now() - self.heard).nanoseconds > SILENCE_S * 1e9
        command = Twist()
        command.linear.x = (0.0 if silent else self.allowed) if self.obey else self.wanted
        self.output.publish(command)


rclpy.init()
with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(Driver())
