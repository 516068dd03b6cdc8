# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The watch as a process of its own, on real DDS."""

import json
import math
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from msg_defs.msg import TerrainEstimate, TractionAdvice, WheelSinkage, WheelSlip
from rover_parameters.records import ConfigError
from terrain_estimator.nodes.watch import Watch, advised, live_line
from tests.system.listening import Listener
from tests.system.processes import Starter
from tests.system.waiting import wait_until

KINDS = {
    "wheel_slip": WheelSlip,
    "wheel_sinkage": WheelSinkage,
    "terrain_estimate": TerrainEstimate,
}


def test_it_says_why_it_hears_nothing_then_what_it_hears_and_at_which_rates(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    parameters = {
        "period": "0.1",
        "report": str(tmp_path / "report.json"),
        "real_time_factor": "2.0",
    }
    process = start(
        "terrain_estimator",
        "watch",
        "--ros-args",
        *(w for k, v in parameters.items() for w in ("-p", f"{k}:={v}")),
    )
    process.wait_for_output(
        r"no data on terrain_estimate since the start: nobody publishes /terrain_estimate in ROS"
        r" domain \d+: start its publisher.*; likewise wheel_slip, wheel_sinkage, odom\n"
    )
    assert process.output.count("no data") == 1
    publishers = {topic: listener.publisher(kind, topic) for topic, kind in KINDS.items()}
    begin_s = time.monotonic()
    for number in range(20):
        # so seldom that what delays single messages on a busy machine hardly moves the median
        due_s = begin_s + 0.2 * number
        wait_until(lambda due_s=due_s: time.monotonic() >= due_s, "the message is due")  # type: ignore[misc]
        for topic, kind in KINDS.items():
            publishers[topic].publish(kind(sequence=number))
    process.wait_for_output("tan phi")
    assert process.interrupt() == 0
    assert "wheel_slip: messages come now" in process.output
    # 4 s of messages: a line for each would be 20, a line every 1 s would be 4
    assert process.output.count("tan phi") > 5
    report = json.loads((tmp_path / "report.json").read_text())
    # 5 a second, at twice real time
    assert report["rate_hz"]["wheel_slip"] == pytest.approx(2.5, rel=0.1)


def test_a_stop_is_printed_at_once_with_its_way_out_and_stays_on_every_line(
    listener: Listener, capsys: pytest.CaptureFixture[str]
) -> None:
    listener.host(Watch, parameter_overrides=[Parameter("period", value=0.1)])
    publishers = {
        topic: listener.publisher(kind, topic)
        for topic, kind in (KINDS | {"traction_advice": TractionAdvice}).items()
    }
    lines: list[str] = []

    def printed(words: str) -> bool:
        lines.extend(capsys.readouterr().out.splitlines())
        return any(words in line for line in lines)

    publishers["traction_advice"].publish(TractionAdvice(stop=True, status_text="wheels slip"))
    listener.spin_until(lambda: printed("STOP: wheels slip. It holds"), "the stop is printed")
    assert "ros2 service call /planner/resume std_srvs/srv/Trigger" in lines[-1]
    stamp = Header(stamp=Time(sec=3661))
    for topic, kind in KINDS.items():
        publishers[topic].publish(kind(header=stamp))
    listener.spin_until(lambda: printed("| STOP: wheels slip"), "a line has the stop")
    assert lines[-1].startswith("61:01.0 | c ")
    publishers["traction_advice"].publish(
        TractionAdvice(known=True, speed_limit=0.0815, status_text="")
    )
    listener.spin_until(lambda: printed("the stop is withdrawn"), "the end of it is printed")


def test_a_line_names_the_seconds_taken_and_no_estimate_of_a_model_that_does_not_fit() -> None:
    last = {topic: kind(header=Header(stamp=Time(sec=61))) for topic, kind in KINDS.items()}
    last["terrain_estimate"].seconds_judged, last["terrain_estimate"].seconds_taken = 20, 2
    assert "tan phi" in live_line(last)
    assert " | 2 of 20 s taken | " in live_line(last)
    assert " | prior only | slip" in live_line(last)
    last["terrain_estimate"].status = TerrainEstimate.IDENTIFIED
    last["terrain_estimate"].effect = ["drive_drag"]
    last["terrain_estimate"].effect_value = [1.2014]
    last["terrain_estimate"].effect_stddev = [0.012]
    last["terrain_estimate"].effect_unit = ["N m s/rad"]
    assert " | drive_drag 1.2 +- 0.012 N m s/rad | identified | slip" in live_line(last)
    last["terrain_estimate"].status = TerrainEstimate.DISAGREES
    assert live_line(last).startswith("1:01.0 | DISAGREES: the model does not fit | slip")
    assert "tan phi" not in live_line(last)


def test_old_advice_has_its_age_and_an_old_limit_is_none() -> None:
    limit = TractionAdvice(known=True, speed_limit=0.0815)
    assert advised(None, math.inf) == ""
    assert advised(limit, 0.5) == " | at most 0.0815 m/s"
    assert advised(limit, 61.0) == " | planner: no advice for 1 min 1 s"
    stop = TractionAdvice(stop=True, status_text="wheels slip")
    assert advised(stop, 61.0) == " | STOP: wheels slip (no advice for 1 min 1 s)"


def test_its_memory_grows_for_a_report_alone(listener: Listener, tmp_path: Path) -> None:
    report = Parameter("report", value=str(tmp_path / "report.json"))
    plain, reporting = (listener.host(Watch, parameter_overrides=given) for given in ([], [report]))
    publisher = listener.publisher(WheelSlip, "wheel_slip", readers=2)
    for number in range(5):
        publisher.publish(WheelSlip(sequence=number))
    listener.spin_until(lambda: len(reporting.arrivals_ns["wheel_slip"]) == 5, "it has heard all")
    assert plain.arrivals_ns == {}
    for node in (plain, reporting):
        listener.leave(node)
    assert json.loads((tmp_path / "report.json").read_text())["messages"]["wheel_slip"] == 5


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("report", "none/such/report.json", "there is no such folder"),
        ("use_sim_time", 1, "use_sim_time: expected true or false, got 1"),
    ],
)
def test_what_would_go_wrong_in_silence_or_at_the_end_is_refused_at_the_start(
    listener: Listener, name: str, value: str | int, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        listener.host(Watch, parameter_overrides=[Parameter(name, value=value)])


def test_texts_from_dds_reach_the_terminal_without_control_characters(
    start: Starter, listener: Listener
) -> None:
    hostile = "\x1b]0;title\x07\x1b[2j"
    process = start("terrain_estimator", "watch", "--ros-args", "-p", "period:=0.1")
    publishers = {topic: listener.publisher(kind, topic) for topic, kind in KINDS.items()}
    estimate = TerrainEstimate(model_id=hostile)
    estimate.header.frame_id = hostile
    estimate.decision.outcome_name = hostile
    for topic, kind in KINDS.items():
        publishers[topic].publish(estimate if topic == "terrain_estimate" else kind())
    process.wait_for_output(re.escape(r"\x1b]0;title\x07\x1b[2j"))
    assert process.interrupt() == 0
    assert not re.search("\x1b[]]|\x07|\x1b\\[2j", process.output)


LOGGING = r"""
import rclpy
from rover_parameters.command_line import make_logs_printable
make_logs_printable()
make_logs_printable()
rclpy.init()
node = rclpy.create_node("hostile")
for _ in range(3):
    node.get_logger().info("once \x1b[2J\nfaked", once=True)
    node.get_logger().warning("often \x9b2J")
"""


def test_a_log_line_of_a_node_is_one_line_without_control_characters() -> None:
    done = subprocess.run(
        [sys.executable, "-c", LOGGING],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "RCUTILS_COLORIZED_OUTPUT": "0"},
        check=True,
    )
    assert [line.partition("]: ")[2] for line in done.stderr.splitlines()] == [
        r"once \x1b[2J\nfaked",
        *[r"often \x9b2J"] * 3,
    ]
