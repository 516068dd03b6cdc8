# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder's node inside the test: long recordings, and topics that change meanwhile."""

import json
import threading
import time
from datetime import datetime
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from mcap.reader import make_reader
from mcap.records import Metadata
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.type_hash import TypeHash
from rosgraph_msgs.msg import Clock

from msg_defs.msg import EstimatorHealth, WheelSinkage, WheelSlip
from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagReader, BagWriter
from terrain_estimator.cli import replay
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.config.recorder import RecorderConfig
from terrain_estimator.messaging.diagnostics import FAILURES, UNRECORDED, Check
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.nodes.common import message_types
from terrain_estimator.nodes.common.publishers import type_conflicts
from terrain_estimator.nodes.recorder import RecorderNode
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES
from tests.drives import drive_messages
from tests.system.listening import Listener
from tests.system.waiting import wait_until

SLIP = "msg_defs/msg/WheelSlip"
RECORDED = "every topic that is recorded has a publisher"


def recorder(
    listener: Listener, folder: Path | str, parameters: dict[str, float | str | bool] | None = None
) -> RecorderNode:
    values = {"output": str(folder), "topics": "wheel_slip"} | (parameters or {})
    given = [Parameter(name, value=value) for name, value in values.items()]
    node = listener.host(partial(RecorderNode, threading.Event()), parameter_overrides=given)
    node.start()
    return node


def record(
    listener: Listener, node: RecorderNode, count: int, size: int = 0, pause_s: float = 0.0
) -> None:
    """Publish some messages of ``size`` bytes more, and wait until they are recorded."""
    publisher = listener.publisher(WheelSlip, "wheel_slip")
    before = node.received
    for number in range(count):
        time.sleep(pause_s)
        publisher.publish(WheelSlip(sequence=number, wheel=["x" * size]))
        wanted = before + number + 1
        listener.spin_until(lambda wanted=wanted: node.received == wanted, "it is recorded")  # type: ignore[misc]
    listener.node.destroy_publisher(publisher)


def test_a_long_recording_goes_on_in_the_next_file(listener: Listener, tmp_path: Path) -> None:
    for name, size, pause_s in (("split.size", 300_000, 0.0), ("split.duration", 0, 0.15)):
        folder = tmp_path / name
        node = recorder(listener, folder, {name: 1.0})
        record(listener, node, 10, size, pause_s)
        node.end()
        listener.leave(node)
        with BagReader(folder) as reader:
            assert [reader.decode(message).sequence for message in reader.messages()] == list(
                range(10)
            )
            assert reader.finished
        assert len(list(folder.glob("*.mcap"))) > 1


@pytest.mark.parametrize("name", ["size", "duration"])
def test_a_split_after_every_few_messages_is_refused_by_name(name: str) -> None:
    """A file for each message: the recorder did not end within a minute."""
    words = rf"parameter split\.{name}: 0\.02 .* is too little for a file: give 1 or more, or 0"
    with pytest.raises(ConfigError, match=words):
        configure(RecorderConfig, {f"split.{name}": 0.02})


