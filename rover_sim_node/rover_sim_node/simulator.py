# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator as a node: wiring only. A run is stepped ahead of its deadlines and published on them."""

import gc
import signal
import sys
import threading
import time
from typing import Any

import rclpy
import torch
from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock

from msg_defs.msg import TerrainTruth
from rover_parameters.declare import declare
from rover_parameters.files import DUMP
from rover_parameters.parameters import usage
from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.messages import SECOND_NS, TYPES, clock_message, step_messages, truth_message
from rover_sim_node.pacing import Pace
from rover_sim_node.run import GroundTruth, SimulatedReading, SimulatedRun
from terramechanics.vehicle.suspension import TerrainError

QOS = QoSProfile(depth=50)  # reliable, volatile, keep last
LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
CLOCK = "/clock"
DISCOVERY_S = 0.5
"""Time for which another owner of the clock is looked for."""
SLEEP_S = 0.002
"""Last part of a wait, in which nothing but sleeping happens. (Watching the clock instead makes a busy machine later.)"""
LATE_S = 0.2
"""Lateness that is worth a warning."""
ACKNOWLEDGE_S = 2.0
"""Time that readers get at the end to take what is still on its way."""
LOG_PERIOD_S = 5.0


class SimulatorError(RuntimeError):
    """The run cannot start or go on; the message says why and what to do."""


class SimulatorNode(Node):
    """Publishes the measurements of one simulated drive."""

    def __init__(self) -> None:
        """Read the parameters and set up the drive. Raises ConfigError that names a parameter."""
        super().__init__("simulator", automatically_declare_parameters_from_overrides=True)
        self.config = declare(self, SimulatorConfig)
        self.run = SimulatedRun(self.config)
        self._outputs = {
            topic: self.create_publisher(kind, topic, QOS) for topic, kind in TYPES.items()
        }
        self._truth_output = self.create_publisher(TerrainTruth, "ground_truth/terrain", LATCHED)
        self._clock_output: Publisher | None = None
        self._truth: GroundTruth | None = None
        self._sequence, self._truths = 0, 0
        self._start_ns = 0
        self._warned_stuck = False
        if self.run.commands is not None:
            self.create_subscription(Twist, "cmd_vel", self._take_command, QOS)

    def unmatched(self) -> list[str]:
        """Topics that have fewer subscribers than the run has to wait for."""
        wanted = self.config.wait_for_subscribers
        return [
            topic
            for topic, output in self._outputs.items()
            if output.get_subscription_count() < wanted
        ]

    def own_clock(self) -> None:
        """Start to publish the clock. Raises SimulatorError where somebody else does."""
        self.check_clock(0)
        self._clock_output = self.create_publisher(Clock, CLOCK, QOS)

    def check_clock(self, expected: int) -> None:
        """Raise SimulatorError where the clock has more publishers than ``expected``."""
        if self.count_publishers(CLOCK) > expected:
            found = {
                f"{info.node_namespace.rstrip('/')}/{info.node_name}"
                for info in self.get_publishers_info_by_topic(CLOCK)
            }
            # A publisher can be discovered before the node that it belongs to.
            names = sorted(
                "a node not yet known by name" if "UNKNOWN" in name else name for name in found
            )
            raise SimulatorError(
                f"{CLOCK} has more than one owner: {', '.join(names)}. Stop the other, or simulate"
                " in real time without it."
            )

    def begin(self) -> None:
        """Fix the stamp of the start: the epoch where the clock is simulated, else the present."""
        self._start_ns = (
            round(self.config.epoch * SECOND_NS)
            if self.config.owns_clock
            else self.get_clock().now().nanoseconds
        )
        if self._clock_output is not None:
            self._clock_output.publish(clock_message(self._start_ns))

    def compose(self, reading: SimulatedReading) -> list[tuple[Publisher, Any]]:
        """What is to be published when the step of this reading is due, in this order."""
        stamp_ns = self._start_ns + round(reading.time * SECOND_NS)
        due: list[tuple[Publisher, Any]] = (
            [(self._clock_output, clock_message(stamp_ns))]
            if self._clock_output is not None
            else []
        )
        if self._truth is None or (reading.truth.constants, reading.truth.strength) != (
            self._truth.constants,
            self._truth.strength,
        ):
            due.append(
                (
                    self._truth_output,
                    truth_message(reading.truth, self.config, stamp_ns, self._truths),
                )
            )
            self._truth, self._truths = reading.truth, self._truths + 1
        messages = step_messages(reading, self.config, stamp_ns, self._sequence)
        due += [(self._outputs[topic], message) for topic, message in messages.items()]
        self._sequence += 1
        if reading.stuck and not self._warned_stuck:
            self._warned_stuck = True
            self.get_logger().warning(
                f"the rover is stuck at {reading.position:.2f} m, {reading.time:.1f} s after the"
                " start"
            )
        return due

    def finish(self) -> None:
        """Let the readers take what was published."""
        for output in (*self._outputs.values(), self._truth_output):
            output.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_S))

    def _take_command(self, message: Twist) -> None:
        linear, angular = message.linear, message.angular
        commands = self.run.commands
        if commands is None:
            return
        refusal = commands.request(
            (linear.x, linear.y, linear.z), (angular.x, angular.y, angular.z)
        )
        if refusal:
            self.get_logger().error(
                f"velocity command refused: {refusal}", throttle_duration_sec=LOG_PERIOD_S
            )


