# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A disk that hangs holds up neither the recorder nor its end, and gets all that it takes later."""

import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from rclpy.parameter import Parameter

from msg_defs.msg import WheelSlip
from rover_parameters.parameters import configure
from terrain_estimator.bags import BagError, BagReader
from terrain_estimator.bags.writing import writer as bag_writer
from terrain_estimator.bags.writing.part import BagPart
from terrain_estimator.config.recorder import RecorderConfig
from terrain_estimator.messaging.diagnostics import DISK
from terrain_estimator.nodes.common import bag_thread
from terrain_estimator.nodes.common.bag_thread import BagThread
from terrain_estimator.nodes.recorder import RecorderNode
from tests.system.listening import Listener
from tests.system.processes import Starter
from tests.system.waiting import wait_until

SLIP = "msg_defs/msg/WheelSlip"
SECOND_NS = 10**9
PATIENCE_S = 1.0  # which a disk that works does not take on a busy machine


class Disk:
    """Hangs in the calls that go through it, when told to."""

    def __init__(self) -> None:
        self.answers = threading.Event()
        self.answers.set()

    def through(self, call: Callable[..., object]) -> Callable[..., object]:
        def called(*arguments: object) -> object:
            assert self.answers.wait(60.0)
            return call(*arguments)

        return called


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    disk = Disk()
    monkeypatch.setattr(bag_thread, "PATIENCE_S", PATIENCE_S)
    monkeypatch.setattr("os.fsync", disk.through(os.fsync))
    yield disk
    disk.answers.set()


class Recording:
    """A bag whose every message begins a new second."""

    def __init__(self, folder: Path, **parameters: float) -> None:
        self.folder = folder
        self.thread = BagThread(
            configure(RecorderConfig, {"output": str(folder), "fsync_interval": 0.01, **parameters})
        )
        self.said: list[str] = []
        self._topic = self.thread.give(lambda: self.thread.bag.add_topic("/slip", SLIP)).result(
            20.0
        )
        self._data = self.thread.bag.types.serialize(self.thread.bag.types.make(SLIP))

    def write(self, *seconds: int) -> None:
        for second in seconds:
            self.thread.give(
                partial(self.thread.bag.write, self._topic, self._data, second * SECOND_NS),
                len(self._data),
            )

    def close(self) -> str:
        """Close the bag; return the message about what is left undone."""
        with pytest.raises(TimeoutError) as error:
            self.thread.close(self.said.append)
        return str(error.value)

    def read(self) -> tuple[bool, list[int]]:
        """Return whether the bag is finished, and its seconds."""
        with BagReader(self.folder) as reader:
            return reader.finished, [
                message.log_time_ns // SECOND_NS for message in reader.messages()
            ]

    def wait_for_the_end(self) -> None:
        [said] = wait_until(lambda: self.said, "it says that the disk has answered")
        assert said == f"{self.folder}: the disk has answered, all is written"


def test_while_nothing_is_synced_files_are_split_and_the_end_does_not_wait(
    disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bag_writer, "UNSETTLED", 3)
    recording = Recording(tmp_path / "run", **{"split.duration": 1.0})
    recording.write(0)
    disk.answers.clear()
    recording.write(*range(1, 10))
    assert recording.read() == (False, list(range(10)))
    assert len(list((tmp_path / "run").glob("*.mcap"))) <= 1 + 3 + 1, (
        "what waits for the disk does not grow for ever"
    )
    undone = recording.close()
    assert re.search(
        rf"^{recording.thread.bag.path}: .* for {PATIENCE_S:g} s: the bag is left unfinished .* is"
        r" lost if the power fails before",
        undone,
    )
    assert "memory" not in undone
    assert recording.read() == (True, list(range(10))), "every file has its footer"
    assert not (tmp_path / "run/metadata.yaml").exists()
    disk.answers.set()
    recording.wait_for_the_end()
    assert recording.read() == (True, list(range(10)))
    assert (tmp_path / "run/metadata.yaml").exists()


def test_what_cannot_be_written_waits_in_memory_up_to_a_limit(
    disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "terrain_estimator.bags.writing.part.BagPart.write", disk.through(BagPart.write)
    )
    recording = Recording(tmp_path / "run")
    recording.write(0)
    assert not recording.thread.hangs
    disk.answers.clear()
    monkeypatch.setattr(bag_thread, "MOMENT_S", 0.05)
    recording.write(1, 2, 3)
    assert bool(recording.thread.hangs)
    assert recording.thread.late_s > 0.05
    assert recording.read() == (False, [0])
    monkeypatch.setattr(bag_thread, "BACKLOG_BYTES", 10)
    with pytest.raises(BagError, match=f"{tmp_path / 'run'}: the disk hangs"):
        recording.write(4)
    assert "; 3 messages that wait in memory are lost when this process ends" in recording.close()
    disk.answers.set()
    recording.wait_for_the_end()
    assert recording.read() == (True, [0, 1, 2, 3])


