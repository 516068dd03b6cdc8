# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator as a process of its own, on real DDS."""

import math
import re
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Twist, Vector3
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState

from msg_defs.msg import TerrainTruth, WheelSinkage, WheelSlip
from tests.system.listening import LATCHED, Listener
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until

TOPICS = {
    "wheel_slip": WheelSlip,
    "wheel_sinkage": WheelSinkage,
    "odom": Odometry,
    "joint_states": JointState,
    "imu": Imu,
}
FAST = ("real_time_factor:=20.0",)
EXAMPLES = Path(__file__).parents[2] / "docs/examples"


def simulator(start: Starter, *parameters: str) -> Process:
    arguments = [word for parameter in parameters for word in ("-p", parameter)]
    return start("rover_sim_node", "simulator", "--ros-args", *arguments)


def collect(listener: Listener) -> dict[str, list[Any]]:
    return {topic: listener.collect(kind, topic) for topic, kind in TOPICS.items()}


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def finish(listener: Listener, process: Process, heard: dict[str, list[Any]], steps: int) -> int:
    """Listen until every topic has so many messages and the process has ended; its exit code."""
    for messages in heard.values():
        listener.wait_for_messages(messages, steps)
    listener.spin_until(
        lambda: not process.running, "the simulator ends", seen=lambda: process.output
    )
    return process.wait()


def test_it_waits_for_its_subscribers_publishes_every_step_on_every_topic_and_ends_by_itself(
    start: Starter, listener: Listener
) -> None:
    process = simulator(start, "wait_for_subscribers:=1", "duration:=5.0", "epoch:=100.0", *FAST)
    # the clock first: the simulator waits for the five topics alone, and knows its reader by then
    clock, heard = listener.collect(Clock, "/clock"), collect(listener)
    assert finish(listener, process, heard, 50) == 0
    listener.spin_until(
        lambda: clock and clock[-1].clock.sec == 105, "the last tick comes", seen=lambda: clock
    )
    expected = [100_000_000_000 + step * 100_000_000 for step in range(1, 51)]
    for topic, messages in heard.items():
        assert [stamp_ns(message) for message in messages] == expected, topic
    assert [message.sequence for message in heard["wheel_slip"]] == list(range(50))
    ticks = [message.clock.sec * 1_000_000_000 + message.clock.nanosec for message in clock]
    assert ticks[-40:] == expected[-40:]
    assert ticks == sorted(ticks)


def test_the_same_seed_gives_the_same_run(start: Starter, listener: Listener) -> None:
    runs = []
    for _ in range(2):
        heard = collect(listener)
        process = simulator(start, "wait_for_subscribers:=1", "duration:=2.0", "seed:=7", *FAST)
        assert finish(listener, process, heard, 20) == 0
        runs.append(
            {topic: [str(message) for message in messages] for topic, messages in heard.items()}
        )
        for subscription in list(listener.node.subscriptions):
            listener.node.destroy_subscription(subscription)
    assert all(len(messages) == 20 for messages in runs[0].values())
    assert runs[0] == runs[1]


def test_in_real_time_it_keeps_10_hz_without_drift_and_stamps_with_the_present(
    start: Starter, listener: Listener
) -> None:
    process = simulator(start, "wait_for_subscribers:=1")
    slips = collect(listener)["wheel_slip"]
    arrivals: list[int] = []
    listener.node.create_subscription(
        WheelSlip, "wheel_slip", lambda _: arrivals.append(time.monotonic_ns()), 50
    )
    listener.wait_for_messages(slips, 41)
    listener.wait_for_messages(arrivals, 41)
    stamps = np.array([stamp_ns(message) for message in slips])
    assert set(np.diff(stamps)) == {100_000_000}
    assert abs(stamps[-1] - time.time_ns()) < 1_000_000_000
    # A busy machine delays messages, but hardly ten in a row: the least late ones tell the pace.
    late = np.array(arrivals) * 1e-9 - 0.1 * np.arange(len(arrivals))
    assert abs(float(late[-10:].min() - late[:10].min())) < 0.05
    assert process.terminate() == 0


def test_a_real_time_factor_below_one_stretches_the_wall_time(
    start: Starter, listener: Listener
) -> None:
    arrivals: list[float] = []
    listener.node.create_subscription(
        WheelSlip, "wheel_slip", lambda _: arrivals.append(time.monotonic()), 50
    )
    heard = {**collect(listener), "arrivals": arrivals}
    process = simulator(start, "wait_for_subscribers:=1", "duration:=0.5", "real_time_factor:=0.2")
    assert finish(listener, process, heard, 5) == 0
    # Five times 0.4 s, less what a busy machine keeps the first message back; twice is more than a
    # factor without effect would take.
    assert arrivals[-1] - arrivals[0] > 0.8


