# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The planner as a process of its own, and the subscriber of docs/examples that obeys it."""

import math
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import Twist
from std_msgs.msg import Header
from std_srvs.srv import Trigger

from msg_defs.msg import TerrainEstimate, TractionAdvice
from terrain_estimator.nodes.common import message_types
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.presets import PRESETS
from tests.drives import drive_messages
from tests.system.listening import Listener
from tests.system.processes import Starter

SOILS = ["loose_sand", "compact_sand", "regolith"]
EXAMPLES = Path(__file__).parents[2] / "docs/examples"
CALL_SERVICE = Path(__file__).parents[2] / "ros2_ws/call_service.py"


def estimate(header: Any, *, identified: bool) -> TerrainEstimate:
    return TerrainEstimate(
        header=header,
        model_id="wheelbarrow-1",
        cohesion=1500.0,
        tan_phi=0.6,
        covariance=[200.0**2, 0.0, 0.0, 0.03**2],
        cohesion_identified=True,
        tan_phi_identified=identified,
        soil=SOILS,
        soil_probability=[1.0, 0.0, 0.0],
    )


def test_it_advises_once_a_period_and_says_when_it_does_not_know_yet(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    rover = tmp_path / "rover.yaml"
    rover.write_text(
        (PRESETS / "rovers/mars_rover.yaml").read_text().replace("name: mars_rover", "name: twin")
    )
    process = start(
        "terrain_estimator", "planner", "--ros-args", "-p", "period:=0.3", "-p", f"rover:={rover}"
    )
    process.wait_for_output("ready: rover twin", timeout=60.0)
    found = listener.collect(TractionAdvice, "traction_advice")
    outputs = {
        topic: listener.publisher(message_types.message_class(name), topic)
        for topic, name in INPUT_TYPES.items()
    }
    estimates = listener.publisher(TerrainEstimate, "terrain_estimate")
    sent = 0
    for topic, _, message in drive_messages(message_types.make, 3.0):
        outputs[topic].publish(message)
        if topic == "imu":
            if not sent:  # the planner has the first measurements, and takes them before this
                assert all(output.wait_for_all_acked() for output in outputs.values())
            stamp = message.header.stamp
            estimates.publish(
                estimate(message.header, identified=stamp.sec + 1e-9 * stamp.nanosec >= 101.45)
            )
            sent += 1
            # one advice for three estimates: no faster than the planner
            listener.wait_for_messages(found, (sent + 2) // 3, timeout=60.0)
    assert sent == 30
    for wrong in (
        {"soil": ["mud"]},
        {"cohesion": math.nan},
        {"soil_probability": [0.0] * 3},
        {"soil_probability": [1.0]},
    ):
        message = estimate(found[-1].header, identified=True)
        for name, value in wrong.items():
            setattr(message, name, value)
        estimates.publish(message)
    process.wait_for_output("its soils are mud")
    assert [each.sequence for each in found] == list(range(10))
    assert [each.known for each in found] == [False] * 5 + [True] * 5
    assert "margins unknown" in found[0].status_text
    assert math.isnan(found[0].stall_probability)
    last = found[-1]
    assert last.pull_available_lower < last.pull_available < last.pull_available_upper
    assert last.traction_margin == pytest.approx(last.pull_available - last.pull_needed)
    assert 0.0 < last.expected_slip_lower < last.expected_slip < last.expected_slip_upper < 1.0
    assert last.speed_limit > 0.0
    assert 0.0 <= last.front_stall_probability < 0.5
    caller = start.command(
        sys.executable, str(CALL_SERVICE), "/planner/resume", "std_srvs/srv/Trigger"
    )
    listener.spin_until(lambda: not caller.running, "the documented call ends")
    assert (caller.wait(), "Trigger_Response(success=True" in caller.output) == (
        0,
        True,
    ), caller.output
    assert (
        process.output.count(
            "terrain_estimate is of model wheelbarrow-1, the planner's is mars_rover"
        )
        == 1
    )
    assert len(found) == 10, "a wrong estimate is not advised on"
    assert process.interrupt(60.0) == 0


def test_what_is_wrong_is_named(start: Starter) -> None:
    for argument, words in (
        ("model:=nowhere.pt", "nowhere.pt"),
        ("slip_limt:=0.5", "did you mean slip_limit"),
    ):
        process = start("terrain_estimator", "planner", "--ros-args", "-p", argument)
        assert process.wait(60.0) == 2
        assert words in process.output
        assert "Traceback" not in process.output


def test_the_documented_reader_says_when_to_use_the_estimate(
    start: Starter, listener: Listener
) -> None:
    process = start.command(sys.executable, str(EXAMPLES / "read_estimate.py"))
    process.wait_for_output("no estimate yet\n", timeout=60.0)
    estimates = listener.publisher(TerrainEstimate, "terrain_estimate")
    message = estimate(Header(), identified=False)
    message.status_text = "converging; not identified yet: tan phi"
    estimates.publish(message)
    numbers = "c 1500 Pa, tan phi 0.600, variances 4e+04 Pa^2 and 0.0009, covariance 0 Pa"
    process.wait_for_output(rf"{re.escape(numbers)}: do not use them: converging; not identified")
    estimates.publish(estimate(Header(), identified=True))
    process.wait_for_output(rf"{re.escape(numbers)}: use them\n")
    # usually 3 s, but a busy machine may miss that second
    process.wait_for_output("do not use them: no new estimate for [3-9] s")
    message = estimate(Header(), identified=True)
    message.status = TerrainEstimate.DISAGREES
    estimates.publish(message)
    process.wait_for_output("do not use them: they are the prior's")
    assert process.interrupt() == 0


def test_the_documented_subscriber_goes_by_a_clock_that_nobody_sets_back_or_stops(
    start: Starter, listener: Listener
) -> None:
    commands = listener.collect(Twist, "cmd_vel")
    start.command(
        sys.executable, str(EXAMPLES / "follow_advice.py"), "--ros-args", "-p", "use_sim_time:=true"
    )  # and there is no /clock
    listener.wait_for_messages(commands, 2)
    assert {each.linear.x for each in commands} == {0.0}


def test_the_documented_subscriber_stops_before_a_soft_patch_and_creeps_on_when_told_to(
    start: Starter, listener: Listener
) -> None:
    found = listener.collect(TractionAdvice, "traction_advice")
    process = start.command("bash", str(EXAMPLES / "soft_patch.sh"), "true", "3.0", "45.0")
    process.wait_for_output("stop: the ground under the front wheels", timeout=120.0)
    listener.spin_until(
        # the first of them is taken here: no callback ran before
        lambda: found and found[-1].stop and math.isnan(found[-1].measured_slip),
        "the rover stands",
        60.0,
    )
    assert listener.call(Trigger, "planner/resume", Trigger.Request()).success
    process.wait_for_output("creep: no measurement while driving", timeout=60.0)
    listener.spin_until(lambda: found[-1].commanded_speed > 0.02, "the rover moves again", 60.0)
    assert process.wait(120.0) == 0
    assert "the rover is stuck" not in process.output
    assert "Traceback" not in process.output
