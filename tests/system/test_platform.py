# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A four-wheel platform by its own topics and joint names, as platform.launch.py starts the nodes.

The launch library has no wheel: what the file would start is read from it, and started here.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Twist

from msg_defs.msg import TerrainEstimate, WheelSlip
from terrain_estimator.bags import BagReader
from terrain_estimator.cli import model_by_wheel, replay
from terrain_estimator.nodes.common.message_types import make, message_class
from terrain_estimator.topics import INPUT_TYPES, LATERAL_IN_TWIST, YAW_IN_RATES
from terramechanics.presets import load_soil
from tests.launch_stand_in import Kept, started
from tests.system.listening import Listener
from tests.system.processes import Process, Starter
from tests.terrain_estimator.importing.rose_trial import ROVER, SLOPE, TRACK, driven
from tests.terrain_estimator.kinds import exported

LAUNCH = Path(__file__).parents[2] / "terrain_estimator/launch/platform.launch.py"
JOINTS = ("left_front_joint", "right_front_joint", "left_rear_joint", "right_rear_joint")
TOPICS = {
    "joint_states": "/joint_states",
    "odom": "/odom",
    "imu": "/imu/data",
    "wheel_sinkage": "/sinkage_of_my_adapter",
    "velocity": "/visual_odometry",
}
TYPES = INPUT_TYPES | {"velocity": INPUT_TYPES["odom"]}
STEPS, TURN = range(20, 110), 80  # samples of the drive at 10 Hz, and where it begins to turn
PITCH = math.atan(SLOPE)
SPEED_SD, SIDE_SD, TURN_SD = 1e-3, 2e-3, 1e-3