def test_it_follows_velocity_commands_stops_when_they_stop_and_refuses_to_turn(
    start: Starter, listener: Listener
) -> None:
    process = simulator(start, "schedule:=cmd_vel", "noise:=0.0", "real_time_factor:=5.0")
    heard = collect(listener)
    odometry = heard["odom"]
    publisher = listener.publisher(Twist, "cmd_vel")
    for messages in (heard["wheel_slip"], odometry):
        listener.wait_for_messages(messages, 3)
    assert all(math.isnan(slip) for slip in heard["wheel_slip"][-1].slip)
    assert odometry[-1].twist.twist.linear.x == 0.0

    def commanded(x: float, yaw: float = 0.0) -> None:
        publisher.publish(Twist(linear=Vector3(x=x), angular=Vector3(z=yaw)))

    def fast() -> bool:
        commanded(0.15)
        return bool(odometry[-1].twist.twist.linear.x > 0.08)

    listener.spin_until(fast, "the rover drives", seen=lambda: odometry[-1].twist.twist.linear.x)
    assert all(math.isfinite(slip) for slip in heard["wheel_slip"][-1].slip)
    commanded(0.15, yaw=0.3)
    listener.spin_until(
        lambda: "set steering for one that turns" in process.output,
        "the turn is refused with its reason",
        seen=lambda: process.output,
    )
    listener.spin_until(
        lambda: odometry[-1].twist.twist.linear.x == 0.0,
        "the rover stops",
        seen=lambda: odometry[-1].twist.twist.linear.x,
    )
    assert process.interrupt() == 0


def test_it_follows_commands_wheel_by_wheel_and_refuses_a_wheel_it_does_not_have(
    start: Starter, listener: Listener
) -> None:
    given = ("rover:=four_wheel_rover", "steering:=skid", "schedule:=wheel_commands", "noise:=0.0")
    process = simulator(start, *given, "real_time_factor:=5.0")
    odometry = collect(listener)["odom"]
    publisher = listener.publisher(JointState, "wheel_commands")
    listener.wait_for_messages(odometry, 3)
    rates = {"front_left": -1.0, "front_right": 1.5, "rear_left": -1.0, "rear_right": 1.5}

    def turns() -> bool:
        publisher.publish(JointState(name=list(rates), velocity=list(rates.values())))
        return bool(odometry[-1].twist.twist.angular.z > 0.1)

    listener.spin_until(turns, "the rover turns", seen=lambda: odometry[-1].twist.twist.angular.z)
    publisher.publish(JointState(name=["middle_left"], velocity=[1.0]))
    listener.spin_until(
        lambda: "middle_left is no joint to command" in process.output,
        "the command is refused with its reason",
        seen=lambda: process.output,
    )
    assert process.interrupt() == 0


def test_with_steering_it_turns_as_commanded_and_says_so(
    start: Starter, listener: Listener
) -> None:
    given = ("rover:=four_wheel_rover", "steering:=skid", "schedule:=cmd_vel", "noise:=0.0")
    process = simulator(start, *given, "real_time_factor:=3.0")
    heard = collect(listener)
    odometry = heard["odom"]
    publisher = listener.publisher(Twist, "cmd_vel")
    listener.wait_for_messages(odometry, 3)
    assert odometry[-1].twist.twist.angular.z == 0.0

    def turned() -> bool:
        publisher.publish(Twist(linear=Vector3(x=0.2), angular=Vector3(z=0.6)))
        return bool(odometry[-1].pose.pose.orientation.z > 0.05)

    listener.spin_until(turned, "the rover turns", seen=lambda: odometry[-1].pose.pose)
    assert odometry[-1].twist.twist.angular.z > 0.02
    assert odometry[-1].pose.pose.position.y > 0.0
    slips = dict(zip(heard["wheel_slip"][-1].wheel, heard["wheel_slip"][-1].slip, strict=True))
    assert slips["front_right"] > slips["front_left"] + 0.2
    publisher.publish(Twist(linear=Vector3(x=0.1, y=0.1)))
    listener.spin_until(
        lambda: "does not move sideways" in process.output,
        "crabbing is refused with its reason",
        seen=lambda: process.output,
    )
    assert process.interrupt() == 0


def test_the_documented_driver_turns_a_rover_to_both_sides(
    start: Starter, listener: Listener
) -> None:
    given = ("steering:=ackermann", "schedule:=cmd_vel", "noise:=0.0", "real_time_factor:=3.0")
    process = simulator(start, *given)
    odometry = collect(listener)["odom"]
    example = str(EXAMPLES / "drive_in_turns.py")
    driver = start.command(sys.executable, example, "--ros-args", "-p", "leg:=1.0")
    rates: list[float] = []

    def both() -> bool:
        rates.extend(each.twist.twist.angular.z for each in odometry[-20:])
        return max(rates, default=0.0) > 0.005 and min(rates, default=0.0) < -0.005

    listener.spin_until(both, "it turns left and right", seen=lambda: set(rates))
    assert driver.interrupt() == 0
    assert process.interrupt() == 0