class Simulator:
    """Steps a node's run on the grid of its deadlines until it is over or told to stop."""

    def __init__(self, node: SimulatorNode, stop: threading.Event) -> None:
        """``stop`` ends everything, at any time."""
        self._node, self._stop = node, stop
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)

    def run(self) -> None:
        """Wait for the clock and the subscribers, drive, and let the readers finish. Raises SimulatorError."""
        config = self._node.config
        if config.owns_clock:
            self._spin_until(time.monotonic() + DISCOVERY_S)
            self._node.own_clock()
        self._wait_for_subscribers()
        effect = f", effect {config.effect} of size {config.effect_size:g}" if config.effect else ""
        self._node.get_logger().info(
            f"driving {config.schedule} on {config.soil} with {config.rover}{effect}"
        )
        gc.collect()
        gc.freeze()  # a full collection over torch's modules would make a step late
        self._drive()
        self._node.finish()

    def _drive(self) -> None:
        config = self._node.config
        first = (
            self._node.run.step()
        )  # the slowest step, since torch sets itself up: before there is a deadline
        self._node.begin()
        pace = Pace(1.0 / config.rate / config.real_time_factor)
        due = self._node.compose(first)
        while self._wait(pace):
            for output, message in due:
                output.publish(message)
            pace.advance()
            if pace.done == config.steps:
                return
            due = self._node.compose(self._node.run.step())
            if pace.remaining_s() < -LATE_S:
                self._node.get_logger().warning(
                    f"late by {-pace.remaining_s():.1f} s: lower real_time_factor",
                    throttle_duration_sec=LOG_PERIOD_S,
                )
            if config.owns_clock and pace.done % round(config.rate) == 0:
                self._node.check_clock(1)

    def _wait(self, pace: Pace) -> bool:
        """Serve callbacks until shortly before the deadline, then sleep up to it. Returns False when told to stop."""
        self._executor.spin_once(timeout_sec=0.0)
        while not self._stop.is_set() and (left := pace.remaining_s() - SLEEP_S) > 0.0:
            self._executor.spin_once(timeout_sec=left)
        time.sleep(max(pace.remaining_s(), 0.0))
        return not self._stop.is_set()

    def _wait_for_subscribers(self) -> None:
        deadline = time.monotonic() + self._node.config.wait_timeout
        while not self._stop.is_set() and (missing := self._node.unmatched()):
            if time.monotonic() > deadline:
                wanted = self._node.config.wait_for_subscribers
                raise SimulatorError(
                    f"after {self._node.config.wait_timeout:g} s {', '.join(missing)} had fewer"
                    f" than {wanted} subscribers: start those nodes in the same namespace and"
                    " ROS_DOMAIN_ID, or leave wait_for_subscribers out"
                )
            self._executor.spin_once(timeout_sec=0.02)

    def _spin_until(self, deadline: float) -> None:
        while not self._stop.is_set() and (left := deadline - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)


def main() -> int:
    """Simulate until the drive is over, SIGINT or SIGTERM.

    Returns:
        0 at the end of the drive, after a signal and after ``--help``, 1 where the run could not start or go on, 2 for wrong parameters.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    torch.set_num_threads(1)
    try:
        others = remove_ros_args(sys.argv)[1:]
        if {"-h", "--help"} & set(others):
            print(usage("simulator", "soil:=regolith", SimulatorConfig))  # noqa: T201 - the user asked for it
            return 0
        if unknown := [word for word in others if word != DUMP]:
            return _refuse(
                f"unknown argument {unknown[0]!r}; parameters are given as --ros-args -p"
                " soil:=loose_sand; --help lists them",
                2,
            )
        # With rclpy's own handlers the context would end at the signal, and the readers would lose
        # what is on its way.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # noqa: BLE001 - rclpy's errors have no common class; a damaged parameter file ends here
        return _refuse(str(error), 2)
    try:
        return _run(stop)
    finally:
        rclpy.try_shutdown()


def _run(stop: threading.Event) -> int:
    try:
        node = SimulatorNode()
    except (ConfigError, TerrainError) as error:
        return _refuse(str(error), 2)
    try:
        Simulator(node, stop).run()
    except (SimulatorError, TerrainError) as error:
        return _refuse(str(error), 1)
    finally:
        node.destroy_node()
    return 0


def _refuse(text: str, code: int) -> int:
    print(f"simulator: {text}", file=sys.stderr)  # noqa: T201 - the user typed it, the user reads it
    return code


if __name__ == "__main__":
    sys.exit(main())
