# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drive as fast as the planner allows, and stand still without its advice or after its stop."""

import contextlib
import signal

import rclpy
from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

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
        self.output.publish(command)


# rclpy's own handlers invalidate the context while spin prepares to wait, which then raises
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
signal.signal(signal.SIGTERM, signal.default_int_handler)
with contextlib.suppress(KeyboardInterrupt):
    rclpy.spin(Driver())