def test_whoever_comes_late_has_the_truth_and_hears_of_every_change(
    start: Starter, listener: Listener
) -> None:
    process = simulator(
        start,
        "soil_overrides.cohesion:=1234",
        "change.soil:=compact_sand",
        "change.position:=0.6",
        "schedule:=S3",
        *FAST,
    )
    slips = listener.collect(WheelSlip, "wheel_slip")
    listener.wait_for_messages(slips, 5)
    truths = listener.collect(TerrainTruth, "ground_truth/terrain", LATCHED)
    listener.wait_for_messages(truths, 2)
    assert [(truth.soil, truth.sequence) for truth in truths] == [
        ("loose_sand", 0),
        ("compact_sand", 1),
    ]
    assert truths[0].cohesion == 1234.0
    assert truths[0].position == 0.0
    assert truths[1].position == 0.6
    assert process.interrupt() == 0


def test_the_clock_has_one_owner(start: Starter, listener: Listener) -> None:
    # drives on until the other is there, however long that takes to start
    first = simulator(start, *FAST, "duration:=3600.0")
    clock = listener.collect(Clock, "/clock")
    listener.wait_for_messages(clock, 3)
    second = simulator(start, "publish_clock:=true")
    assert second.wait() == 1
    assert re.search(
        "/clock has more than one owner: (/simulator|a node not yet known by name)", second.output
    )
    assert first.running
    assert first.terminate() == 0


def test_without_the_subscribers_that_it_waits_for_it_says_which_topics_miss_them(
    start: Starter,
) -> None:
    process = simulator(start, "wait_for_subscribers:=2", "wait_timeout:=0.3")
    assert process.wait() == 1
    assert (
        "after 0.3 s wheel_slip, wheel_sinkage, odom, joint_states, imu had fewer than 2"
        " subscribers" in process.output
    )


@pytest.mark.parametrize("name", ["interrupt", "terminate"])
def test_a_signal_ends_its_waiting_with_exit_code_0(
    name: str, start: Starter, listener: Listener
) -> None:
    process = simulator(start, "wait_for_subscribers:=1", "wait_timeout:=60.0")
    listener.spin_until(
        lambda: listener.node.count_publishers("wheel_slip") > 0, "the simulator is there"
    )
    assert getattr(process, name)() == 0


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (
            ("soil_overrides.cohesio:=1.0",),
            "unknown parameter soil_overrides.cohesio: did you mean soil_overrides.cohesion?",
        ),
        (("soil:=mud", "sed:=1"), "unknown parameter sed: did you mean seed?"),
        (("soil:=mud",), "mud: neither one of the soils that come with the package"),
    ],
)
def test_a_wrong_parameter_is_refused_by_name(
    parameters: tuple[str, ...], message: str, start: Starter
) -> None:
    process = simulator(start, *parameters)
    assert process.wait() == 2
    assert message in process.output
    assert "Traceback" not in process.output


def test_a_misspelt_name_in_a_parameter_file_and_an_unknown_argument_are_refused(
    start: Starter, tmp_path: Path
) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text(
        "simulator:\n  ros__parameters:\n    soil_overrides: {cohesion: 900.0, phi: 30.0}\n",
        encoding="utf-8",
    )
    from_file = start("rover_sim_node", "simulator", "--ros-args", "--params-file", str(path))
    argument = start("rover_sim_node", "simulator", "--fast")
    assert (from_file.wait(), argument.wait()) == (2, 2)
    assert "unknown parameter soil_overrides.phi" in from_file.output
    assert "unknown argument '--fast'" in argument.output


def test_a_missing_parameter_file_is_refused_and_help_lists_the_parameters(start: Starter) -> None:
    missing = start("rover_sim_node", "simulator", "--ros-args", "--params-file", "missing.yaml")
    usage = start("rover_sim_node", "simulator", "--help")
    assert (missing.wait(), usage.wait()) == (2, 0)
    assert "missing.yaml" in missing.output
    assert "Traceback" not in missing.output
    assert "  soil_overrides.cohesion (default nan, at least 0 Pa)" in usage.output


def test_parameters_are_described_with_their_ranges_and_cannot_be_changed(
    start: Starter, listener: Listener
) -> None:
    process = simulator(start, "real_time_factor:=1.0")
    names = ["rate", "seed", "soil", "soil_overrides.cohesion"]
    described = listener.call(
        DescribeParameters, "simulator/describe_parameters", DescribeParameters.Request(names=names)
    ).descriptors
    assert all(each.description and each.read_only for each in described)
    assert (
        described[0].floating_point_range[0].from_value,
        described[0].floating_point_range[0].to_value,
    ) == (1.0, 50.0)
    assert described[1].integer_range[0].from_value == 0
    assert "[Pa]" in described[3].description
    request = SetParameters.Request(parameters=[Parameter("rate", value=20.0).to_parameter_msg()])
    assert (
        not listener.call(SetParameters, "simulator/set_parameters", request).results[0].successful
    )
    assert process.interrupt() == 0
    wait_until(lambda: not process.running, "the simulator has ended")
