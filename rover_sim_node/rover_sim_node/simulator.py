# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run the simulator as a node, which computes each step ahead of its deadline.

It publishes the step on the deadline.
"""

import gc
import sys
import threading
import time
from typing import Any

import torch
from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from msg_defs.msg import TerrainTruth
from rover_parameters.command_line import print_error, run
from rover_parameters.declare import declare
from rover_parameters.ending import destroy
from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, FOLLOW_WHEELS, SimulatorConfig
from rover_sim_node.messages import SECOND_NS, TYPES, clock_message, step_messages, truth_message
from rover_sim_node.pacing import Pace
from rover_sim_node.reading import GroundTruth, SimulatedReading
from rover_sim_node.run import SimulatedRun
from rover_sim_node.turning_run import TurningRun
from rover_sim_node.viewing import marker_message, transform_message
from terramechanics.vehicle.suspension import TerrainError

QOS = QoSProfile(depth=50)  # reliable, volatile, keep last
TF_QOS = QoSProfile(depth=100)  # as that of tf2_ros, which has no wheel
LATCHED = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
PROGRAM = "simulator"
CLOCK = "/clock"
DISCOVERY_S = 0.5
"""Time in which another publisher of the clock would be discovered."""
SLEEP_S = 0.002
"""Last part of a wait, in which the node only sleeps. (A busy wait is later on a busy machine.)"""
LATE_S = 0.2
"""Smallest lateness that is logged."""
ACKNOWLEDGE_S = 2.0
"""Longest wait at the end for subscribers that have not acknowledged the last messages."""
LOG_PERIOD_S = 5.0


class SimulatorError(RuntimeError):
    """A run that cannot start or go on; the message has the reason and a remedy."""


class SimulatorNode(Node):
    """Publish the measurements of one simulated drive."""

    def __init__(self) -> None:
        """Read the parameters and set up the drive. Raises ConfigError that names a parameter."""
        super().__init__("simulator", automatically_declare_parameters_from_overrides=True)
        self.config = declare(self, SimulatorConfig)
        try:
            kind = TurningRun if self.config.steering else SimulatedRun
            self.run: SimulatedRun | TurningRun = kind(self.config)
        except TerrainError as error:
            raise ConfigError(str(error)) from error
        self._outputs = {
            topic: self.create_publisher(kind, topic, QOS) for topic, kind in TYPES.items()
        }
        self._truth_output = self.create_publisher(TerrainTruth, "ground_truth/terrain", LATCHED)
        self._tf_output = (
            self.create_publisher(TFMessage, "/tf", TF_QOS) if self.config.publish_tf else None
        )
        self._marker_output = (
            self.create_publisher(MarkerArray, "wheel_markers", QOS)
            if self.config.publish_markers
            else None
        )
        self._clock_output: Publisher | None = None
        self._truth: GroundTruth | None = None
        self._sequence, self._truths = 0, 0
        self._start_ns = 0
        self._warned_stuck = False
        self._wheels = self.run.wheel_commands if isinstance(self.run, TurningRun) else None
        if self._wheels is not None:
            self.create_subscription(JointState, FOLLOW_WHEELS, self._take_wheels, QOS)
        elif self.run.commands is not None:
            self.create_subscription(Twist, FOLLOW, self._take_command, QOS)

    def unmatched(self) -> list[str]:
        """Return the topics that have fewer subscribers than the run waits for."""
        wanted = self.config.wait_for_subscribers
        return [
            topic
            for topic, output in self._outputs.items()
            if output.get_subscription_count() < wanted
        ]

    def own_clock(self) -> None:
        """Start to publish the clock. Raises SimulatorError where another node publishes it."""
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
        """Return the messages to publish when the step of this reading is due, in this order."""
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
        due += self._for_viewers(reading, messages)
        self._sequence += 1
        if reading.stuck and not self._warned_stuck:
            self._warned_stuck = True
            self.get_logger().warning(
                f"the rover is stuck at {reading.position:.2f} m, {reading.time:.1f} s after the"
                " start"
            )
        return due

    def _for_viewers(
        self, reading: SimulatedReading, messages: dict[str, Any]
    ) -> list[tuple[Publisher, Any]]:
        due: list[tuple[Publisher, Any]] = []
        if self._tf_output is not None:
            due.append((self._tf_output, transform_message(messages["odom"])))
        # a tenth of a step's time, which nobody is to pay who does not look
        if self._marker_output is not None and self._marker_output.get_subscription_count():
            header = messages["joint_states"].header
            due.append(
                (self._marker_output, marker_message(reading, header, self.config.track_width))
            )
        return due

    def finish(self) -> None:
        """Wait until the subscribers have acknowledged all messages."""
        optional = (self._clock_output, self._tf_output, self._marker_output)
        for output in (*self._outputs.values(), self._truth_output, *filter(None, optional)):
            output.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_S))

    def _take_command(self, message: Twist) -> None:
        linear, angular = message.linear, message.angular
        commands = self.run.commands
        if commands is None:
            return
        self._refuse(
            commands.request((linear.x, linear.y, linear.z), (angular.x, angular.y, angular.z))
        )

    def _take_wheels(self, message: JointState) -> None:
        if self._wheels is not None:
            given = (list(each) for each in (message.name, message.velocity, message.position))
            self._refuse(self._wheels.request(*given))

    def _refuse(self, why: str) -> None:
        if why:
            self.get_logger().error(
                f"velocity command refused: {why}", throttle_duration_sec=LOG_PERIOD_S
            )


class Simulator:
    """Step a node's run on the grid of its deadlines until it is over or stopped."""

    def __init__(self, node: SimulatorNode, stop: threading.Event) -> None:
        """Make an executor for the node; ``stop`` ends the run at any time."""
        self._node, self._stop = node, stop
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)

    def run(self) -> None:
        """Wait for the clock and the subscribers, then drive. Raises SimulatorError."""
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
        # the slowest step, in which torch sets itself up, comes before the first deadline
        first = self._node.run.step()
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
        """Serve callbacks, then sleep up to the deadline; return False after a stop."""
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
        0 at the end and after a signal, 1 where the run could not start or go on, 2 for wrong
        parameters.
    """
    torch.set_num_threads(1)
    return run(PROGRAM, "soil:=loose_sand", SimulatorConfig, _serve)


def _serve(stop: threading.Event) -> int:
    node, code = SimulatorNode(), 0
    try:
        Simulator(node, stop).run()
    except (SimulatorError, TerrainError) as error:
        code = print_error(PROGRAM, error, 1)
    finally:
        destroy(node, code)
    return code


if __name__ == "__main__":
    sys.exit(main())
