# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A rover in this process and the node under test in another, on real DDS."""

import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self, TypeAlias

import rclpy
from domain_coordinator import domain_id as reserve_domain_id
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message

from benchmarks.drives import long_drive
from terrain_estimator.nodes.common import message_types
from terrain_estimator.topics import ESTIMATE, HEALTH, INPUT_TYPES, Message
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until

Set: TypeAlias = list[tuple[str, bytes]]
"""The messages of one instant, serialised, by topic."""
STEP_S = 0.1
DEEP = QoSProfile(depth=10000)
STAMP = struct.Struct("<iI")
"""Seconds and nanoseconds after the four bytes of encapsulation, in messages with a header."""
START_S, LAST_S = 60.0, 2.0
COUNTED_S = 3.0
"""[s] Time for the node to report its count of messages: its health comes once a second."""
ESTIMATOR, EMPTY = "estimator", "a node that answers without estimating"
WARM_UP = 50
"""Observations before anything is measured."""


@dataclass(slots=True)
class Sent:
    """One exchange."""

    # by stamp [ns]: when the last message of the set was published
    sent_s: dict[int, float] = field(default_factory=dict)
    # by stamp: until the estimate arrived
    latency_s: dict[int, float] = field(default_factory=dict)
    late_s: float = 0.0  # behind its own schedule at the end
    # messages that the node has not received, by its own count, optional ones included
    missed: int = 0

    @property
    def lost(self) -> int:
        """Number of sets without an answer."""
        return len(self.sent_s) - len(self.latency_s)


class MessageSender:
    """Sender of sets of messages at a rate; it times the answers by the same clock."""

    def __init__(self, domain_id: int) -> None:
        """Create a node with its own context."""
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node("rover", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._outputs = {
            name: self._node.create_publisher(message_types.message_class(type_name), name, DEEP)
            for name, type_name in INPUT_TYPES.items()
        }
        self._answers = self._node.create_subscription(
            message_types.message_class(ESTIMATE), "terrain_estimate", self._take, DEEP, raw=True
        )
        self._node.create_subscription(
            message_types.message_class(HEALTH), "estimator_health", self._count, DEEP
        )
        self._now, self._received = Sent(), 0

    def __enter__(self) -> Self:
        """Return the sender."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def meet(self) -> None:
        """Wait until both sides have found each other."""
        ends = [output.get_subscription_count for output in self._outputs.values()]
        wait_until(
            lambda: self._answers.get_publisher_count() and all(end() for end in ends),
            "all topics are matched",
            START_S,
        )

    def drive(self, sets: Iterator[Set], count: int, rate_hz: float) -> Sent:
        """Send ``count`` sets; wait for the last answers and for the node's count of messages."""
        self._now = now = Sent()
        before = self._received
        chosen = [next(sets) for _ in range(count)]
        begun_s = time.perf_counter()
        for place, messages in enumerate(chosen):
            due_s = begun_s + place / rate_hz
            while (left_s := due_s - time.perf_counter()) > 0.0:
                self._executor.spin_once(timeout_sec=left_s)
            for name, data in messages:
                self._outputs[name].publish(data)
            now.sent_s[_stamp_ns(messages[-1][1])] = time.perf_counter()
            self._executor.spin_once(timeout_sec=0.0)
        now.late_s = time.perf_counter() - begun_s - (count - 1) / rate_hz
        end_s = time.perf_counter() + LAST_S
        while now.lost and time.perf_counter() < end_s:
            self._executor.spin_once(timeout_sec=0.01)
        expected, end_s = before + sum(map(len, chosen)), time.perf_counter() + COUNTED_S
        while self._received < expected and time.perf_counter() < end_s:
            self._executor.spin_once(timeout_sec=0.01)
        now.missed = expected - self._received
        return now

    def _take(self, data: bytes) -> None:
        stamp_ns, here_s = _stamp_ns(data), time.perf_counter()
        if stamp_ns in self._now.sent_s:
            self._now.latency_s[stamp_ns] = here_s - self._now.sent_s[stamp_ns]

    def _count(self, health: Message) -> None:
        self._received = sum(health.input_received)


@contextmanager
def facing(node: str) -> Iterator[tuple[MessageSender, Process]]:
    """Start ESTIMATOR or EMPTY, and yield it with a connected rover."""
    with (
        tempfile.TemporaryDirectory() as folder,
        reserve_domain_id() as domain_id,
        Starter(Path(folder), domain_id) as start,
    ):
        if node == ESTIMATOR:
            process = start("terrain_estimator", "estimator")
        else:
            process = start.command(sys.executable, "-m", "benchmarks.empty_node")
        process.wait_for_output("ready", START_S)
        with MessageSender(domain_id) as rover:
            rover.meet()
            yield rover, process
        process.interrupt()


def sets(count: int) -> Iterator[Set]:
    """Yield instants of a drive, stamped a tenth of a second apart, however fast they are sent."""
    instant: Set = []
    for topic, _, message in long_drive(message_types.make, count * STEP_S):
        instant.append((topic, serialize_message(message)))
        if len(instant) == len(INPUT_TYPES):
            yield instant
            instant = []


def _stamp_ns(data: bytes) -> int:
    sec, nanosec = STAMP.unpack_from(data, 4)
    return int(sec) * 1_000_000_000 + int(nanosec)