def test_the_identities_of_estimators_are_in_a_bag_once_and_bounded(
    listener: Listener, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each file repeated all of them: 190 MB became 3.7 GB."""
    node = recorder(listener, tmp_path / "run", {"topics": "estimator_health", "split.size": 1.0})
    publisher = listener.publisher(EstimatorHealth, "estimator_health")
    for number in range(9):
        name = "short" if not number else f"{number}" * 600_000
        publisher.publish(EstimatorHealth(model_id=name))
        listener.spin_until(lambda wanted=number + 1: node.received == wanted, "it is recorded")  # type: ignore[misc]
    node.end()
    ids = [
        record.metadata["model_id"]
        for path in sorted((tmp_path / "run").glob("*.mcap"))
        for record in metadata_records(path)
        if record.name == "terrain_estimator"
    ]
    assert ids == ["short"]
    assert len(list((tmp_path / "run").glob("*.mcap"))) > 3
    said = capfd.readouterr().err
    assert said.count("the ids of its models and configurations are longer than 65536 bytes") == 1


def metadata_records(path: Path) -> list[Metadata]:
    with path.open("rb") as file:
        return list(make_reader(file).iter_metadata())


def test_a_name_by_the_time_is_never_taken(
    listener: Listener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    same = SimpleNamespace(now=lambda zone: datetime(2026, 1, 2, 3, 4, 5, tzinfo=zone))
    monkeypatch.setattr("terrain_estimator.nodes.common.bag_thread.datetime", same)
    nodes = [recorder(listener, output) for output in ("", "", "", "~/run", "~/run")]
    assert [node.state for node in nodes] == ["active"] * 4 + ["unconfigured"]
    for node in nodes:
        node.end()
    time = "bags/2026-01-02T03-04-05Z"
    assert all(
        (tmp_path / folder / "metadata.yaml").exists()
        for folder in (time, f"{time}-2", f"{time}-3", "run")
    )


def test_a_clock_that_steps_back_leaves_live_and_replay_the_same(
    listener: Listener, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    types = INPUT_TYPES | OUTPUT_TYPES
    node = recorder(listener, tmp_path / "run", {"topics": " ".join(types), "use_sim_time": True})
    clock = listener.publisher(Clock, "/clock")

    def set_clock(seconds: int) -> None:
        time = Time(sec=seconds)

        def heard() -> bool:
            clock.publish(Clock(clock=time))
            return bool(node.get_clock().now().to_msg() == time)

        listener.spin_until(heard, "the recorder has the time")

    def publish(topic: str, message: Any) -> None:
        before = node.received
        publishers[topic].publish(message)
        listener.spin_until(lambda: node.received > before, "the message is recorded")

    set_clock(1000)
    publishers = {
        topic: listener.publisher(message_types.message_class(kind), topic)
        for topic, kind in types.items()
    }
    live = Pipeline(load_model(), EstimatorConfig())
    steps = dict(enumerate([1001, 1002, 1003, 500, 501, 1004, 900, 1005]))
    for number, (topic, _, message) in enumerate(
        drive_messages(message_types.make, len(steps) / 10)
    ):
        if number % len(INPUT_TYPES) == 2:  # in the middle of an instant
            set_clock(steps[number // len(INPUT_TYPES)])
        publish(topic, message)
        for answer in live.add(topic, message):
            for output, said in answer.messages(message_types.make, live.meta).items():
                publish(output, said)
    node.end()
    assert capfd.readouterr().err.count("the clock went back: log times stay") == 1
    with BagReader(tmp_path / "run") as reader:
        times = [message.log_time_ns / 1e9 for message in reader.messages()]
    assert times == sorted(times)
    assert set(times) == {1000.0, 1001.0, 1002.0, 1003.0, 1004.0, 1005.0}
    assert replay.main([str(tmp_path / "run"), "--out", str(tmp_path / "out"), "--compare"]) == 3
    said = capfd.readouterr().out
    assert "NO ESTIMATE, no observation was used: the drive ended before its first second" in said
    assert said.count("is identical to live") == 2
    assert json.loads((tmp_path / "out/summary.json").read_text())["bags"][0]["estimates"] == len(
        steps
    )


def test_a_publisher_of_another_type_is_said_and_nothing_is_lost(
    listener: Listener, domain_id: int, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    node = recorder(listener, tmp_path / "run")
    record(listener, node, 3)
    said = ""

    def warned() -> str:
        nonlocal said
        said += capfd.readouterr().err
        return said if "is left out" in said else ""

    with Listener(domain_id, namespace="changed") as other:
        publisher = other.node.create_publisher(WheelSinkage, "/wheel_slip", 1)
        listener.spin_until(warned, "the other type is noticed")
        assert (
            f"/wheel_slip: a publisher of msg_defs/msg/WheelSinkage is left out, only {SLIP} is"
            " recorded" in said
        )
        publisher.publish(WheelSinkage())
        record(listener, node, 2)
    node.end()
    with BagReader(tmp_path / "run") as reader:
        assert [(raw.type_name, reader.decode(raw).sequence) for raw in reader.messages()] == [
            (SLIP, n) for n in (0, 1, 2, 0, 1)
        ]


def test_diagnostics_say_what_is_not_recorded_and_why(
    listener: Listener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = recorder(listener, tmp_path / "run", {"topics": "wheel_slip wheel_sinkage"})

    def said(check: Check) -> str:
        [finding] = [each for each in node.findings() if each.check is check]
        assert bool(finding.level) is bool(finding.value)
        return finding.text

    record(listener, node, 1)  # whose publisher ends
    listener.spin_until(
        lambda: said(UNRECORDED) == "without a publisher: /wheel_slip, /wheel_sinkage",
        "the end is noticed",
    )
    slips = listener.publisher(WheelSlip, "wheel_slip")
    with monkeypatch.context() as patch:
        patch.setattr("terrain_estimator.nodes.recorder.message_class", not_installed)
        sinkages = listener.node.create_publisher(WheelSinkage, "wheel_sinkage", 1)
        listener.spin_until(
            lambda: said(UNRECORDED) == "cannot record /wheel_sinkage: no such package",
            "it says why",
        )
    listener.spin_until(lambda: said(UNRECORDED) == RECORDED, "it looks again")
    assert said(FAILURES) == "0 callbacks failed"
    with monkeypatch.context() as patch:
        patch.setattr(BagWriter, "write", not_installed)
        slips.publish(WheelSlip())
        listener.spin_until(lambda: node.failures, "a message is lost")
        assert said(FAILURES) == "1 callbacks failed"
    assert said(FAILURES) == "0 callbacks failed"
    node.deactivate()
    listener.node.destroy_publisher(sinkages)
    assert said(UNRECORDED) == RECORDED
    node.activate()
    listener.spin_until(
        lambda: said(UNRECORDED) == "without a publisher: /wheel_sinkage",
        "what ended in the pause is missed after it",
    )
    node.end()


class HalfInstalled(type):
    """A package that has its Python part, and not its library."""

    _TYPE_SUPPORT = None

    @classmethod
    def __import_type_support__(cls) -> None: ...


def test_what_one_topic_raises_is_no_matter_of_the_others(
    listener: Listener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = recorder(listener, tmp_path / "run", {"topics": "wheel_sinkage wheel_slip"})

    def found(name: str) -> type[Any]:
        return (
            HalfInstalled("Half", (), {})
            if name.endswith("WheelSinkage")
            else message_types.message_class(name)
        )

    monkeypatch.setattr("terrain_estimator.nodes.recorder.message_class", found)
    listener.node.create_publisher(WheelSinkage, "wheel_sinkage", 1)
    listener.spin_until(lambda: node.count_publishers("wheel_sinkage"), "the broken one is there")
    record(listener, node, 2)
    [finding] = [each for each in node.findings() if each.check is UNRECORDED]
    assert "cannot record /wheel_sinkage: no type_support imported" in finding.text
    look = node.get_publishers_info_by_topic
    monkeypatch.setattr(
        node,
        "get_publishers_info_by_topic",
        lambda name: look(name) if name == "/wheel_slip" else not_installed(),
    )
    record(listener, node, 1)
    node.end()
    with BagReader(tmp_path / "run") as reader:
        assert (list(reader.topics), reader.span.count) == (["/wheel_slip"], 3)


def test_what_waits_when_publishers_offer_something_else_is_recorded(
    listener: Listener, tmp_path: Path
) -> None:
    node = recorder(listener, tmp_path / "run")
    publisher = listener.publisher(WheelSlip, "wheel_slip")
    for number in range(20):
        publisher.publish(WheelSlip(sequence=number))
    assert publisher.wait_for_all_acked()
    listener.node.create_publisher(
        WheelSlip, "wheel_slip", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    wait_until(lambda: node.count_publishers("wheel_slip") == 2, "the other publisher is there")
    listener.spin_until(lambda: not node._sources["/wheel_slip"].reliable, "it follows")
    node.end()
    with BagReader(tmp_path / "run") as reader:
        assert [reader.decode(message).sequence for message in reader.messages()] == list(range(20))


def not_installed(*_: object) -> None:
    raise ImportError("no such package")


def test_a_publisher_of_another_definition_of_the_type_is_said() -> None:
    def publisher(version: int, value: int) -> SimpleNamespace:
        kind = TypeHash(version, bytes([value]) * 32)
        return SimpleNamespace(topic_type=SLIP, topic_type_hash=kind)

    def said(end: SimpleNamespace) -> list[str]:
        return list(type_conflicts([end], SLIP, f"RIHS01_{'07' * 32}"))  # type: ignore[list-item]

    assert said(publisher(1, 7)) == []
    assert said(publisher(-1, 0)) == []  # a DDS that does not tell
    [words] = said(publisher(1, 8))
    assert words.startswith(f"a publisher has another definition of {SLIP}")