def start_node(start: Starter, node: Kept) -> Process:
    """Start a node with the parameters and remappings that the launch file gives it."""
    words = []
    for parameters in node.named["parameters"]:
        words += [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    for ours, theirs in node.named["remappings"]:
        words += ["-r", f"{ours}:={theirs}"]
    return start(node.named["package"], node.named["executable"], "--ros-args", *words)


def header(step: int, frame: str) -> Any:
    sec, nanosec = divmod((step + 1) * 100_000_000, 1_000_000_000)
    stamp = make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def messages(step: int) -> dict[str, Any]:
    """Return what the platform publishes at a sample of the drive."""
    drive = driven()
    joints = make(
        "sensor_msgs/msg/JointState",
        header=header(step, ""),
        name=["mast", *JOINTS],
        position=[],
        velocity=[0.0, *drive.rate[step]],
        effort=[0.0, *drive.torque[step]],
    )
    odom = make("nav_msgs/msg/Odometry", header=header(step, "odom"), child_frame_id="base_link")
    odom.twist.twist.linear.x, _, odom.twist.twist.angular.z = drive.velocity[step].tolist()
    odom.twist.covariance[0] = SPEED_SD**2
    imu = make("sensor_msgs/msg/Imu", header=header(step, "base_link"))
    imu.orientation.y, imu.orientation.w = math.sin(-PITCH / 2.0), math.cos(PITCH / 2.0)
    imu.orientation_covariance[4] = 1e-6
    imu.linear_acceleration_covariance[0] = -1.0
    sinkage = make(
        "msg_defs/msg/WheelSinkage",
        header=header(step, "base_link"),
        sequence=step,
        wheel=list(JOINTS),
        sinkage=drive.sinkage[step],
        sinkage_stddev=np.full(4, 3e-4),
        contact_angle=np.zeros(4),
        contact_angle_stddev=np.full(4, 3e-3),
    )
    return {
        "wheel_sinkage": sinkage,
        "odom": odom,
        "imu": imu,
        "joint_states": joints,
        "velocity": odom,
    }


def test_slip_and_estimates_follow_from_the_topics_and_joints_of_a_platform(
    start: Starter,
    listener: Listener,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    nodes = {
        node.named["executable"]: node
        for node in started(
            LAUNCH,
            model=str(exported(ROVER, tmp_path)),
            rover="four_wheel_rover",
            wheels=",".join(JOINTS),
            velocity=TOPICS["velocity"],
            wheel_sinkage=TOPICS["wheel_sinkage"],
            track_width=str(TRACK),
            output=str(tmp_path / "bag"),
        )
    }
    assert set(nodes) == {"slip_source", "estimator", "recorder"}
    processes = {name: start_node(start, node) for name, node in nodes.items()}
    slip_source = processes["slip_source"].wait_for_output("ready: rover (.*)", timeout=60.0)
    assert slip_source[1] == f"four_wheel_rover, wheels {', '.join(JOINTS)}"
    slips = listener.collect(WheelSlip, "/wheel_slip")
    estimates = listener.collect(TerrainEstimate, "/terrain_estimate")
    publishers = {
        name: listener.publisher(  # slip_source and estimator share one, the recorder has all
            message_class(TYPES[name]), topic, readers=2 + (name == "joint_states"), timeout=60.0
        )
        for name, topic in TOPICS.items()
    }
    commands = listener.publisher(Twist, "/cmd_vel", timeout=60.0)
    processes["estimator"].wait_for_output("matched all inputs", timeout=60.0)
    for topic in ("wheel_slip", "terrain_estimate"):  # of which the bag is to have all
        processes["recorder"].wait_for_output(f"matched /{topic} ", timeout=60.0)
    for count, step in enumerate(STEPS, start=1):
        commands.publish(Twist())
        for name, message in messages(step).items():
            publishers[name].publish(message)
        listener.wait_for_messages(slips, count)
        # no faster than the estimator: its queues hold 50
        listener.wait_for_messages(estimates, count - 10, timeout=60.0)
    drive = driven()
    assert {tuple(each.wheel) for each in slips} == {JOINTS}
    np.testing.assert_allclose([each.slip for each in slips], drive.slip[STEPS], atol=1e-9)
    turning = drive.slip[TURN + 5 : STEPS.stop]
    assert (turning.max(axis=1) - turning.min(axis=1)).min() > 0.3
    listener.wait_for_messages(estimates, len(STEPS) - 1)
    last = estimates[TURN - STEPS.start - 1]
    assert last.observations_used >= 50, last.status_text
    # torque_0 and torque_1 stood there while the joints' names were others
    assert last.status_text.endswith("rows missing: acceleration")
    for name in ("estimator", "slip_source", "recorder"):
        assert processes[name].interrupt(60.0) == 0
    with BagReader(tmp_path / "bag") as reader:
        topics = {name: topic.count for name, topic in reader.topics.items()}
    recorded = (*TOPICS.values(), "/cmd_vel", "/wheel_slip")
    assert {name: topics[name] for name in recorded} == dict.fromkeys(recorded, len(STEPS))
    given = [str(tmp_path / "bag"), "--model", str(tmp_path / f"{ROVER.name}.pt"), "--compare"]
    given += ["--remap", f"imu:={TOPICS['imu']}"]
    given += ["--remap", f"wheel_sinkage:={TOPICS['wheel_sinkage']}"]
    given += ["-p", f"rover:=four_wheel_rover[{','.join(JOINTS)}]", "--out", str(tmp_path / "out")]
    assert replay.main(given) == 0
    assert "terrain_estimate is identical to live" in capsys.readouterr().out


def turning(step: int) -> dict[str, Any]:
    """Return what the platform publishes where it measures neither sinkage nor contact angle."""
    found, (_, left, turn) = messages(step), driven().velocity[step].tolist()
    del found["wheel_sinkage"]
    odom, imu = found["odom"], found["imu"]
    odom.twist.twist.linear.y, odom.twist.covariance[LATERAL_IN_TWIST] = left, SIDE_SD**2
    imu.angular_velocity.z, imu.angular_velocity_covariance[YAW_IN_RATES] = turn, TURN_SD**2
    return found


def test_a_model_by_wheel_uses_the_turn_of_a_platform_without_sinkages(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    written = ["--rover", ROVER.name, "--soil", "loose_sand", "--track-width", str(TRACK)]
    assert model_by_wheel.main([*written, "--out", str(tmp_path)]) == 0
    nodes = {
        node.named["executable"]: node
        for node in started(
            LAUNCH,
            model=str(tmp_path / f"{ROVER.name}_by_wheel.pt"),
            wheels=",".join(JOINTS),
            velocity=TOPICS["velocity"],
            contact_angle_sd="0.01",
            track_width=str(TRACK),
            record="false",
        )
    }
    assert set(nodes) == {"slip_source", "estimator"}
    processes = {name: start_node(start, node) for name, node in nodes.items()}
    processes["slip_source"].wait_for_output("ready", timeout=60.0)
    slips = listener.collect(WheelSlip, "/wheel_slip")
    estimates = listener.collect(TerrainEstimate, "/terrain_estimate")
    inputs = [name for name in TOPICS if name != "wheel_sinkage"]
    publishers = {
        name: listener.publisher(
            message_class(TYPES[name]),
            TOPICS[name],
            readers=1 + (name == "joint_states"),
            timeout=60.0,
        )
        for name in inputs
    }
    processes["estimator"].wait_for_output("matched all inputs", timeout=60.0)
    for count, step in enumerate(STEPS, start=1):
        found = turning(step)
        for name in inputs:
            publishers[name].publish(found[name])
        listener.wait_for_messages(slips, count, timeout=60.0)
        listener.wait_for_messages(estimates, count - 10, timeout=60.0)
    listener.wait_for_messages(estimates, len(STEPS) - 1, timeout=60.0)
    last, soil = estimates[-1], load_soil("loose_sand")
    assert last.observations_used >= 80, last.status_text
    assert last.status != TerrainEstimate.IDENTIFIED
    for mean, sd, true in (
        (last.cohesion, last.cohesion_stddev, soil.cohesion),
        (last.tan_phi, last.tan_phi_stddev, soil.tan_phi),
    ):
        assert abs(mean - true) < 3.0 * sd
    assert last.tan_phi_stddev < 0.11  # half of the prior's
    for name in ("estimator", "slip_source"):
        assert processes[name].interrupt(60.0) == 0


@pytest.mark.parametrize("wheels", ["a,b", "a,b,c,c"])
def test_joint_names_that_do_not_fit_the_rover_are_an_error(start: Starter, wheels: str) -> None:
    given = {"model": "mars_rover", "velocity": "/visual_odometry", "wheels": wheels}
    (node,) = (
        each for each in started(LAUNCH, **given) if each.named["executable"] == "slip_source"
    )
    process = start_node(start, node)
    assert process.wait(60.0) == 2
    assert "Traceback" not in process.output
    assert "four_wheel_rover" in process.output or "not all different" in process.output
