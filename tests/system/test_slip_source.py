# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The source of wheel_slip as a process of its own."""

from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from msg_defs.msg import TerrainEstimate, WheelSlip
from terrain_estimator.nodes.common import message_types
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.presets import PRESETS
from tests.drives import ROVER, drive_messages
from tests.system.listening import Listener
from tests.system.processes import Starter


def refusals(reports: list[DiagnosticArray]) -> list[DiagnosticStatus]:
    """Return the diagnostics about refused pairs."""
    return [
        each
        for report in reports
        for each in report.status
        if each.name == "/slip_source: refused" and each.level != b"\x00"
    ]


def test_slip_from_wheel_rates_and_odometry_is_that_of_the_wheels(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    rover = tmp_path / "rover.yaml"
    rover.write_text(
        (PRESETS / "rovers/mars_rover.yaml").read_text().replace("name: mars_rover", "name: twin")
    )
    process = start(
        "terrain_estimator",
        "slip_source",
        "--ros-args",
        "-p",
        f"rover:={rover}",
        "-r",
        "velocity:=odom",
    )
    process.wait_for_output("ready: rover twin", timeout=60.0)
    assert "Give velocity another source" in process.output
    found = listener.collect(WheelSlip, "wheel_slip")
    outputs = {
        topic: listener.publisher(message_types.message_class(INPUT_TYPES[topic]), topic)
        for topic in ("joint_states", "odom")
    }
    measured, reports, last = [], listener.collect(DiagnosticArray, "/diagnostics"), {}
    listener.wait_for_messages(reports, 1)  # the node has matched our readers: no slip is lost
    for topic, _, message in drive_messages(message_types.make, 3.0):
        last[topic] = message
        if topic in outputs:
            outputs[topic].publish(message)
        if topic == "wheel_slip":
            measured.append(message)
    listener.wait_for_messages(found, len(measured))
    assert [each.header.stamp for each in found] == [each.header.stamp for each in measured]
    assert [each.sequence for each in found] == list(range(len(measured)))
    assert {tuple(each.wheel) for each in found} == {ROVER.wheel_names}
    axles = np.array(ROVER.wheel_axle) == np.arange(ROVER.axles)[:, None]
    slips = (
        (np.array([each.slip for each in found]) - np.array([each.slip for each in measured]))
        @ axles.T
        / 2.0
    )
    variances = (
        np.array([each.slip_stddev for each in found]) ** 2
        + np.array([each.slip_stddev for each in measured]) ** 2
    )
    # Of means of an axle. One velocity an instant: 30 independent values, whose mean square is
    # between 0.4 and 2 with 99.9 %.
    assert 0.4 < (slips**2 / (variances @ axles.T / 4.0)).mean() < 2.0
    joints, odometry = last["joint_states"], last["odom"]
    joints.header.stamp.sec += 1
    odometry.header.stamp, odometry.child_frame_id = joints.header.stamp, "camera"
    outputs["joint_states"].publish(joints)
    outputs["odom"].publish(odometry)
    listener.spin_until(
        lambda: refusals(reports), "the velocity of another frame is refused", seen=lambda: reports
    )
    assert (
        "velocity (child_frame_id) is in frame 'camera', expected 'base_link'"
        in refusals(reports)[0].message
    )
    assert len(found) == len(measured)
    assert process.interrupt(60.0) == 0


def test_a_rover_without_sinkage_and_contact_angle_sensors_needs_no_other_node(
    start: Starter, listener: Listener
) -> None:
    slip = ("slip_source", "--ros-args", "-p", "empty_sinkage:=true")
    sensors = ("-p", "use_sinkage:=false", "-p", "contact_angle_sd:=0.03")
    start("terrain_estimator", *slip).wait_for_output("ready", timeout=60.0)
    estimator = start("terrain_estimator", "estimator", "--ros-args", *sensors)
    estimator.wait_for_output("ready", timeout=60.0)
    estimates = listener.collect(TerrainEstimate, "terrain_estimate")
    topics = {name: name for name in ("joint_states", "odom", "imu")}
    publishers = {
        name: listener.publisher(message_types.message_class(INPUT_TYPES[kind]), name)
        for name, kind in (topics | {"velocity": "odom"}).items()
    }
    listener.spin_until(
        lambda: publishers["joint_states"].get_subscription_count() == 2,
        "both nodes read joint_states",
    )
    estimator.wait_for_output("matched all inputs", timeout=60.0)
    for count, (topic, _, message) in enumerate(drive_messages(message_types.make, 4.0), 1):
        if topic in topics:
            publishers[topic].publish(message)
        if topic == "odom":
            publishers["velocity"].publish(message)
        # no faster than both nodes: a set whose slip comes after later sets is given up
        listener.wait_for_messages(estimates, count // len(INPUT_TYPES) - 1, timeout=60.0)
    listener.wait_for_messages(estimates, 39, timeout=60.0)
    moving = estimates[10:]
    assert {each.decision.outcome_name for each in moving} == {"ACCEPTED"}
    assert "torque_0" in moving[-1].rows
    assert moving[-1].cohesion_stddev < estimates[0].cohesion_stddev


@pytest.mark.parametrize(
    ("argument", "words"),
    [("velocity_type:=radar", "odometry, twist"), ("rover:=nothing", "nothing")],
)
def test_what_is_wrong_is_named(start: Starter, argument: str, words: str) -> None:
    process = start("terrain_estimator", "slip_source", "--ros-args", "-p", argument)
    assert process.wait(60.0) == 2
    assert words in process.output
    assert "Traceback" not in process.output
