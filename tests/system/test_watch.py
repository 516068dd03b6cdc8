# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The watch as a process of its own, on real DDS."""

import json
import time
from pathlib import Path

import pytest
from rclpy.parameter import Parameter

from msg_defs.msg import TerrainEstimate, WheelSinkage, WheelSlip
from rover_parameters.records import ConfigError
from terrain_estimator.nodes.watch import Watch
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
    for number in range(30):
        due_s = begin_s + 0.05 * number
        wait_until(lambda due_s=due_s: time.monotonic() >= due_s, "the message is due")  # type: ignore[misc]
        for topic, kind in KINDS.items():
            publishers[topic].publish(kind(sequence=number))
    process.wait_for_output("tan phi")
    assert process.interrupt() == 0
    assert "wheel_slip: messages come now" in process.output
    # 1.5 s of messages: a line every 0.1 s would be 15, every 1 s would be 2
    assert process.output.count("tan phi") > 5
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["rate_hz"]["wheel_slip"] == pytest.approx(
        10.0, rel=0.1
    )  # 20 a second, at twice real time


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
