# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives as fast as the planner allows: not before it has spoken, nor after it says stop or falls silent."""

import contextlib

import rclpy
from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile

from msg_defs.msg import TractionAdvice

SILENCE_S = 5.0


class Driver(Node):
    """Turns traction_advice into cmd_vel."""

    def __init__(self) -> None:
        super().__init__("driver")
        self.wanted = float(self.declare_parameter("speed", 0.15).value)
        self.obey = bool(self.declare_parameter("obey", value=True).value)
        self.allowed, self.stopped = 0.0, False
        self.steady = Clock(
            clock_type=ClockType.STEADY_TIME
        )  # one that is set back would take a dead planner's word for minutes
        self.heard = self.steady.now()
        self.output = self.create_publisher(Twist, "cmd_vel", QoSProfile(depth=50))
        self.create_subscription(TractionAdvice, "traction_advice", self.take, QoSProfile(depth=50))
        self.create_timer(0.02, self.drive, clock=self.steady)

    def take(self, advice: TractionAdvice) -> None:
        """Remember what is allowed; say why where that is nothing, and when it is something again."""
        self.heard = self.steady.now()
        self.allowed = min(self.wanted, advice.speed_limit)
        if advice.stop != self.stopped:
            self.stopped = advice.stop
            self.get_logger().info(advice.status_text)

    def drive(self) -> None:
        """Command the wheels."""
        silent = (self.steady.now() - self.heard).nanoseconds > SILENCE_S * 1e9
        command = Twist()
        command.linear.x = (0.0 if silent else self.allowed) if self.obey else self.wanted
        self.output.publish(command)


rclpy.init()
with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(Driver())
