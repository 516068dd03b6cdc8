# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder as a process of its own, on real DDS."""

import re
import resource
import signal
from pathlib import Path

import pytest
import yaml
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from msg_defs.msg import TerrainTruth, WheelSlip
from terrain_estimator.bags import BagReader, recover
from terrain_estimator.nodes.common.message_types import message_class
from terrain_estimator.topics import OPTIONAL_TOPICS, RECORDED_TOPICS
from tests.system.listening import LATCHED, Listener
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until

FOR_VIEWERS = ("/tf", "wheel_markers", "terrain_grid")
"""Topics that follow from recorded ones, and are recorded on request alone."""


def record(start: Starter, folder: Path, topics: str, *more: str) -> Process:
    return start(
        "terrain_estimator",
        "recorder",
        "--ros-args",
        "-p",
        f"output:={folder}",
        "-p",
        f"topics:={topics}",
        *more,
    )


def count(folder: Path, *topics: str) -> int:
    """Return the number of messages (of some topics alone) on the disk, finished or not."""
    if not list(folder.glob("*.mcap")):
        return 0
    with BagReader(folder) as reader:
        found = reader.topics.items()
        return sum(each.count for name, each in found if name in topics or not topics)


def publish(publisher: Publisher, numbers: range) -> None:
    for number in numbers:
        publisher.publish(WheelSlip(sequence=number, wheel=["front"], slip=[number / 1000]))


def sequences(folder: Path) -> list[int]:
    with BagReader(folder) as reader:
        return [reader.decode(message).sequence for message in reader.messages(["/wheel_slip"])]


