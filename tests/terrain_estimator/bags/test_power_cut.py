# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""State of a recording after a power cut: all older than the recorder's interval is left.

No disk can be cut off here, so one is modelled at its worst: a file holds after the cut what it
held when its last fsync began, under the names that its folder had when the folder was synced last.
What was only written, or only renamed, is gone.
"""

import os
import stat
import threading
import time
from pathlib import Path

import pytest

from terrain_estimator.bags import BagReader, BagWriter, Split
from tests.system.waiting import wait_until
from tests.terrain_estimator.bags.support import SLIP, TYPES

INTERVAL_S = 0.05
CUTS = 12


class Disk:
    """Stand-in for ``os.fsync``."""

    def __init__(self) -> None:
        self.delay_s = 0.0
        self._lock = threading.Lock()
        self._files: dict[int, bytes] = {}  # by inode
        self._folders: dict[int, dict[str, int]] = {}
        self._kept: list[int] = []  # an inode that is open is not given to another file

    def fsync(self, descriptor: int) -> None:
        status = os.fstat(descriptor)
        is_folder = stat.S_ISDIR(status.st_mode)
        names = {entry.name: entry.inode() for entry in os.scandir(descriptor)} if is_folder else {}
        content = b"" if is_folder else Path(f"/proc/self/fd/{descriptor}").read_bytes()
        time.sleep(self.delay_s)
        with self._lock:
            if is_folder:
                self._folders[status.st_ino] = names
            else:
                if status.st_ino not in self._files:
                    self._kept.append(os.dup(descriptor))
                self._files[status.st_ino] = content

    def cut(self, folder: Path, left: Path) -> Path:
        """Write what a power cut would leave of a folder."""
        left.mkdir()
        with self._lock:
            assert folder.name in self._folders[folder.parent.stat().st_ino], (
                "the bag itself has no name yet"
            )
            for name, inode in self._folders.get(folder.stat().st_ino, {}).items():
                (left / name).write_bytes(self._files.get(inode, b""))
        return left

    def close(self) -> None:
        for descriptor in self._kept:
            os.close(descriptor)


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk()
    monkeypatch.setattr("os.fsync", disk.fsync)
    return disk


def readable(folder: Path) -> set[int]:
    """Return the log times of the messages that a cut left."""
    if not any(file.stat().st_size for file in folder.glob("*.mcap")):
        return set()
    with BagReader(folder) as reader:
        return {message.log_time_ns for message in reader.messages()}


@pytest.mark.parametrize(
    "delay_s", [0.0, 0.1], ids=["a fast disk", "an fsync that takes longer than the interval"]
)
def test_a_power_cut_costs_no_more_than_the_recorder_says(
    tmp_path: Path, disk: Disk, delay_s: float
) -> None:
    disk.delay_s = delay_s
    folder = tmp_path / "run"
    bag = BagWriter(folder, recording=True, sync_interval_s=INTERVAL_S, split=Split(size=20_000))
    topic = bag.add_topic(SLIP, TYPES[SLIP])
    data = bag.types.serialize(bag.types.make(TYPES[SLIP]))
    written_ns: dict[int, int] = {}  # when a message was with the operating system, by its log time
    saved = cuts = 0
    late_s = []
    while cuts < CUTS:
        now_ns = time.monotonic_ns()
        if len(written_ns) > 40 * (cuts + 1):
            late_s.append(bag.late_s)
            sure_ns = now_ns - round((INTERVAL_S + late_s[-1]) * 1e9)
            left = readable(disk.cut(folder, tmp_path / f"cut{cuts}"))
            lost = [
                log_time
                for log_time, at_ns in written_ns.items()
                if at_ns < sure_ns and log_time not in left
            ]
            assert not lost, (
                f"{len(lost)} messages, the oldest {(now_ns - lost[0]) * 1e-6:.0f} ms old,"
                f" {late_s[-1] * 1e3:.0f} ms late"
            )
            saved, cuts = max(saved, len(left)), cuts + 1
        bag.write(topic, data, now_ns)
        written_ns[now_ns] = time.monotonic_ns()
        time.sleep(0.001)
    assert saved > 0, "something was on the disk"
    assert (max(late_s) > 0.0) or not delay_s, "a slow disk is noticed"
    bag.close()
    assert readable(disk.cut(folder, tmp_path / "end")) == set(written_ns), (
        "after a clean close nothing can be lost"
    )
    disk.close()


def test_a_file_that_is_deleted_while_it_is_recorded_is_an_error(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run", recording=True, sync_interval_s=0.01)
    topic = bag.add_topic(SLIP, TYPES[SLIP])
    data = bag.types.serialize(bag.types.make(TYPES[SLIP]))
    bag.path.unlink()

    def refused() -> str:
        try:
            bag.write(topic, data, 1)
        except OSError as error:
            return str(error)
        return ""

    assert "the file was deleted while it was written" in wait_until(
        refused, "the deletion is noticed"
    )
    bag.abandon()
