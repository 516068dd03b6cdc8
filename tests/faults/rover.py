# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A rover that publishes a simulated drive at 10 Hz to a real estimator, and keeps the answers."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from msg_defs.msg import MotionPrediction, TerrainEstimate
from terrain_estimator.nodes.common import message_types
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import INPUT_TYPES, stamp_ns
from tests.drives import Event, drive_messages
from tests.faults.logs import log_lines
from tests.system.listening import RELIABLE, Listener
from tests.system.processes import Process, Starter

PERIOD_S = 0.1
DRIVE_S = 22.0
MOST_REFUSED = 20
PATIENCE_S = 240.0
"""[s] Time for a process to start, even on a busy machine."""
Change = Callable[[list[Event]], list[Event]]


@dataclass(frozen=True, slots=True)
class Sent:
    """One published instant."""

    stamp_ns: int
    sound: bool


class Rover:
    """Publisher of instants at their due times, with callbacks between."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        self.folder = folder
        self.start = Starter(folder, domain_id)
        self.listener = Listener(domain_id)
        self.estimates: list[tuple[float, Any]] = []  # with the time of arrival
        self.predictions = self.listener.collect(MotionPrediction, "motion_prediction")
        self.diagnostics = self.listener.collect(DiagnosticArray, "/diagnostics")
        self.listener.node.create_subscription(
            TerrainEstimate, "terrain_estimate", self._hear, RELIABLE
        )
        self.shift_ns = 0
        self.sent: list[Sent] = []
        events = list(drive_messages(message_types.make, DRIVE_S))
        self._instants = [
            events[at : at + len(INPUT_TYPES)] for at in range(0, len(events), len(INPUT_TYPES))
        ]
        self._publishers: dict[str, Publisher] = {}
        self._due_s = 0.0
        self._end: tuple[int, float] | None = None
        self.processes: list[Process] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.start.__exit__(kind, error, trace)
        self.listener.__exit__(kind, error, trace)

    def estimator(self, parameters: dict[str, str]) -> Process:
        """Start an estimator."""
        given = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        self.processes.append(self.start("terrain_estimator", "estimator", "--ros-args", *given))
        return self.processes[-1]

    def match(self, estimator: Process) -> None:
        """Wait until all topics of the estimator are matched."""
        estimator.wait_for_output("ready: model", timeout=PATIENCE_S)
        for topic in INPUT_TYPES:
            if topic not in self._publishers:
                self.advertise(topic, RELIABLE)
        self.wait_for_matches()
        estimator.wait_for_output("matched all inputs", timeout=PATIENCE_S)

    def wait_for_matches(self) -> None:
        """Wait until every publisher and subscription has its partner."""
        for publisher in self._publishers.values():
            self.listener.spin_until(
                publisher.get_subscription_count, f"{publisher.topic_name} is matched", PATIENCE_S
            )
        for subscription in self.listener.node.subscriptions:
            self.listener.spin_until(
                subscription.get_publisher_count,
                f"{subscription.topic_name} is matched",
                PATIENCE_S,
            )

    def advertise(self, topic: str, qos: QoSProfile) -> None:
        """Publish a topic with this quality of service from now on."""
        if topic in self._publishers:
            self.listener.node.destroy_publisher(self._publishers[topic])
        self._publishers[topic] = self.listener.node.create_publisher(
            message_types.message_class(INPUT_TYPES[topic]), topic, qos
        )

    def drive(self, seconds: float, change: Change | None = None, *, sound: bool = True) -> None:
        """Publish the next instants, changed; instants that are not sound never count as lost."""
        for _ in range(round(seconds / PERIOD_S)):
            events = self.next_instant()
            self.publish(change(events) if change else events, sound=sound)

    def drive_until_accepted(self) -> None:
        """Publish sound instants until one is accepted; wait for the last. Raises TimeOutError."""
        first = len(self.sent)
        for _ in range(MOST_REFUSED):
            self.drive(PERIOD_S)
            if self.accepted(self.sent[first:]):
                return
        self.listener.spin_until(
            lambda: self.accepted(self.sent[first:]), "an observation is accepted", PATIENCE_S
        )

    def next_instant(self) -> list[Event]:
        """Return the messages of the next instant."""
        return shifted(self._instants.pop(0), self.shift_ns)

    def publish(self, events: Sequence[Event], *, sound: bool = True) -> None:
        """Publish these when the next instant is due."""
        now = time.monotonic()
        self._due_s = max(self._due_s + PERIOD_S, now - PERIOD_S)
        self.wait(self._due_s - now)
        self.sent += [
            Sent(stamp, sound) for stamp in dict.fromkeys(stamp for _, stamp, _ in events)
        ]
        for topic, _, message in events:
            self._publishers[topic].publish(message)

    def wait(self, seconds: float) -> None:
        """Serve callbacks for some seconds."""
        end = time.monotonic() + seconds
        self.listener.spin_until(
            lambda: time.monotonic() >= end, "the time has passed", seconds + 20.0
        )

    def accepted(self, sent: Sequence[Sent]) -> list[tuple[float, Any]]:
        """Return the estimates of these instants, with their times of arrival."""
        stamps = {each.stamp_ns for each in sent}
        return [
            (at, each)
            for at, each in self.estimates
            if stamp_ns(each) in stamps and Outcome(each.decision.outcome).used
        ]

    def end_fault(self) -> None:
        """Mark the end of the fault; only the first call counts."""
        self._end = self._end or (len(self.sent), time.monotonic())

    @property
    def end(self) -> tuple[int, float]:
        """Return the instants published before the end of the fault, and its time."""
        assert self._end is not None, "the fault has not ended"
        return self._end

    def log_lines(self) -> list[str]:
        """Return the estimators' log from WARN on, without lines of a busy machine."""
        return [line for process in self.processes for line in log_lines(process.output)]

    def _hear(self, message: Any) -> None:
        self.estimates.append((time.monotonic(), message))


def shifted(events: list[Event], by_ns: int) -> list[Event]:
    """Shift the stamps of messages; those of an instant may share one stamp."""
    stamps = {id(message.header.stamp): message.header.stamp for _, _, message in events}
    for stamp in stamps.values():
        stamp.sec, stamp.nanosec = divmod(stamp.sec * 10**9 + stamp.nanosec + by_ns, 10**9)
    return [(topic, stamp + by_ns, message) for topic, stamp, message in events]