def test_a_compression_that_hangs_is_left_and_one_that_takes_long_is_waited_for(
    disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(_: Path, moved: Callable[[], None]) -> None:
        begun_s = time.monotonic()
        while time.monotonic() < begun_s + 1.5 * bag_thread.PATIENCE_S:
            moved()

    def hangs(_: Path, moved: Callable[[], None]) -> None:
        disk.answers.clear()
        disk.through(moved)()

    monkeypatch.setattr(bag_writer, "compact", hangs)
    recording = Recording(tmp_path / "hangs")
    recording.write(0)
    assert recording.close().endswith("it stays uncompressed")
    assert recording.read() == (True, [0])
    disk.answers.set()
    recording.wait_for_the_end()
    monkeypatch.setattr(bag_writer, "compact", slow)
    recording = Recording(tmp_path / "slow")
    recording.write(0)
    recording.thread.close(recording.said.append)
    assert recording.read() == (True, [0])


def test_a_bag_on_a_disk_that_hangs_from_the_start_is_refused_by_name(
    disk: Disk, tmp_path: Path
) -> None:
    disk.answers.clear()
    with pytest.raises(
        TimeoutError,
        match=f"{tmp_path / 'run'}: the disk has taken nothing for {PATIENCE_S:g} s, so there is"
        " no bag",
    ):
        Recording(tmp_path / "run")
    assert (tmp_path / "run").exists()
    disk.answers.set()
    wait_until(
        lambda: not (tmp_path / "run").exists(),
        "what was begun is taken back once the disk answers",
    )
    Recording(tmp_path / "run").thread.abandon()


def test_a_node_that_cleans_up_says_what_the_disk_owes_and_later_that_it_is_written(
    disk: Disk, listener: Listener, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    values = {"output": str(tmp_path / "run"), "topics": "wheel_slip", "fsync_interval": 0.01}
    given = [Parameter(name, value=value) for name, value in values.items()]
    node = listener.host(partial(RecorderNode, threading.Event()), parameter_overrides=given)
    node.start()
    publisher = listener.publisher(WheelSlip, "wheel_slip")
    disk.answers.clear()
    for number in range(3):
        publisher.publish(WheelSlip(sequence=number))
    listener.spin_until(lambda: node.received == 3, "the messages are recorded")
    listener.spin_until(
        lambda: any(each.check is DISK and each.value > 0.0 for each in node.findings()),
        "it says that the disk is late",
    )
    node.end()
    assert (node.state, node.disk_failed) == ("unconfigured", True)
    assert (
        f"{tmp_path / 'run/run_0.mcap'}: the disk has taken nothing for {PATIENCE_S:g} s: the bag"
        " is left unfinished" in capfd.readouterr().err
    )
    disk.answers.set()
    wait_until(
        lambda: "run: the disk has answered, all is written" in capfd.readouterr().err,
        "it says that all is written",
    )
    with BagReader(tmp_path / "run") as reader:
        assert (reader.finished, reader.span.count) == (True, 3)


HANGS_ON_DEMAND = """
import os, signal, sys, threading
from terrain_estimator.nodes.common import bag_thread
from terrain_estimator.nodes import recorder
hangs, sync, bag_thread.PATIENCE_S = threading.Event(), os.fsync, 1.0
signal.signal(signal.SIGUSR1, lambda *_: hangs.set())
os.fsync = lambda file: threading.Event().wait() if hangs.is_set() else sync(file)
sys.exit(recorder.main())
"""


def test_a_recorder_ends_on_a_disk_that_never_answers(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    process = start.command(
        sys.executable, "-c", HANGS_ON_DEMAND, "--ros-args",
        "-p", f"output:={tmp_path / 'run'}", "-p", "topics:=wheel_slip",
    )  # fmt: skip
    publisher = listener.publisher(WheelSlip, "wheel_slip")
    process.wait_for_output("recording 1 topics")
    process.signal(signal.SIGUSR1)
    for number in range(5):
        publisher.publish(WheelSlip(sequence=number))
    assert publisher.wait_for_all_acked()
    assert process.terminate() == 1
    assert re.search(
        rf"{tmp_path / 'run/run_0.mcap'}: the disk has taken nothing for .* is lost if the power"
        r" fails",
        process.output,
    )
    assert "Fatal" not in process.output
    assert "Traceback" not in process.output
    with BagReader(tmp_path / "run") as reader:
        assert [reader.decode(message).sequence for message in reader.messages()] == list(range(5))
