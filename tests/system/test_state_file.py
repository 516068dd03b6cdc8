# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The thread that keeps the state on the disk outlives what goes wrong there."""

import os
import stat
import threading
from pathlib import Path

import pytest
from rclpy.logging import get_logger

from terrain_estimator.config.estimator import CoreConfig, EstimatorConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.estimator.saved_state import StateFileError, pack_state
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.nodes.common import state_file


def test_whatever_a_write_raises_is_said_once_and_the_next_state_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    errors = [OSError(28, "No space left on device"), ValueError("embedded null byte"), None]
    written: list[bytes] = []
    said: list[str] = []

    def write(_: Path, content: bytes) -> None:
        if error := errors.pop(0):
            raise error
        written.append(content)

    monkeypatch.setattr(state_file, "write_file", write)
    writer = state_file.StateFileWriter(tmp_path / "state", said.append)
    for words in ("No space left on device", "embedded null byte"):
        with pytest.raises((OSError, ValueError), match=words):
            writer.write(b"state").result(20.0)
        assert words in writer.judge().text
        assert writer.judge().value > 0.0
    writer.write(b"state").result(20.0)
    assert writer.judge().value == 0.0
    writer.close()
    assert written == [b"state"]
    assert len(said) == 1
    assert "No space left on device; trying on" in said[0]


def test_a_disk_that_hangs_is_reported_and_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, answers, written, said = threading.Event(), threading.Event(), list[bytes](), list[str]()

    def write(_: Path, content: bytes) -> None:
        hangs.set()
        assert answers.wait(60.0)
        written.append(content)

    monkeypatch.setattr(state_file, "write_file", write)
    writer = state_file.StateFileWriter(tmp_path / "state", said.append)
    first = writer.write(b"first")
    assert hangs.wait(20.0)
    assert writer.judge().value > 0.0
    assert "state yet: the disk is writing" in writer.judge().text
    second, third = writer.write(b"second"), writer.write(b"third")
    assert second is third, "the newer state is in the place of the one that waited"
    writer.close(0.01)
    (line,) = said
    assert line == (
        f"the disk has not written the state to {tmp_path / 'state'} within 0.01 s: it is left with"
        " the one of before"
    )
    answers.set()
    for each in (first, third):
        each.result(20.0)
    assert written == [b"first", b"third"]
    assert writer.judge().value == 0.0


def test_a_state_is_on_the_disk_by_its_name_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[tuple[Path, bytes]] = []

    def sync(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            folder = Path(f"/proc/self/fd/{descriptor}").readlink()
            synced.append((folder, (folder / "state").read_bytes()))

    monkeypatch.setattr(os, "fsync", sync)
    writer = state_file.StateFileWriter(tmp_path / "state", pytest.fail)
    writer.write(b"content").result(20.0)
    writer.close()
    assert synced == [(tmp_path, b"content")]


def test_a_state_file_has_one_writer_until_all_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, answers = threading.Event(), threading.Event()

    def write(*_: object) -> None:
        hangs.set()
        assert answers.wait(60.0)

    monkeypatch.setattr(state_file, "write_file", write)
    first = state_file.StateFileWriter(tmp_path / "state", lambda _: None)
    state_file.StateFileWriter(tmp_path / "other", pytest.fail).close()
    first.write(b"state")
    assert hangs.wait(20.0)
    first.close(0.01)
    with pytest.raises(
        StateFileError,
        match="state: another estimator keeps its state there: name a file of its own",
    ):
        state_file.StateFileWriter(tmp_path / "state", pytest.fail)
    answers.set()
    first.close()
    state_file.StateFileWriter(tmp_path / "state", pytest.fail).close()


def test_where_there_is_no_lock_the_writing_says_what_is_wrong(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    writer = state_file.StateFileWriter(tmp_path / "none" / "state", said.append)
    with pytest.raises(OSError, match="No such file or directory"):
        writer.write(b"state").result(20.0)
    writer.close()
    assert len(said) == 1

    def unsupported(*_: object) -> None:
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr("fcntl.flock", unsupported)
    writer = state_file.StateFileWriter(tmp_path / "state", pytest.fail)
    writer.write(b"state").result(20.0)
    writer.close()
    assert (tmp_path / "state").read_bytes() == b"state"


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    """Return a file that links beside a state file point to."""
    (tmp_path / "kept").mkdir()
    (tmp_path / "victim").write_bytes(b"precious")
    return tmp_path / "victim"


@pytest.mark.parametrize("name", ["state.loaded", ".state.new"])
def test_a_link_beside_the_state_file_is_not_followed(victim: Path, name: str) -> None:
    """Each of them was opened for writing, and the file that it points to was emptied."""
    path, model = victim.with_name("kept") / "state", load_model()
    path.with_name(name).symlink_to(victim)
    content = pack_state(Estimator(model, CoreConfig()).save(), model.sha256)
    writer = state_file.StateFileWriter(path, pytest.fail)
    writer.write(content).result(20.0)
    writer.close()
    assert state_file.restore(Pipeline(model, EstimatorConfig()), path, get_logger("test"))
    assert (path.read_bytes(), victim.read_bytes()) == (content, b"precious")


def test_a_link_in_the_place_of_the_lock_is_refused(victim: Path) -> None:
    lock = victim.with_name("kept") / ".state.lock"
    lock.symlink_to(victim)
    with pytest.raises(StateFileError, match=r"\.state\.lock is a symbolic link: remove it"):
        state_file.StateFileWriter(lock.with_name("state"), pytest.fail)
    assert victim.read_bytes() == b"precious"


def test_a_state_file_that_is_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "state").symlink_to(tmp_path / "other")
    with pytest.raises(StateFileError, match=r"state is a symbolic link, which is not followed"):
        state_file.check_state_path(tmp_path / "state")


def test_a_write_that_could_not_begin_does_not_stop_the_next_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A state that was never taken from its place kept all later ones from being written."""
    writer = state_file.StateFileWriter(tmp_path / "state", pytest.fail)
    write = writer._write

    def no_memory() -> None:
        raise MemoryError

    monkeypatch.setattr(writer, "_write", no_memory)
    with pytest.raises(MemoryError):
        writer.write(b"first").result(20.0)
    monkeypatch.setattr(writer, "_write", write)
    writer.write(b"second").result(20.0)
    writer.close()
    assert (tmp_path / "state").read_bytes() == b"second"
