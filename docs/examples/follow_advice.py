# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drive as fast as the planner allows, and stand still without its advice or after its stop."""

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
    """Convert traction_advice to cmd_vel."""

    def __init__(self) -> None:
        super().__init__("driver")
        self.wanted = float(self.declare_parameter("speed", 0.15).value)
        self.obey = bool(self.declare_parameter("obey", value=True).value)
        self.allowed, self.stopped = 0.0, False
        # steady: with a clock that is set back, old advice would count for minutes
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.received = self.steady.now()
        self.output = self.create_publisher(Twist, "cmd_vel", QoSProfile(depth=50))
        self.create_subscription(TractionAdvice, "traction_advice", self.take, QoSProfile(depth=50))
        self.create_timer(0.02, self.drive, clock=self.steady)

    def take(self, advice: TractionAdvice) -> None:
        """Store the allowed speed; log the reason of a stop, and the end of the stop."""
        self.received = self.steady.now()
        self.allowed = min(self.wanted, advice.speed_limit)
        if advice.stop != self.stopped:
            self.stopped = advice.stop
            self.get_logger().info(advice.status_text)

    def drive(self) -> None:
        """Command the wheels."""
        silent = (self.steady.now() - self.received).nanoseconds > SILENCE_S * 1e9
        command = Twist()
        command.linear.x = (0.0 if silent else self.allowed) if self.obey else self.wanted
        if self.context.ok():  # a signal may have ended it since the timer fired
            self.output.publish(command)


rclpy.init()
with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
    rclpy.spin(Driver())