def test_a_kill_loses_no_message_that_was_received(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    recorder = record(start, folder, "[wheel_slip]")
    publisher = listener.publisher(WheelSlip, "wheel_slip")
    publish(publisher, range(240))
    wait_until(
        lambda: count(folder) == 240, "240 messages are recorded", seen=lambda: count(folder)
    )
    assert recorder.kill() == -signal.SIGKILL
    assert sequences(folder) == list(range(240))
    with BagReader(folder) as reader:
        assert not reader.finished
        assert "ends without a footer" in reader.notes[0]
    recovery = recover(folder, tmp_path / "mended")
    assert (recovery.span.count, recovery.lost) == (240, 0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_a_signal_ends_the_recording_cleanly(
    start: Starter, listener: Listener, tmp_path: Path, number: signal.Signals
) -> None:
    folder = tmp_path / "run"
    recorder = record(start, folder, "[wheel_slip]")
    publisher = listener.publisher(WheelSlip, "wheel_slip")
    publish(publisher, range(50))
    wait_until(lambda: count(folder) == 50, "50 messages are recorded")
    recorder.signal(number)
    assert recorder.wait() == 0
    assert "recorded 50 messages" in recorder.output
    with BagReader(folder) as reader:
        assert reader.finished
        assert reader.notes == []
    assert sequences(folder) == list(range(50))


def test_it_says_when_all_topics_are_recorded_and_picks_up_a_late_one(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    recorder = record(start, folder, "[wheel_slip, ground_truth/terrain]")
    publish(listener.publisher(WheelSlip, "wheel_slip"), range(1))
    recorder.wait_for_output(r"matched /wheel_slip \(msg_defs/msg/WheelSlip, reliable, volatile\)")
    assert "recording 2 topics" not in recorder.output
    latched = listener.node.create_publisher(TerrainTruth, "ground_truth/terrain", LATCHED)
    latched.publish(TerrainTruth(soil="said before the recorder came"))
    recorder.wait_for_output(
        r"matched /ground_truth/terrain \(msg_defs/msg/TerrainTruth, reliable, transient local\)"
    )
    recorder.wait_for_output(rf"recording 2 topics to {folder}")
    wait_until(lambda: count(folder) == 2, "both messages are recorded")
    assert recorder.interrupt() == 0
    with BagReader(folder) as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == {
            "/wheel_slip": 1,
            "/ground_truth/terrain": 1,
        }
        [profile] = yaml.safe_load(reader.topics["/ground_truth/terrain"].qos_text)
        assert (profile["durability"], profile["reliability"]) == ("transient_local", "reliable")


def test_by_default_it_records_every_topic_of_the_suite_and_misses_no_optional_one(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    page = (Path(__file__).parents[2] / "docs/messages.md").read_text(encoding="utf-8")
    kinds = dict(re.findall(r"^\| `([\w/]+)` \| `(\w+/msg/\w+)` \|", page, re.MULTILINE))
    for name in FOR_VIEWERS:
        del kinds[name]
    assert set(kinds) == set(RECORDED_TOPICS)
    recorder = start("terrain_estimator", "recorder", "--ros-args", "-p", f"output:={tmp_path}/run")
    diagnostics = listener.collect(DiagnosticArray, "/diagnostics")
    publishers = {
        name: listener.node.create_publisher(message_class(kind), name, 5)
        for name, kind in kinds.items()
        if name not in OPTIONAL_TOPICS or name == "traction_advice"
    }
    recorder.wait_for_output(r"recording \d+ topics")
    recorder.wait_for_output("matched /traction_advice")
    advice = publishers["traction_advice"]
    # each side matches on its own: a message that is published before both have is lost
    listener.spin_until(lambda: advice.get_subscription_count() > 0, "the recorder has matched")
    advice.publish(message_class(kinds["traction_advice"])())
    wait_until(lambda: count(tmp_path / "run", "/traction_advice") == 1, "the message is recorded")

    def silent() -> str:
        found = [each for message in diagnostics for each in message.status]
        return next((e.message for e in reversed(found) if e.name.endswith("recording")), "")

    listener.spin_until(
        lambda: silent() == "every topic that is recorded has a publisher", "none is missed"
    )
    assert recorder.interrupt() == 0
    assert count(tmp_path / "run", "/traction_advice") == 1


def test_it_follows_a_publisher_that_offers_less(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    recorder = record(start, tmp_path / "run", "wheel_slip")
    sensor = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    publish(listener.publisher(WheelSlip, "wheel_slip", sensor), range(1))
    recorder.wait_for_output(
        r"matched /wheel_slip \(msg_defs/msg/WheelSlip, best effort, volatile\)"
    )
    assert recorder.interrupt() == 0


def test_names_follow_the_namespace(start: Starter, domain_id: int, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    recorder = record(start, folder, "wheel_slip", "-r", "__ns:=/rover1")
    with Listener(domain_id, namespace="rover1") as rover:
        publish(rover.publisher(WheelSlip, "wheel_slip"), range(3))
        wait_until(lambda: count(folder) == 3, "three messages are recorded")
    assert recorder.interrupt() == 0
    with BagReader(folder) as reader:
        assert list(reader.topics) == ["/rover1/wheel_slip"]


def test_with_simulated_time_the_log_times_are_simulated(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    recorder = record(start, folder, "wheel_slip", "-p", "use_sim_time:=true")
    slips = listener.node.create_publisher(WheelSlip, "wheel_slip", 10)
    clock = listener.publisher(Clock, "/clock")
    time = Clock()
    time.clock.sec = 1234

    def heard() -> bool:
        clock.publish(time)  # again and again, as simulators do
        return slips.get_subscription_count() > 0

    listener.spin_until(heard, "the recorder has subscribed once the clock runs")
    publish(slips, range(1))
    wait_until(lambda: count(folder) == 1, "the message is recorded")
    clock.publish(Clock(clock=Time(sec=-1)))
    recorder.wait_for_output("in a callback, the message is left out: .*negative")
    publish(slips, range(1, 2))
    wait_until(
        lambda: count(folder) == 2, "a clock before zero, at which rclpy raises, does not end it"
    )
    assert recorder.interrupt() == 0
    with BagReader(folder) as reader:
        message, _ = reader.messages()
    assert message.log_time_ns == 1234 * 10**9
    assert message.publish_time_ns > 10**18


def test_a_full_disk_ends_it_with_what_was_written_before(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    recorder = record(start, folder, "wheel_slip")
    publisher = listener.publisher(WheelSlip, "wheel_slip")
    publish(publisher, range(100))
    wait_until(lambda: count(folder) == 100, "100 messages are recorded")
    room = (
        folder / "run_0.mcap"
    ).stat().st_size + 1000  # a limit on the file's size stands for a full disk
    resource.prlimit(recorder.pid, resource.RLIMIT_FSIZE, (room, room))
    publish(publisher, range(100, 200))
    assert recorder.wait() == 1
    assert "the disk fails" in recorder.output
    assert "Traceback" not in recorder.output
    recorded = sequences(folder)
    assert recorded == list(range(len(recorded)))
    assert 100 <= len(recorded) < 200


@pytest.mark.parametrize(
    ("parameter", "words"),
    [
        ("topcis:=[odom]", "unknown parameter topcis: did you mean topics"),
        ("fsync_interval:=0.0", "parameter fsync_interval: 0 is outside its range"),
        ("topics:=[odom, 3d]", "parameter topics: Invalid topic name"),
        ("topics:=' '", "parameter topics: no topic is named"),
    ],
)
def test_a_wrong_parameter_is_an_error_that_names_it(
    start: Starter, parameter: str, words: str
) -> None:
    recorder = start("terrain_estimator", "recorder", "--ros-args", "-p", parameter)
    assert recorder.wait() == 2
    assert words in recorder.output
    assert "Traceback" not in recorder.output


def test_an_existing_folder_is_never_overwritten(start: Starter, tmp_path: Path) -> None:
    recorder = start("terrain_estimator", "recorder", "--ros-args", "-p", f"output:={tmp_path}")
    recorder.wait_for_output(
        f"cannot configure: {tmp_path} exists already.*the node stays unconfigured"
    )
    assert recorder.interrupt() == 0


def test_an_unknown_argument_is_an_error(start: Starter) -> None:
    recorder = start("terrain_estimator", "recorder", "--output", "run")
    assert recorder.wait() == 2
    assert "unknown argument '--output'" in recorder.output


def test_help_lists_every_parameter(start: Starter) -> None:
    recorder = start("terrain_estimator", "recorder", "--help")
    assert recorder.wait() == 0
    assert all(
        f"  {name} (default " in recorder.output for name in ("output", "topics", "fsync_interval")
    )


@pytest.mark.parametrize(
    "arguments", [("--params-file", "missing.yaml"), ("-p", "output"), ("-r", "__ns:=rover1/")]
)
def test_ros_arguments_that_cannot_be_parsed_are_an_error_and_no_traceback(
    start: Starter, arguments: tuple[str, str]
) -> None:
    recorder = start("terrain_estimator", "recorder", "--ros-args", *arguments)
    assert recorder.wait() == 2
    assert f"'{' '.join(arguments)}'" in recorder.output
    assert "Traceback" not in recorder.output
