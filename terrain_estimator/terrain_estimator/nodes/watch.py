# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Watch a running estimator: a line a second on stdout, and at the end the rates of all topics."""

import json
import math
import sys
import time
from array import array
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import QoSSubscriptionMatchedInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from rover_parameters.command_line import run
from rover_parameters.records import ConfigError
from terrain_estimator.config.watch import WatchConfig
from terrain_estimator.console.times import clock, duration
from terrain_estimator.files.atomic import OutputError
from terrain_estimator.files.results import check_new, write_new
from terrain_estimator.messaging.arrival_rates import timing
from terrain_estimator.messaging.messages import Status
from terrain_estimator.nodes.common.declare import declare
from terrain_estimator.nodes.common.inactivity import InactivityMonitor
from terrain_estimator.nodes.common.message_types import message_class
from terrain_estimator.nodes.common.running import guarded, serve
from terrain_estimator.topics import (
    ADVICE,
    HEALTH,
    INPUT_TYPES,
    LISTENED,
    OUTPUT_TYPES,
    Message,
    stamp_ns,
)

TOPICS = {**INPUT_TYPES, **OUTPUT_TYPES, "estimator_health": HEALTH}
SHOWN = ("wheel_slip", "wheel_sinkage", "terrain_estimate")
TRUTH = "ground_truth/terrain"
TRACTION = "traction_advice"
SILENT_S = 2.5
"""[s] Age from which the planner's speed limit is not current."""
QOS = QoSProfile(depth=1000)


class Watch(Node):
    """Keep the last messages that it shows, and all arrival times by the receiving DDS's clock."""

    def __init__(self, **options: Any) -> None:
        """Read the parameters and subscribe; ``options`` are rclpy's.

        Raises:
            ConfigError: a parameter is unknown or wrong.
        """
        super().__init__("watch", automatically_declare_parameters_from_overrides=True, **options)
        self._config = declare(self, WatchConfig)
        # the report is written at the end, which may be in weeks
        if not Path(self._config.report).parent.is_dir():
            raise ConfigError(
                f"parameter report: {self._config.report}: there is no such folder, make it first"
            )
        try:
            if self._config.report:
                check_new(Path(self._config.report))
        except OutputError as error:
            raise ConfigError(f"parameter report: {error}") from error
        # without a report nothing grows
        self.arrivals_ns = {topic: array("q") for topic in TOPICS if self._config.report}
        self._last: dict[str, Message] = {}
        self._matched: set[str] = set()
        self._shown: Message = None
        self._inactivity = InactivityMonitor(self, LISTENED, QOS)
        for topic in TOPICS:
            self._subscribe(topic)
        latched = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        truth = message_class("msg_defs/msg/TerrainTruth")
        self.create_subscription(
            truth,
            TRUTH,
            guarded(self, lambda message: self._last.update({TRUTH: message})),
            latched,
        )
        self._advised_s = -math.inf
        self.create_subscription(
            message_class(ADVICE), TRACTION, guarded(self, self._take_advice), QOS
        )
        self.create_timer(
            self._config.period_s,
            guarded(self, self._show),
            clock=Clock(clock_type=ClockType.STEADY_TIME),
        )
        self._print("ready")

    def destroy_node(self) -> None:
        """Write the report first."""
        if self._config.report:
            try:
                self._write_report(Path(self._config.report))
            except OutputError as error:
                text = f"the report is lost: {error}"
                self.get_logger().error(text)
        super().destroy_node()

    def _write_report(self, path: Path) -> None:
        factor = self._config.real_time_factor
        # The health is published by the wall clock, everything else by the stamps.
        results = {
            topic: timing(arrivals, 1.0 if TOPICS[topic] == HEALTH else factor)
            for topic, arrivals in self.arrivals_ns.items()
        }
        content = {
            "messages": {topic: result.messages for topic, result in results.items()},
            "rate_hz": {
                topic: result.rate_hz
                for topic, result in results.items()
                if math.isfinite(result.rate_hz)
            },
            "jitter_ms_p99": {
                topic: result.jitter_ms_p99
                for topic, result in results.items()
                if math.isfinite(result.jitter_ms_p99)
            },
        }
        write_new(path, json.dumps(content, indent=2) + "\n")

    def _subscribe(self, topic: str) -> None:
        """Subscribe; messages that are not shown stay serialised, to use little processor time."""

        def receive(message: Message, info: dict[str, int]) -> None:
            self._inactivity.received(topic)
            if topic in self.arrivals_ns:
                self.arrivals_ns[topic].append(info["received_timestamp"])
            if topic in SHOWN:
                self._last[topic] = message

        def match(info: QoSSubscriptionMatchedInfo) -> None:
            if info.current_count_change > 0 and topic not in self._matched:
                self._matched.add(topic)
                if self._matched == set(TOPICS):
                    self._print("matched all topics")

        events = SubscriptionEventCallbacks(matched=match)
        kind = message_class(TOPICS[topic])
        self.create_subscription(
            kind, topic, guarded(self, receive), QOS, event_callbacks=events, raw=topic not in SHOWN
        )

    def _take_advice(self, message: Message) -> None:
        """Keep the advice; print at once that a stop is recommended, or withdrawn."""
        stopped = TRACTION in self._last and self._last[TRACTION].stop
        self._last[TRACTION], self._advised_s = message, time.monotonic()
        if message.stop and not stopped:
            resume = self.resolve_service_name("planner/resume")
            self._print(
                f"STOP: {message.status_text}. It holds until an operator withdraws it:"
                f" ros2 service call {resume} std_srvs/srv/Trigger"
            )
        elif stopped and not message.stop:
            self._print("the stop is withdrawn")

    def _show(self) -> None:
        """Print a line where a new estimate has arrived."""
        if (
            all(topic in self._last for topic in SHOWN)
            and self._last["terrain_estimate"] is not self._shown
        ):
            self._shown = self._last["terrain_estimate"]
            silent_s = time.monotonic() - self._advised_s
            self._print(f"{live_line(self._last)}{advised(self._last.get(TRACTION), silent_s)}")

    def _print(self, text: str) -> None:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()


