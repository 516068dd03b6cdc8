# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Serve the live page as a node: messages in, a page for browsers out."""

import asyncio
import sys
import threading
import time
import uuid

from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from rover_parameters.command_line import run
from rover_parameters.ending import destroy
from terrain_estimator.config.dashboard import DashboardConfig
from terrain_estimator.dashboard.log_limit import limited_log
from terrain_estimator.dashboard.model import LiveModel
from terrain_estimator.dashboard.values import TOPICS
from terrain_estimator.dashboard.web import WebServer
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.inactivity import InactivityMonitor
from terrain_estimator.nodes.common.message_types import message_class
from terrain_estimator.nodes.common.running import guarded, guarded_turn
from terrain_estimator.topics import LISTENED, TRUTH, Message

DEPTH = 50  # messages; 5 s at 10 Hz
QOS = QoSProfile(depth=DEPTH)  # reliable, volatile, keep last
LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class Dashboard(Node):
    """Feed the page with messages, in batches at the rate of the page.

    Waking up for every message would cost twice the processor time.
    """

    def __init__(self) -> None:
        """Read the parameters and subscribe. Raises ConfigError where one is wrong."""
        super().__init__("dashboard", automatically_declare_parameters_from_overrides=True)
        self._config = declare(self, DashboardConfig)
        resume = self.resolve_service_name("planner/resume")
        self._model = LiveModel(uuid.uuid4().hex, self._config.shown, resume)
        self._taken = 0
        self._turn = guarded_turn(self)
        self._inactivity = InactivityMonitor(self, LISTENED, QOS)
        for topic, (kind, _) in TOPICS.items():
            self._subscribe(topic, kind)

    def _subscribe(self, topic: str, kind: str) -> None:
        def receive(message: Message) -> None:
            self._taken += 1
            self._inactivity.received(topic)
            self._model.take(topic, message, time.monotonic())

        self.create_subscription(
            message_class(kind), topic, guarded(self, receive), LATCHED if kind == TRUTH else QOS
        )

    def _take_all(self) -> None:
        """Serve the waiting callbacks; stop after two turns in a row without a message.

        A single empty turn may be one of the executor's own.
        """
        empty = 0
        for _ in range(DEPTH * len(TOPICS)):
            before = self._taken
            self._turn(0.0)
            empty = empty + 1 if self._taken == before else 0
            if empty == 2:
                return

    async def serve(self, stop: threading.Event) -> None:
        """Serve the page until ``stop`` is set. Raises ConfigError where the port is taken."""
        with limited_log(self.get_logger().warning) as log:
            server = WebServer(self._model, self._config.address, self._config.port)
            self.get_logger().info(f"ready: {server.url}")

            def take() -> None:
                self._take_all()
                log.report()

            await server.serve(stop, self._config.rate, take)


def main() -> int:
    """Serve until SIGINT or SIGTERM; return 0, or 2 for wrong parameters or a taken port."""
    return run("dashboard", "port:=8091", DashboardConfig, _serve)


def _serve(stop: threading.Event) -> int:
    node = Dashboard()
    asyncio.run(node.serve(stop))
    destroy(node)
    return 0


if __name__ == "__main__":
    sys.exit(main())
