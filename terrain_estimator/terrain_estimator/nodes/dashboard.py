# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The live page as a node: wiring only. Messages in, a page for browsers out."""

import asyncio
import sys
import threading
import time
import uuid

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from terrain_estimator.config import DashboardConfig
from terrain_estimator.dashboard.model import LiveModel
from terrain_estimator.dashboard.values import TOPICS
from terrain_estimator.dashboard.web import WebServer
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.factory import message_class
from terrain_estimator.nodes.common.plain import guarded, run
from terrain_estimator.nodes.common.silence import Patience
from terrain_estimator.topics import LISTENED, TRUTH, Message

DEPTH = 50  # messages; 5 s at 10 Hz
QOS = QoSProfile(depth=DEPTH)  # reliable, volatile, keep last
LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


class Dashboard(Node):
    """Takes what is shown, in handfuls at the rate of the page: to wake up for every message would cost twice the processor time."""

    def __init__(self) -> None:
        """Read the parameters and subscribe. Raises ConfigError where one is wrong."""
        super().__init__("dashboard", automatically_declare_parameters_from_overrides=True)
        self._config = declare(self, DashboardConfig)
        self._model = LiveModel(uuid.uuid4().hex, self._config.shown)
        self._taken = 0
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        self._turn = guarded(self, self._executor.spin_once)  # rclpy's own callbacks raise too
        self._patience = Patience(self, LISTENED, QOS)
        for topic, (kind, _) in TOPICS.items():
            self._subscribe(topic, kind)

    def _subscribe(self, topic: str, kind: str) -> None:
        def receive(message: Message) -> None:
            self._taken += 1
            self._patience.heard(topic)
            self._model.take(topic, message, time.monotonic())

        self.create_subscription(
            message_class(kind), topic, guarded(self, receive), LATCHED if kind == TRUTH else QOS
        )

    def _take_all(self) -> None:
        """Serve what waits. One empty round proves nothing: the executor may have seen to itself."""
        empty = 0
        for _ in range(DEPTH * len(TOPICS)):
            before = self._taken
            self._turn(0.0)
            empty = empty + 1 if self._taken == before else 0
            if empty == 2:
                return

    async def serve(self, stop: threading.Event) -> None:
        """Show the page until ``stop`` is set. Raises ConfigError where it cannot listen."""
        server = WebServer(self._model, self._config.address, self._config.port)
        self.get_logger().info(f"ready: {server.url}")
        await server.serve(stop, self._config.rate, self._take_all)


def main() -> int:
    """Serve until SIGINT or SIGTERM. Returns 0 after a signal or ``--help``, 2 where parameters are wrong or the port is taken."""
    return run(
        "dashboard",
        "port:=8091",
        DashboardConfig,
        Dashboard,
        lambda node, stop: asyncio.run(node.serve(stop)),
    )


if __name__ == "__main__":
    sys.exit(main())