_STATUS = {each.value: each.name.lower().replace("_", " ") for each in Status}


def live_line(last: dict[str, Message]) -> str:
    """Format time, the parameters with 95 % intervals and truth, status, mean slip and sinkage.

    The parameters are left out where the model does not fit: they are the prior's then.
    """
    estimate = last["terrain_estimate"]
    slip, sinkage = (
        _mean(last[topic], name)
        for topic, name in (("wheel_slip", "slip"), ("wheel_sinkage", "sinkage"))
    )
    disagrees = estimate.status == Status.DISAGREES
    parts = [
        clock(stamp_ns(estimate) * 1e-9),
        *(["DISAGREES: the model does not fit"] if disagrees else _strength(last)),
        f"slip {slip:5.2f}",
        f"sinkage {sinkage * 1e3:5.1f} mm",
        f"{estimate.seconds_taken} of {estimate.seconds_judged} s taken",
        estimate.decision.outcome_name.lower(),
    ]
    return " | ".join(parts)


def _strength(last: dict[str, Message]) -> list[str]:
    """Format c and tan phi with their intervals, the truth where it is known, effects, status."""
    estimate, truth = last["terrain_estimate"], last.get(TRUTH)
    cohesion = (estimate.cohesion, estimate.cohesion_lower_95, estimate.cohesion_upper_95)
    tan_phi = (estimate.tan_phi, estimate.tan_phi_lower_95, estimate.tan_phi_upper_95)
    effects = zip(
        estimate.effect, estimate.effect_value, estimate.effect_stddev, estimate.effect_unit,
        strict=False,
    )  # fmt: skip
    return [
        (
            f"c {_interval(cohesion, 1e-3, '.2f')}"
            f" kPa{'' if truth is None else f', truth {truth.cohesion * 1e-3:.2f}'}"
        ),
        (
            f"tan phi {_interval(tan_phi, 1.0, '.3f')}"
            f"{'' if truth is None else f', truth {truth.tan_phi:.3f}'}"
        ),
        *(
            f"{name} {value:.3g} +- {sd:.2g}" + ("" if unit in {"", "1"} else f" {unit}")
            for name, value, sd, unit in effects
        ),
        _STATUS.get(estimate.status, "unknown status"),
    ]


def advised(advice: Message, silent_s: float) -> str:
    """Format the planner's advice of ``silent_s`` ago as the end of a line; empty without any.

    An old speed limit no longer applies. A stop holds until it is withdrawn.
    """
    if advice is None:
        return ""
    old = f"no advice for {duration(silent_s)}" if silent_s > SILENT_S else ""
    if advice.stop:
        return f" | STOP: {advice.status_text}{old and f' ({old})'}"
    if old:
        return f" | planner: {old}"
    known = advice.known and math.isfinite(advice.speed_limit)
    return f" | at most {advice.speed_limit:.3g} m/s" if known else " | no speed limit yet"


def _interval(values: tuple[float, float, float], scale: float, form: str) -> str:
    mean, lower, upper = (format(value * scale, form) for value in values)
    return f"{mean} ({lower} to {upper})"


def _mean(message: Message, name: str) -> float:
    values = np.asarray(getattr(message, name), dtype=np.float64)
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else math.nan


def main() -> int:
    """Watch until SIGINT or SIGTERM; return 0, or 2 for wrong parameters."""
    return run("watch", "period:=2.0", WatchConfig, lambda stop: serve(Watch(), stop))


if __name__ == "__main__":
    sys.exit(main())
