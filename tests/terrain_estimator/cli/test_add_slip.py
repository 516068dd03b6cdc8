# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""add_slip makes a recording without slip replayable and changes nothing else."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import STATE, BagReader, BagWriter, Qos, Types, parse_qos
from terrain_estimator.cli import add_slip, replay
from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.messaging.slip_source import JOINTS, VELOCITY, SlipSource
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.presets import load_rover
from tests.drives import drive_messages

VISUAL = "visual_odometry"
STEPS = 80


def bag_without_slip(
    folder: Path,
    namespace: str = "",
    more: tuple[str, ...] = (),
    frame: str = "base_link",
    *,
    without_sinkage: bool = False,
) -> Path:
    """Write a drive whose velocity comes twice, as from two sensors."""
    types = Types()
    kinds = {
        name: kind
        for name, kind in INPUT_TYPES.items()
        if (name != "wheel_slip" or name in more)
        and not (without_sinkage and name == "wheel_sinkage")
    } | {VISUAL: INPUT_TYPES["odom"]}
    with BagWriter(folder) as writer:
        writer.add_metadata("field", {"day": "monday"})
        topics = {
            name: writer.add_topic(
                f"{namespace}/{name}", kind, qos=(STATE,) if name == "imu" else (Qos(),)
            )
            for name, kind in kinds.items()
        }
        for name, stamp, message in drive_messages(types.make, 0.1 * STEPS):
            if name == "odom":
                message.child_frame_id = frame
                writer.write(topics[VISUAL], types.serialize(message), stamp)
                message.child_frame_id = "base_link"
            if name in topics:
                writer.write(topics[name], types.serialize(message), stamp)
    return folder


def run(bag: Path, *arguments: str) -> int:
    return add_slip.main([str(bag), *arguments])


def contents(folder: Path, topic: str = "") -> list[Any]:
    """Return topic, time and bytes of all messages but one topic's."""
    with BagReader(folder) as reader:
        return [
            (raw.topic, raw.log_time_ns, raw.data)
            for raw in reader.messages()
            if raw.topic != topic
        ]


def test_the_slip_is_that_of_slip_source_the_rest_is_copied_and_the_new_bag_replays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_without_slip(tmp_path / "drive")
    assert replay.main([str(bag), "--out", str(tmp_path / "none")]) == 2
    assert "no topic /wheel_slip; it has" in (said := capsys.readouterr().err)
    assert "or create it from the wheel rates and a velocity with add_slip" in said
    assert run(bag, "--velocity", VISUAL) == 0
    out = tmp_path / "drive_slip"
    assert f"{out}: {STEPS} slips of {STEPS} joint_states\n" in capsys.readouterr().out
    assert contents(out, "/wheel_slip") == contents(bag)
    source, types = SlipSource(load_rover("mars_rover"), SlipSourceConfig()), Types()
    names = {JOINTS: JOINTS, "odom": VELOCITY}
    events = [
        (names[name], message)
        for name, _, message in drive_messages(types.make, 0.1 * STEPS)
        if name in names
    ]
    expected = [
        source.slip_message(pair, types.make) for event in events for pair in source.pair(*event)
    ]
    with BagReader(out) as reader:
        found = [reader.decode(raw) for raw in reader.messages(["/wheel_slip"])]
        assert reader.metadata["field"] == {"day": "monday"}
        assert (
            json.loads(reader.metadata["add_slip"]["configuration"])["velocity_type"] == "odometry"
        )
        assert parse_qos(reader.topics["/imu"].qos_text) == (STATE,)
    assert [each.sequence for each in found] == list(range(STEPS))
    for each, wanted in zip(found, expected, strict=True):
        assert (each.header.stamp.sec, each.header.stamp.nanosec) == (
            wanted.header.stamp.sec,
            wanted.header.stamp.nanosec,
        )
        np.testing.assert_array_equal(
            [each.slip, each.slip_stddev], [wanted.slip, wanted.slip_stddev]
        )
    assert replay.main([str(out), "--out", str(tmp_path / "estimates")]) == 0
    summary = json.loads((tmp_path / "estimates/summary.json").read_text())["bags"][0]
    assert summary["estimates"] == STEPS
    assert summary["outcomes"]["ACCEPTED"] > 0.9 * STEPS


