# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Three rovers on real DDS, each with simulator and estimator, monitored from this process."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import rclpy
from domain_coordinator import domain_id as reserve_domain_id
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

from terrain_estimator.nodes.common import message_types
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import ESTIMATE, HEALTH, Message
from terramechanics.simulation.sample import TIME_STEP
from tests.system.processes import Process, Starter

FACTOR = 4.0
"""[1] Times real time."""
START_S = 120.0
DEEP = QoSProfile(depth=1000)
SAMPLES, SHORTEST_S = 360, 0.5
UNUSUAL = frozenset(outcome.name for outcome in Outcome if not outcome.used) - {
    "STANDSTILL",
    "GATED",
}
"""Outcomes that these drives do not explain."""


@dataclass(slots=True)
class RoverSeries:
    """One rover over time; all lists are equally long."""

    rover: str
    estimates: int = 0  # in all, one for each time step
    seconds: list[float] = field(default_factory=list)  # of wall time
    estimator_mb: list[float] = field(default_factory=list)
    simulator_mb: list[float] = field(default_factory=list)
    rate_hz: list[float] = field(default_factory=list)  # of estimates, since the sample before
    latency_ms: list[float] = field(default_factory=list)  # median of the last second
    counters: dict[str, list[float]] = field(default_factory=dict)  # that should not grow

    @property
    def hours(self) -> float:
        """Simulated hours that were driven and estimated."""
        return self.estimates * TIME_STEP / 3600.0


class MonitoredRover:
    """Monitor of one rover."""

    def __init__(self, name: str, watch: Node, estimator: Process, simulator: Process) -> None:
        """Subscribe to its estimates and its health."""
        self.series = RoverSeries(name)
        self._processes = [psutil.Process(each.pid) for each in (estimator, simulator)]
        self._estimates, self._last_s = 0, time.monotonic()
        self.health: Message | None = None
        watch.create_subscription(
            message_types.message_class(ESTIMATE),
            f"/{name}/terrain_estimate",
            self._count,
            DEEP,
            raw=True,
        )
        watch.create_subscription(
            message_types.message_class(HEALTH), f"/{name}/estimator_health", self._keep, DEEP
        )

    def sample(self, seconds: float) -> None:
        """Append to all series."""
        series, now_s = self.series, time.monotonic()
        rate_hz = self._estimates / (now_s - self._last_s)
        self._estimates, self._last_s = 0, now_s
        if self.health is None:
            return
        memories = [process.memory_info().rss / 1e6 for process in self._processes]
        series.seconds.append(seconds)
        series.estimator_mb.append(memories[0])
        series.simulator_mb.append(memories[1])
        series.rate_hz.append(rate_hz)
        series.latency_ms.append(1e3 * self.health.update_latency_median)
        for name, value in counters(self.health).items():
            series.counters.setdefault(name, []).append(value)

    def _count(self, _: bytes) -> None:
        self._estimates += 1
        self.series.estimates += 1

    def _keep(self, message: Message) -> None:
        self.health = message


def counters(health: Message) -> dict[str, float]:
    """Return counters that must not grow: lost and late messages, resets, unusual outcomes."""
    found = {
        name: float(sum(getattr(health, f"input_{name}")))
        for name in ("lost", "out_of_order", "unpaired")
    }
    unusual = sum(
        count
        for name, count in zip(health.outcome, health.outcome_count, strict=True)
        if name in UNUSUAL
    )
    return {**found, "resets": float(health.resets), "unusual outcomes": float(unusual)}


def drive(
    rovers: int, hours: float, seconds: float, folder: Path, say: Callable[[str], None]
) -> list[RoverSeries]:
    """Drive until every rover has its ``hours``, or the ``seconds`` of wall time are over.

    Raises AssertionError where a process ends earlier.
    """
    with reserve_domain_id() as domain_id, Starter(folder, domain_id) as start:
        context = Context()
        rclpy.init(context=context, domain_id=domain_id)
        watch, executor = (
            rclpy.create_node("soak", context=context),
            SingleThreadedExecutor(context=context),
        )
        executor.add_node(watch)
        try:
            watched = [
                _rover(f"rover{number}", number, watch, start) for number in range(1, rovers + 1)
            ]
            begun_s, taken, next_s = time.monotonic(), 0, 0.0
            while (past_s := time.monotonic() - begun_s) < seconds and min(
                rover.series.hours for rover in watched
            ) < hours:
                executor.spin_once(timeout_sec=0.1)
                if past_s >= next_s:
                    taken, next_s = taken + 1, past_s + max(SHORTEST_S, seconds / SAMPLES)
                    for rover in watched:
                        rover.sample(past_s)
                    if taken % 30 == 0:
                        rates = ", ".join(
                            f"{rover.series.rate_hz[-1]:.1f}"
                            for rover in watched
                            if rover.series.rate_hz
                        )
                        say(f"DDS: {past_s / 60.0:.1f} min, {rates} estimates/s")
            return [rover.series for rover in watched]
        finally:
            executor.shutdown()
            watch.destroy_node()
            context.try_shutdown()


def _rover(name: str, seed: int, watch: Node, start: Starter) -> MonitoredRover:
    """Give each simulator its own clock topic, as the clocks differ."""
    apart = ("-r", f"__ns:=/{name}", "-r", f"/clock:=/{name}/clock")
    estimator = start("terrain_estimator", "estimator", "--ros-args", *apart)
    estimator.wait_for_output("ready", START_S)
    given = {
        "seed": seed,
        "real_time_factor": FACTOR,
        "wait_for_subscribers": 1,
        "wait_timeout": START_S,
    }
    parameters = [word for key, value in given.items() for word in ("-p", f"{key}:={value}")]
    simulator = start("rover_sim_node", "simulator", "--ros-args", *apart, *parameters)
    simulator.wait_for_output("driving", START_S)
    return MonitoredRover(name, watch, estimator, simulator)
