# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A node inside the test that subscribes, publishes and calls services."""

import itertools
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self, TypeVar

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from tests.system.waiting import PATIENCE_S, wait_until

T = TypeVar("T")
NodeT = TypeVar("NodeT", bound=Node)
RELIABLE = QoSProfile(depth=1000)
_numbers = itertools.count()
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Listener:
    """Node in the test's ROS domain. Callbacks run only while one of its methods waits."""

    def __init__(self, domain_id: int, namespace: str = "") -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self.node = rclpy.create_node(
            f"listener_{next(_numbers)}", namespace=namespace, context=self._context
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def spin_until(
        self,
        condition: Callable[[], T],
        what: str,
        timeout: float = PATIENCE_S,
        seen: Callable[[], object] = lambda: "",
    ) -> T:
        """Run callbacks until the condition holds; return its value. Raises TimeOutError."""

        def spin() -> T:
            self._executor.spin_once(timeout_sec=0.01)
            return condition()

        return wait_until(spin, what, timeout, seen)

    def host(self, make: Callable[..., NodeT], **options: Any) -> NodeT:
        """Make another node in this process, in the same executor."""
        node = make(context=self._context, **options)
        self._executor.add_node(node)
        return node

    def leave(self, node: Node) -> None:
        """End a node that :meth:`host` made."""
        self._executor.remove_node(node)
        node.destroy_node()

    def collect(self, kind: type, topic: str, qos: QoSProfile = RELIABLE) -> list[Any]:
        """Subscribe; the returned list grows with every message that arrives while waiting."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def publisher(
        self,
        kind: type,
        topic: str,
        qos: QoSProfile = RELIABLE,
        readers: int = 1,
        timeout: float = PATIENCE_S,
    ) -> Publisher:
        """Return a publisher that so many subscriptions have matched."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self.spin_until(
            lambda: publisher.get_subscription_count() >= readers,
            f"{readers} readers of {topic} have matched",
            timeout,
        )
        return publisher

    def wait_for_messages(
        self, messages: list[Any], count: int, timeout: float = PATIENCE_S
    ) -> None:
        """Wait until the list of `collect` has so many messages."""
        self.spin_until(
            lambda: len(messages) >= count,
            f"{count} messages have arrived",
            timeout,
            lambda: f"{len(messages)} came.",
        )

    def call(self, kind: Any, service: str, request: object, timeout: float = PATIENCE_S) -> Any:
        """Call a service; return its response."""
        client = self.node.create_client(kind, service)
        self.spin_until(client.service_is_ready, f"the service {service} is there", timeout)
        future = client.call_async(request)
        self.spin_until(future.done, f"the service {service} has answered", timeout)
        return future.result()
