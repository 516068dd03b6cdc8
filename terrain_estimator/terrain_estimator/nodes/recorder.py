# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Records topics to a bag: raw subscriptions in, MCAP out. Survives kill -9 with every message that reached it."""

import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, cast

import rclpy
from rclpy.clock import Clock, ROSClock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.utilities import try_shutdown
from rclpy.validate_topic_name import validate_topic_name

from terrain_estimator.bags import BagError, BagWriter, Qos, Topic
from terrain_estimator.bags.qos import INFINITE_NS
from terrain_estimator.config import RecorderConfig
from terrain_estimator.nodes.command_line import begin
from terrain_estimator.nodes.declare import declare
from terrain_estimator.nodes.factory import message_class
from terramechanics.loading import ConfigError

QUEUE = 1000  # messages; 9 topics at 10 Hz fill it in minutes, so a slow disk costs nothing
POLL_S = 0.1
PATIENCE_S = 5.0
DRAIN_S = 1.0
BURST = 50  # callbacks taken at once while draining


@dataclass(slots=True)
class Source:
    """A topic that is recorded."""

    topic: Topic
    subscription: Subscription
    reliable: bool
    transient_local: bool
    matched: bool = False


class Recorder:
    """Subscribes to topics as their publishers appear, with the quality of service that they offer.

    Log time is the node's clock at reception: simulated time where ``use_sim_time`` is set (then it subscribes once
    /clock runs), so that a player's clock agrees with the stamps. Publish time is what the publisher's DDS reports.
    """

    def __init__(self, node: Node) -> None:
        """Declare the parameters and open the bag.

        Args:
            node: made with ``automatically_declare_parameters_from_overrides=True``.

        Raises:
            ConfigError: a parameter is unknown or wrong.
            BagError: the bag cannot be written.
        """
        self._node = node
        self._log = node.get_logger()
        config = declare(node, RecorderConfig)
        output = config.output or f"bags/{datetime.now(UTC):%Y-%m-%dT%H-%M-%SZ}"
        self._topics = self._resolve(config.topics)
        self._waiting = list(self._topics)
        self._sources: dict[str, Source] = {}
        self._complaints: set[str] = set()
        self.received = 0
        self._started_s = time.monotonic()
        self._writer = BagWriter(output, recording=True, sync_interval_s=config.fsync_interval_s)
        self._log.info(f"waiting for the publishers of {len(self._waiting)} topics, bag {self._writer.folder}")
        self._node.create_timer(POLL_S, self._look_around, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def finish(self) -> None:
        """Close the bag.

        Raises:
            OSError: the disk is full or broken; what was written before is kept.
        """
        self._writer.close()
        if self._writer.compaction_error:
            self._log.warning(self._writer.compaction_error)
        span = self._writer.span
        self._log.info(f"recorded {span.count} messages in {span.duration_ns / 1e9:.1f} s to {self._writer.folder}")

    def abandon(self) -> None:
        """Leave the bag as it is after a failure of the disk."""
        with suppress(OSError):
            self._writer.abandon()

    def _resolve(self, names: str) -> list[str]:
        try:
            for name in names.split():
                validate_topic_name(name)
        except InvalidTopicNameException as error:
            raise ConfigError(f"parameter topics: {error}") from error
        resolved = dict.fromkeys(self._node.resolve_topic_name(name) for name in names.split())
        if not resolved:
            raise ConfigError("parameter topics: no topic is named, so there is nothing to record")
        return list(resolved)

    def _look_around(self) -> None:
        clock = self._node.get_clock()
        late = time.monotonic() - self._started_s > PATIENCE_S
        if isinstance(clock, ROSClock) and clock.ros_time_is_active and clock.now().nanoseconds == 0:
            if late:
                self._complain("use_sim_time is set, but nobody publishes /clock: nothing is recorded yet")
            return
        for name in self._topics:
            self._follow(name, self._node.get_publishers_info_by_topic(name))
        if late and self._waiting:
            self._complain(f"no publisher yet, still waiting: {', '.join(self._waiting)}")

    def _follow(self, name: str, publishers: list[TopicEndpointInfo]) -> None:
        """Subscribe to a topic that has appeared, again where its publishers now offer something else; note the match."""
        source = self._sources.get(name)
        if publishers:
            reliable = all(end.qos_profile.reliability == QoSReliabilityPolicy.RELIABLE for end in publishers)
            transient_local = all(end.qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL for end in publishers)
            if source is None or (source.reliable, source.transient_local) != (reliable, transient_local):
                source = self._subscribe(name, publishers, source, reliable=reliable, transient_local=transient_local)
        if source and not source.matched and source.subscription.get_publisher_count():
            source.matched = True
            self._report_match(name, source)

    def _subscribe(
        self, name: str, publishers: list[TopicEndpointInfo], old: Source | None, *, reliable: bool, transient_local: bool
    ) -> Source | None:
        type_name = old.topic.count.type_name if old else publishers[0].topic_type
        try:
            kind = message_class(type_name)
            topic = old.topic if old else self._writer.add_topic(name, type_name, qos=tuple(_offered(end) for end in publishers))
        except (BagError, ImportError, AttributeError) as error:
            self._complain(f"cannot record {name}: {error}")
            return None
        if any(end.topic_type != topic.count.type_name for end in publishers):
            self._complain(f"{name} has publishers of several types, only {topic.count.type_name} is recorded")
        qos = QoSProfile(
            depth=QUEUE,
            reliability=QoSReliabilityPolicy.RELIABLE if reliable else QoSReliabilityPolicy.BEST_EFFORT,
            durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if transient_local else QoSDurabilityPolicy.VOLATILE,
        )
        if old:
            self._node.destroy_subscription(old.subscription)

        def record(data: bytes, info: dict[str, int]) -> None:
            self.received += 1
            self._writer.write(topic, data, self._node.get_clock().now().nanoseconds, info["source_timestamp"])

        subscription = self._node.create_subscription(kind, name, cast("Any", record), qos, raw=True)
        self._sources[name] = Source(topic, subscription, reliable, transient_local, matched=old is not None and old.matched)
        return self._sources[name]

    def _report_match(self, name: str, source: Source) -> None:
        self._waiting.remove(name)
        kind = f"{'reliable' if source.reliable else 'best effort'}, {'transient local' if source.transient_local else 'volatile'}"
        total = len(self._topics)
        self._log.info(f"matched {name} ({source.topic.count.type_name}, {kind}), {total - len(self._waiting)} of {total}")
        if not self._waiting:
            self._log.info(f"recording {total} topics to {self._writer.folder}")

    def _complain(self, text: str) -> None:
        """Warn once."""
        if text not in self._complaints:
            self._complaints.add(text)
            self._log.warning(text)


def main() -> int:
    """Record until SIGINT or SIGTERM.

    Returns:
        0 after a signal or ``--help``, 1 where the disk fails, 2 where arguments, parameters or the folder are wrong.
    """
    try:
        stop = begin("recorder", "output:=bags/run", RecorderConfig)
    except ConfigError as error:
        return _refuse(str(error))
    try:
        return _run(stop)
    finally:
        try_shutdown()


def _run(stop: threading.Event) -> int:
    node = rclpy.create_node("recorder", automatically_declare_parameters_from_overrides=True)
    try:
        recorder = Recorder(node)
    except (ConfigError, BagError) as error:
        return _refuse(str(error))
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not stop.is_set():
            executor.spin_once(timeout_sec=POLL_S)
        _drain(executor, recorder)
        recorder.finish()
    except OSError as error:
        recorder.abandon()
        node.get_logger().fatal(f"the disk fails, what was written before is kept: {error}")
        return 1
    finally:
        node.destroy_node()
    return 0


def _refuse(text: str) -> int:
    print(f"recorder: {text}", file=sys.stderr)  # noqa: T201 - the user typed it, the user reads it
    return 2


def _drain(executor: SingleThreadedExecutor, recorder: Recorder) -> None:
    """Take what waits in the queues when the signal comes."""
    deadline = time.monotonic() + DRAIN_S
    before = -1
    while recorder.received != before and time.monotonic() < deadline:
        before = recorder.received
        for _ in range(BURST):
            executor.spin_once(timeout_sec=0)


def _offered(publisher: TopicEndpointInfo) -> Qos:
    profile = publisher.qos_profile
    return Qos(
        history=profile.history.short_key,
        depth=profile.depth,
        reliability=profile.reliability.short_key,
        durability=profile.durability.short_key,
        deadline_ns=_duration_ns(profile.deadline.nanoseconds),
        lifespan_ns=_duration_ns(profile.lifespan.nanoseconds),
        liveliness=profile.liveliness.short_key,
        liveliness_lease_ns=_duration_ns(profile.liveliness_lease_duration.nanoseconds),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def _duration_ns(nanoseconds: int) -> int:
    """Give "not set" as infinite, which is what DDS does with it."""
    return nanoseconds or INFINITE_NS


if __name__ == "__main__":
    sys.exit(main())
