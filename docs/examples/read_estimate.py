# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Log c and tan phi once a second, with their covariance, and whether to trust them."""

import contextlib
import signal

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from msg_defs.msg import TerrainEstimate

OLD_S = 2.5


class Reader(Node):
    """Keep the last terrain_estimate, and log it once a second."""

    def __init__(self) -> None:
        super().__init__("reader")
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)  # no clock that is set back
        self.last: TerrainEstimate | None = None
        self.received = self.steady.now()
        self.create_subscription(
            TerrainEstimate, "terrain_estimate", self.take, QoSProfile(depth=50)
        )
        self.create_timer(1.0, self.show, clock=self.steady)

    def take(self, estimate: TerrainEstimate) -> None:
        """Keep the estimate and the time of its arrival."""
        self.last, self.received = estimate, self.steady.now()

    def doubt(self, estimate: TerrainEstimate) -> str:
        """Return why c and tan phi are not to be used; empty where they are."""
        silent_s = (self.steady.now() - self.received).nanoseconds * 1e-9
        if silent_s > OLD_S:
            return f"no new estimate for {silent_s:.0f} s"
        if estimate.status == TerrainEstimate.DISAGREES:
            return "they are the prior's, as the model does not fit"
        if not (estimate.cohesion_identified and estimate.tan_phi_identified):
            return estimate.status_text
        return ""

    def show(self) -> None:
        """Log the last estimate."""
        if self.last is None:
            self.get_logger().info("no estimate yet")
            return
        c_c, c_t, _, t_t = self.last.covariance
        doubt = self.doubt(self.last)
        self.get_logger().info(
            f"c {self.last.cohesion:.0f} Pa, tan phi {self.last.tan_phi:.3f},"
            f" variances {c_c:.3g} Pa^2 and {t_t:.3g}, covariance {c_t:.3g} Pa:"
            f" {f'do not use them: {doubt}' if doubt else 'use them'}"
        )


# rclpy's own handlers invalidate the context while spin prepares to wait, which then raises
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
signal.signal(signal.SIGTERM, signal.default_int_handler)
with contextlib.suppress(KeyboardInterrupt):
    rclpy.spin(Reader())