def test_a_bag_without_sinkages_gets_an_empty_topic_and_replays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_without_slip(tmp_path / "drive", without_sinkage=True)
    options = ("--velocity", VISUAL, "-p", "empty_sinkage:=true")
    assert run(bag, *options) == 0
    out = tmp_path / "drive_slip"
    with BagReader(out) as reader:
        slips, depths = (
            [reader.decode(raw) for raw in reader.messages([topic])]
            for topic in ("/wheel_slip", "/wheel_sinkage")
        )
    assert [each.header for each in depths] == [each.header for each in slips]
    assert all(np.isnan(each.sinkage).all() for each in depths)
    capsys.readouterr()
    sensors = ("-p", "use_sinkage:=false", "-p", "contact_angle_sd:=0.03")
    assert replay.main([str(out), "--out", str(tmp_path / "estimates"), *sensors]) == 0
    summary = json.loads((tmp_path / "estimates/summary.json").read_text())["bags"][0]
    assert summary["outcomes"]["ACCEPTED"] > 0.9 * STEPS
    assert run(bag_without_slip(tmp_path / "other"), *options) == 2
    assert "has a topic /wheel_sinkage already" in capsys.readouterr().err


def test_a_namespace_and_the_parameters_of_the_node_are_taken(tmp_path: Path) -> None:
    bag = bag_without_slip(tmp_path / "drive", "/rover1")
    file = tmp_path / "slip.yaml"
    file.write_text(
        "/rover1/slip_source:\n  ros__parameters:\n    radius_deviation: 0.2\n", encoding="utf-8"
    )
    for name, parameters in {
        "plain": [],
        "file": ["--params-file", str(file)],
        "option": ["-p", "radius_deviation:=0.2"],
    }.items():
        assert (
            run(
                bag,
                "--velocity",
                VISUAL,
                "--namespace",
                "rover1",
                "--out",
                str(tmp_path / name),
                *parameters,
            )
            == 0
        )
    plain, by_file, by_option = (contents(tmp_path / name) for name in ("plain", "file", "option"))
    assert plain != by_file == by_option
    assert {topic for topic, *_ in plain} >= {"/rover1/wheel_slip"}


@pytest.mark.parametrize(
    ("more", "frame", "arguments", "words"),
    [
        ((), "base_link", ["--velocity", "radar"], "has no topic /radar; it has /imu"),
        (
            (),
            "base_link",
            ["--velocity", "imu"],
            "topic /imu is a sensor_msgs/msg/Imu, not a velocity: give one of nav_msgs",
        ),
        (
            (),
            "base_link",
            ["--velocity", VISUAL, "--joint-states", "odom"],
            "topic /odom is a nav_msgs/msg/Odometry, expected sensor_msgs",
        ),
        (("wheel_slip",), "base_link", ["--velocity", VISUAL], "has a topic /wheel_slip already"),
        (
            (),
            "camera",
            ["--velocity", VISUAL],
            (
                "0 slips of 80 joint_states, 80 pairs refused: velocity (child_frame_id) is in"
                " frame 'camera'"
            ),
        ),
        ((), "base_link", ["--velocity", VISUAL, "-p", "rover:=none"], "none"),
        ((), "base_link", ["--velocity", VISUAL, "-p", "radius:=1"], "radius"),
    ],
)
def test_what_is_wrong_is_named_and_no_bag_is_left(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    more: tuple[str, ...],
    frame: str,
    arguments: list[str],
    words: str,
) -> None:
    bag = bag_without_slip(tmp_path / "drive", more=more, frame=frame)
    assert run(bag, *arguments) == 2
    assert words in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["drive"]


def test_a_velocity_that_is_also_the_estimators_is_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_without_slip(tmp_path / "drive")
    assert run(bag, "--velocity", "odom") == 0
    assert "warning: velocity comes from the estimator's own input odom" in capsys.readouterr().err
