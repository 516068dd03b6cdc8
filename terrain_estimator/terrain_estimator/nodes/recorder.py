# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Record topics to a bag: raw subscriptions in, MCAP out.

A kill -9 loses no message that has reached the node.
"""

import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from rclpy.clock import ROSClock
from rclpy.exceptions import InvalidTopicNameException, NoTypeSupportImportedException
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.type_support import check_for_type_support
from rclpy.validate_topic_name import validate_topic_name

from rover_parameters.command_line import run
from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagError, BagTopic, BagWriter
from terrain_estimator.config.recorder import RecorderConfig
from terrain_estimator.messaging.diagnostics import DISK, FAILURES, UNRECORDED, CheckResult
from terrain_estimator.messaging.identities import Identities, TooLongError
from terrain_estimator.nodes.common.bag_qos import bag_qos
from terrain_estimator.nodes.common.bag_thread import BagThread
from terrain_estimator.nodes.common.lifecycle import ManagedNode, drain
from terrain_estimator.nodes.common.message_types import message_class
from terrain_estimator.nodes.common.publishers import type_conflicts
from terrain_estimator.topics import DIAGNOSTICS, HEALTH, OPTIONAL_TOPICS

QUEUE = 1000  # messages: minutes of a topic at 10 Hz, so a slow disk loses nothing
POLL_S = 0.1


@dataclass(slots=True)
class Source:
    """A topic that is recorded."""

    topic: BagTopic
    subscription: Subscription
    reliable: bool
    transient_local: bool
    matched: bool = False
    gone: bool = False  # unsubscribed while the node is not active


class RecorderNode(ManagedNode):
    """Subscribe to topics as their publishers appear, with the quality of service that they offer.

    The log time is the node's clock at reception: with ``use_sim_time`` simulated time, and the
    node subscribes once /clock runs, so that a player's clock agrees with the stamps. The publish
    time is that of the publisher's DDS. "Configure" opens a bag, "activate" records to it, and
    "clean up" finishes it.
    """

    config: RecorderConfig

    def __init__(self, stop: threading.Event, **options: Any) -> None:
        """Read the parameters; ``options`` are rclpy's. Raises ConfigError where one is wrong."""
        super().__init__("recorder", RecorderConfig, stop, **options)
        self._log = self.get_logger()
        self._name_topics()
        self._thread: BagThread | None = None
        self._discovery: Timer | None = None
        self._sources: dict[str, Source] = {}
        self._adding: dict[str, Future[BagTopic]] = {}
        self._identities = Identities()
        self._warnings: set[str] = set()
        self._waiting: list[str] = []
        self._refused: dict[str, str] = {}  # topics that cannot be recorded, and why
        self._reported_failures = 0
        self._log_time_ns = 0
        self.received = 0
        self.disk_failed = False

    def configure(self) -> None:
        """Open the bag."""
        self._name_topics()
        self._thread, self._log_time_ns, self.disk_failed = BagThread(self.config), 0, False
        self._sources, self._adding, self._warnings = {}, {}, set()
        self._identities = Identities()
        self._waiting, self._refused = list(self._topics), {}

    @property
    def exit_code(self) -> int:
        """1 where the disk failed, else 0."""
        return int(self.disk_failed)

    def activate(self) -> None:
        """Look for publishers at intervals, and record them."""
        self._log.info(
            f"waiting for the publishers of {len(self._waiting)} topics, bag {self._bag.bag.folder}"
        )
        self._discovery = self.create_timer(POLL_S, self.guard(self._discover), clock=self.steady)

    def deactivate(self) -> None:
        """Record what has arrived, and unsubscribe; the bag stays open."""
        if self._discovery:
            self.destroy_timer(self._discovery)
            self._discovery = None
        listening = [source for source in self._sources.values() if not source.gone]
        self.guard(drain)([source.subscription for source in listening])
        for source in listening:
            self.destroy_subscription(source.subscription)
            source.gone = True

    def cleanup(self) -> None:
        """Finish the bag; a disk that is full, broken or hangs leaves it unfinished."""
        thread, self._thread = self._bag, None
        writer = thread.bag
        try:
            thread.close(late=self._log.warning)
        except TimeoutError as error:
            self.disk_failed = True
            self._log.error(f"{error}")
        except OSError as error:
            self._fail(thread, error)
        if self.disk_failed:
            return
        if writer.compaction_error:
            self._log.warning(writer.compaction_error)
        span = writer.span
        self._log.info(
            f"recorded {span.count} messages in {span.duration_ns / 1e9:.1f} s to {writer.folder}"
        )

    def findings(self) -> Iterator[CheckResult]:
        """Return the checks of lost messages, of topics that are not recorded, and of the disk."""
        failures, self._reported_failures = self.failures - self._reported_failures, self.failures
        yield FAILURES.judge(failures, text=f"{failures} callbacks failed")
        if self._thread:
            yield DISK.judge(self._thread.late_s)
        silent = (
            [
                name
                for name in self._topics
                if name in self._missed
                and name not in self._refused
                and self._has_no_publisher(name)
            ]
            if self._discovery
            else []
        )
        words = [f"without a publisher: {', '.join(silent)}"] if silent else []
        words += [f"cannot record {name}: {why}" for name, why in self._refused.items()]
        yield UNRECORDED.judge(
            len(silent) + len(self._refused),
            text="; ".join(words) or "every topic that is recorded has a publisher",
        )

    def _has_no_publisher(self, name: str) -> bool:
        """Return whether a topic has no publisher now."""
        source = self._sources.get(name)
        return not (
            self.count_publishers(name)
            if source is None or source.gone
            else source.subscription.get_publisher_count()
        )

    @property
    def _bag(self) -> BagThread:
        if self._thread is None:
            raise BagError("the node is not configured: there is no bag")
        return self._thread

    def _fail(self, thread: BagThread, error: OSError) -> None:
        """Leave the bag as it is, and end the node, since the disk fails."""
        self.disk_failed = True
        thread.abandon()
        self._log.fatal(f"the disk fails, what was written before is kept: {error}")
        self._stop.set()

    def _resolve(self, names: str) -> list[str]:
        try:
            for name in names.split():
                validate_topic_name(name)
        except InvalidTopicNameException as error:
            raise ConfigError(f"parameter topics: {error}") from error
        resolved = dict.fromkeys(self.resolve_topic_name(name) for name in names.split())
        if not resolved:
            raise ConfigError("parameter topics: no topic is named, so there is nothing to record")
        return list(resolved)

    def _name_topics(self) -> None:
        self._topics = self._resolve(self.config.topics)
        self._missed = self._topics_to_miss()

    def _topics_to_miss(self) -> frozenset[str]:
        """Return the topics whose absence is a fault: all that a user names."""
        default = self.config.topics == RecorderConfig().topics
        optional = {self.resolve_topic_name(name) for name in OPTIONAL_TOPICS} if default else set()
        return frozenset(self._topics) - optional

    def _discover(self) -> None:
        if (
            isinstance(clock := self.get_clock(), ROSClock)
            and clock.ros_time_is_active
            and clock.now().nanoseconds == 0
        ):
            return
        for name in self._topics:
            self.guard(self._follow_topic)(name)  # an error of one topic does not stop the others

    def _follow_topic(self, name: str) -> None:
        try:
            self._follow(name, self.get_publishers_info_by_topic(name))
        except OSError as error:
            self._fail(self._bag, error)

    def _follow(self, name: str, publishers: list[TopicEndpointInfo]) -> None:
        """Subscribe to a topic that has appeared, again where its publishers offer another QoS."""
        source = self._sources.get(name)
        type_name = (
            source.topic.count.type_name
            if source
            else publishers[0].topic_type
            if publishers
            else ""
        )
        ours = [end for end in publishers if end.topic_type == type_name]
        if ours:
            reliable = all(
                end.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE for end in ours
            )
            transient_local = all(
                end.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for end in ours
            )
            if (
                source is None
                or source.gone
                or (source.reliable, source.transient_local) != (reliable, transient_local)
            ):
                source = self._subscribe(
                    name, ours, source, reliable=reliable, transient_local=transient_local
                )
        for words in (
            type_conflicts(publishers, type_name, source.topic.count.type_hash) if source else ()
        ):
            self._warn_once(f"{name}: {words}")
        if source and not source.matched and source.subscription.get_publisher_count():
            source.matched = True
            self._report_match(name, source)

    def _subscribe(
        self,
        name: str,
        publishers: list[TopicEndpointInfo],
        old: Source | None,
        *,
        reliable: bool,
        transient_local: bool,
    ) -> Source | None:
        type_name = old.topic.count.type_name if old else publishers[0].topic_type
        try:
            kind = message_class(type_name)
            check_for_type_support(kind)
            topic = old.topic if old else self._topic(name, type_name, publishers)
        except (ValueError, ImportError, AttributeError, NoTypeSupportImportedException) as error:
            self._refused[name] = str(error)
            self._warn_once(f"cannot record {name}: {error}")
            return None
        self._refused.pop(name, None)
        if topic is None:
            return None
        if old and not old.gone:
            self.guard(drain)([old.subscription])
            self.destroy_subscription(old.subscription)
            old.gone = True

        subscription = self.create_subscription(
            kind,
            name,
            cast("Any", self._recording(topic, kind)),
            _qos(reliable=reliable, transient_local=transient_local),
            raw=True,
        )
        self._sources[name] = Source(
            topic, subscription, reliable, transient_local, matched=old is not None and old.matched
        )
        return self._sources[name]

    def _recording(
        self, topic: BagTopic, kind: type[Any]
    ) -> Callable[[bytes, dict[str, int]], None]:
        """Return the callback that gives the messages of a topic to the bag's thread."""
        thread = self._bag

        def write(data: bytes, log_time_ns: int, publish_time_ns: int) -> None:
            if thread.abandoned:
                return
            try:
                thread.bag.write(topic, data, log_time_ns, publish_time_ns)
                if topic.count.type_name in {HEALTH, DIAGNOSTICS}:
                    self._note_identity(thread.bag, topic, data, kind)
            except OSError as error:
                self._fail(thread, error)

        guarded = self.guard(write)

        def record(data: bytes, info: dict[str, int]) -> None:
            self.received += 1
            thread.give(
                partial(guarded, data, self._next_log_time_ns(), info["source_timestamp"]),
                len(data),
            )

        return self.guard(record)

    def _topic(
        self, name: str, type_name: str, publishers: list[TopicEndpointInfo]
    ) -> BagTopic | None:
        """Add a topic to the bag; return None while the disk hangs, then ask again."""
        if name not in self._adding:
            qos = tuple(bag_qos(end) for end in publishers)
            self._adding[name] = self._bag.give(
                partial(self._bag.bag.add_topic, name, type_name, qos=qos)
            )
        return self._adding.pop(name).result() if self._adding[name].done() else None

    def _next_log_time_ns(self) -> int:
        """Return the time of the clock, never before that of the last message.

        Readers sort by log time, and would mix the messages before and after the step.
        """
        now_ns = self.get_clock().now().nanoseconds
        if now_ns < self._log_time_ns:
            self._warn_once(
                "the clock went back: log times stay at the last one until the clock has passed it;"
                " order and stamps are as they came"
            )
        self._log_time_ns = max(now_ns, self._log_time_ns)
        return self._log_time_ns

    def _note_identity(self, bag: BagWriter, topic: BagTopic, data: bytes, kind: type[Any]) -> None:
        """Write model, configuration and runtime of an estimator to the metadata, once in a bag."""
        name = topic.count.name
        try:
            message = deserialize_message(data, kind)
        except Exception as error:  # noqa: BLE001 - rclpy's errors have no common class
            self._warn_once(
                f"cannot read {name}, so the bag does not say which model estimated: {error}"
            )
            return
        if topic.count.type_name == DIAGNOSTICS:
            self._identities.hear(message)
            return
        try:
            identity = self._identities.new(name, message)
        except TooLongError as error:
            self._warn_once(str(error))
            return
        if identity:
            bag.add_metadata("terrain_estimator", identity, once=True)

    def _report_match(self, name: str, source: Source) -> None:
        self._waiting.remove(name)
        kind = (
            f"{'reliable' if source.reliable else 'best effort'},"
            f" {'transient local' if source.transient_local else 'volatile'}"
        )
        matched = len(self._topics) - len(self._waiting)
        self._log.info(
            f"matched {name} ({source.topic.count.type_name}, {kind}), {matched} of"
            f" {len(self._topics)}"
        )
        if name in self._missed and self._missed.isdisjoint(self._waiting):
            self._log.info(f"recording {matched} topics to {self._bag.bag.folder}")

    def _warn_once(self, text: str) -> None:
        """Log a warning once in a recording."""
        if text not in self._warnings:
            self._warnings.add(text)
            self._log.warning(text)


def _qos(*, reliable: bool, transient_local: bool) -> QoSProfile:
    return QoSProfile(
        depth=QUEUE,
        reliability=(
            QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            QoSDurabilityPolicy.TRANSIENT_LOCAL if transient_local else QoSDurabilityPolicy.VOLATILE
        ),
    )


def main() -> int:
    """Record until SIGINT or SIGTERM; return 0, 1 where the disk failed, 2 for wrong parameters."""
    return run("recorder", "output:=bags/run", RecorderConfig, _serve)


def _serve(stop: threading.Event) -> int:
    node = RecorderNode(stop)
    node.serve(auto_start=node.config.auto_start)
    return node.exit_code


if __name__ == "__main__":
    sys.exit(main())
