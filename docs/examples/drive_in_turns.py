# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drive straight on, to the left, straight on, to the right, and so on, by cmd_vel."""

import contextlib
import signal

import rclpy
from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

TURNS = (0.0, 1.0, 0.0, -1.0)
"""Of the yaw rate, one after the other."""


class Driver(Node):
    """Publish cmd_vel ten times a second."""

    def __init__(self) -> None:
        super().__init__("driver")
        self.speed = float(self.declare_parameter("speed", 0.08).value)  # [m/s]
        self.yaw_rate = float(self.declare_parameter("yaw_rate", 0.04).value)  # [rad/s]
        self.leg = float(self.declare_parameter("leg", 10.0).value)  # [s] of each
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.start = self.steady.now()
        self.output = self.create_publisher(Twist, "cmd_vel", QoSProfile(depth=50))
        self.create_timer(0.1, self.drive, clock=self.steady)

    def drive(self) -> None:
        """Command the present leg; every second one is faster."""
        gone = (self.steady.now() - self.start).nanoseconds * 1e-9
        leg = int(gone / self.leg)
        command = Twist()
        command.linear.x = self.speed * (1.0 if leg % 2 else 1.4)
        command.angular.z = self.yaw_rate * TURNS[leg % len(TURNS)]
        self.output.publish(command)


# rclpy's own handlers invalidate the context while spin prepares to wait, which then raises
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
signal.signal(signal.SIGTERM, signal.default_int_handler)
with contextlib.suppress(KeyboardInterrupt):
    rclpy.spin(Driver())
