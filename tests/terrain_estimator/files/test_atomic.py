# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One file: whole or not at all, on real file systems."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from terrain_estimator.files.atomic import OutputError, replacing, unforeseeable, write_file

ROOM = 4096
WRITER = (
    "import resource, sys; from pathlib import Path;"
    "from terrain_estimator.files.atomic import OutputError, write_file;"
    f"resource.setrlimit(resource.RLIMIT_FSIZE, ({ROOM}, {ROOM}))\n"
    "try: write_file(Path(sys.argv[1]), 'x' * 100_000)\n"
    "except OutputError as error: sys.exit(str(error))"
)
KILLED = (
    "import os, signal, sys; from pathlib import Path;"
    "from terrain_estimator.files.atomic import replacing\n"
    "with replacing(Path(sys.argv[1])) as file:\n"
    "    file.write(b'half'); file.flush(); os.kill(os.getpid(), signal.SIGKILL)"
)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_and_keeps_its_permissions(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_file(path, "old")
    path.chmod(0o640)
    write_file(path, "né")
    assert path.read_text(encoding="utf-8") == "né"
    assert path.stat().st_mode & 0o777 == 0o640
    assert names(tmp_path) == ["a.json"]


def test_a_new_file_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "usual").write_text("")
    write_file(tmp_path / "ours", b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "usual").stat().st_mode


@pytest.mark.parametrize("before", ["", "the old one"])
def test_a_full_disk_leaves_no_truncated_file(tmp_path: Path, before: str) -> None:
    path = tmp_path / "report.html"
    if before:
        path.write_text(before)
    done = subprocess.run(
        [sys.executable, "-c", WRITER, str(path)], check=False, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert f"{path}: cannot be written ({os.strerror(errno.EFBIG)})" in done.stderr
    assert (path.read_text() if path.exists() else "") == before
    assert len(names(tmp_path)) == bool(before)


def test_a_kill_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "state"
    path.write_text("old")
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    assert killed.returncode < 0
    assert path.read_text() == "old"


def test_an_exception_leaves_the_old_file_alone(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "a"
    (tmp_path / "empty").mkdir()
    path.parent.mkdir()
    path.write_text("old")
    descriptors = len(names(Path("/proc/self/fd")))
    with pytest.raises(ZeroDivisionError), replacing(path) as file:
        file.write(bytes([1 // len(names(tmp_path / "empty"))]))
    assert path.read_text() == "old"
    assert names(path.parent) == ["a"]
    assert len(names(Path("/proc/self/fd"))) == descriptors


def test_an_error_that_names_another_file_is_no_error_of_ours(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="elsewhere"), replacing(tmp_path / "a") as file:
        file.write(Path("/elsewhere").read_bytes())
    assert not names(tmp_path)


@pytest.mark.parametrize("kind", ["link", "dangling link", "folder", "pipe"])
def test_what_is_no_file_is_refused_and_left_alone(tmp_path: Path, kind: str) -> None:
    path, victim = tmp_path / "a", tmp_path / "victim"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(victim)
    if kind == "link":
        victim.write_text("foreign")
    before = names(tmp_path)
    with pytest.raises(OutputError, match=f"{path}: is a"):
        write_file(path, "new")
    assert names(tmp_path) == before
    assert not victim.exists() or victim.read_text() == "foreign"


def test_nothing_that_waits_under_a_foreseen_name_is_followed(tmp_path: Path) -> None:
    """The attack: links under the names that earlier versions wrote to first."""
    victim = tmp_path / "victim"
    victim.write_text("foreign")
    for name in (".a.new", "a.new", ".a.unfinished", "a.unfinished"):
        (tmp_path / name).symlink_to(victim)
    write_file(tmp_path / "a", "new")
    assert victim.read_text() == "foreign"
    assert (tmp_path / "a").read_text() == "new"


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    path = tmp_path / "no" / "a"
    with pytest.raises(OutputError, match=rf"{path}: cannot be written \(No such file") as caught:
        write_file(path, "new")
    assert caught.value.errno == errno.ENOENT


def test_long_names_leave_room_for_the_random_part(tmp_path: Path) -> None:
    name = "é" * 127
    write_file(tmp_path / name, "new")
    assert names(tmp_path) == [name]
    assert len({unforeseeable(name) for _ in range(100)}) == 100
