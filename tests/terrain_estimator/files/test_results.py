# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Folders of results: nothing foreign is replaced, followed or removed; the old goes last."""

import errno
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from terrain_estimator.files.atomic import OutputError
from terrain_estimator.files.results import MANIFEST, ResultFolder, check_new, new_folder, write_new


def write(folder: Path, text: str, *names: str, renewed: tuple[str, ...] = ()) -> None:
    with ResultFolder(folder).renewing(*(renewed or names)) as new:
        for name in names:
            path = new / name
            if path.suffix:
                path.write_text(text)
            else:
                path.mkdir()
                (path / f"{text}.mcap").write_text(text)


def tree(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): (
            f"-> {path.readlink()}"
            if path.is_symlink()
            else "folder"
            if path.is_dir()
            else path.read_text()
        )
        for path in sorted(folder.rglob("*"))
        if path.name != MANIFEST
    }


def test_new_results_take_the_place_of_old_ones(tmp_path: Path) -> None:
    out = tmp_path / "a/b"
    write(out, "old", "bag", "report.html", "model.pt")
    (out / "notes.txt").write_text("the user's")
    write(out, "new", "bag", "report.html", renewed=("bag", "report.html", "model.pt"))
    assert tree(out) == {
        "bag": "folder",
        "bag/new.mcap": "new",
        "report.html": "new",
        "notes.txt": "the user's",
    }
    listed = json.loads((out / MANIFEST).read_text())["files"]
    assert {"bag/new.mcap", "report.html"} < set(listed)
    assert not {"notes.txt", MANIFEST} & set(listed)


def test_several_commands_share_a_folder(tmp_path: Path) -> None:
    write(tmp_path / "out", "one", "one.json")
    write(tmp_path / "out", "two", "two.json")
    write(tmp_path / "out", "again", "one.json")
    assert tree(tmp_path / "out") == {"one.json": "again", "two.json": "two"}


def replace_by_link(path: Path, target: str) -> None:
    path.rename(path.with_name("moved"))
    add_link(path, target)


def add_link(path: Path, target: str) -> None:
    path.symlink_to(target)


SPOILS: dict[str, tuple[Callable[[Path], Any], str]] = {
    "changed": (lambda out: (out / "bag/old.mcap").write_text("mine"), "bag/old.mcap: has changed"),
    "added": (lambda out: (out / "bag/notes").write_text("mine"), "bag/notes: was not written"),
    "link for a file": (
        lambda out: replace_by_link(out / "a.json", "../victim/own"),
        "a.json: has changed",
    ),
    "link for a folder": (
        lambda out: replace_by_link(out / "bag", "../victim"),
        "bag: was not written",
    ),
    "link inside": (lambda out: add_link(out / "bag/x", "../../victim"), "bag/x: was not"),
    "a recording of that name": (
        lambda out: (out / "bag/old.mcap").rename(out / "bag/bag_0.mcap"),
        "bag/bag_0.mcap: was not written",
    ),
    "list removed": (lambda out: (out / MANIFEST).unlink(), "holds a.json and no manifest.json"),
    "list damaged": (lambda out: (out / MANIFEST).write_text('{"files": ['), "or is damaged"),
    "list of another": (lambda out: (out / MANIFEST).write_text('{"name": "app"}'), "is no list"),
    "list nested": (lambda out: (out / MANIFEST).write_text("[" * 100_000), "is no list"),
    "list a link": (
        lambda out: replace_by_link(out / MANIFEST, "moved"),
        "is no list",
    ),
}


@pytest.mark.parametrize("spoil", SPOILS)
def test_what_is_not_as_we_wrote_it_is_refused_by_name_before_any_work(
    tmp_path: Path, spoil: str
) -> None:
    out, victim, (change, words) = tmp_path / "out", tmp_path / "victim", SPOILS[spoil]
    victim.mkdir()
    (victim / "own").write_text("foreign")
    write(out, "old", "bag", "a.json")
    change(out)
    before = tree(tmp_path)
    with pytest.raises(OutputError, match=words):
        write(out, "", "bag", "a.json")
    assert tree(tmp_path) == before


@pytest.mark.parametrize("kind", ["link", "dangling link", "file", "full"])
def test_a_folder_that_is_not_ours_is_refused_when_it_is_named(tmp_path: Path, kind: str) -> None:
    out, victim = tmp_path / "out", tmp_path / "victim"
    if kind == "file":
        out.write_text("foreign")
    elif kind == "full":
        out.mkdir()
        (out / "photo.jpg").write_text("foreign")
    else:
        out.symlink_to(victim)
    if kind == "link":
        victim.mkdir()
    before = tree(tmp_path)
    with pytest.raises(OutputError, match=f"{out}: (is a|holds photo.jpg)"):
        ResultFolder(out)
    assert tree(tmp_path) == before


def test_a_list_that_leads_out_of_its_folder_removes_nothing_there(tmp_path: Path) -> None:
    (tmp_path / "own").write_text("foreign")
    write(tmp_path / "out", "old", "a.json")
    content = json.loads((tmp_path / "out" / MANIFEST).read_text())
    content["files"] |= {"../own": content["files"]["a.json"], "/etc/hosts": ["00"]}
    (tmp_path / "out" / MANIFEST).write_text(json.dumps(content))
    write(tmp_path / "out", "new", "a.json")
    assert tree(tmp_path)["own"] == "foreign"


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_after_an_exception_the_old_results_are_there_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    out = tmp_path / "out"
    write(out, "old", "bag", "a.json")
    before = tree(tmp_path)

    def stopped(folder: Path) -> None:
        with ResultFolder(folder).renewing("bag", "a.json") as new:
            (new / "a.json").write_text("half")
            raise error

    for folder in (out, tmp_path / "fresh/folder"):
        with pytest.raises(error):
            stopped(folder)
        assert tree(tmp_path) == before


def test_the_logs_of_a_failure_are_kept_on_request(tmp_path: Path) -> None:
    def fail() -> None:
        with ResultFolder(tmp_path / "out").renewing("log.txt", despite=ValueError) as new:
            (new / "log.txt").write_text("why")
            raise ValueError("why")

    with pytest.raises(ValueError, match="why"):
        fail()
    assert tree(tmp_path / "out") == {"log.txt": "why"}


@pytest.mark.parametrize("at", range(5))
def test_a_move_that_fails_is_undone(
    tmp_path: Path, at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The moves that put results in their places, each failing in turn as a broken disk would."""
    out, moves, rename = tmp_path / "out", iter(range(100)), Path.rename
    write(out, "old", "bag", "a.json", "model.pt")
    before = tree(out)

    def failing(self: Path, target: Path) -> Path:
        if next(moves) == at:
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(self))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", failing)
    try:
        write(out, "new", "bag", "a.json", renewed=("bag", "a.json", "model.pt"))
    except OSError:
        assert at < 4
        assert tree(out) == before
    else:
        assert at >= 4
        assert tree(out) == {"bag": "folder", "bag/new.mcap": "new", "a.json": "new"}
    monkeypatch.undo()
    write(out, "last", "bag", "a.json")
    assert tree(out)["a.json"] == "last"


def test_a_link_among_results_is_never_taken_for_ours(tmp_path: Path) -> None:
    for _ in range(2):
        with ResultFolder(tmp_path / "out").renewing("a.json") as new:
            (new / "a.json").symlink_to("/etc/hosts")
        with pytest.raises(OutputError, match=r"a\.json: has changed since"):
            write(tmp_path / "out", "new", "a.json")
        (tmp_path / "out/a.json").unlink()
    with pytest.raises(OutputError, match="is the list of results"):
        write(tmp_path / "out", "new", MANIFEST)


def test_results_of_a_killed_command_do_not_make_a_folder_foreign(tmp_path: Path) -> None:
    (tmp_path / "out/.results.12ab.unfinished").mkdir(parents=True)
    write(tmp_path / "out", "new", "a.json")
    assert tree(tmp_path / "out") == {".results.12ab.unfinished": "folder", "a.json": "new"}


def test_a_new_folder_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "bags/run"
    with new_folder(path) as place:
        assert place.name == "run"
        place.mkdir()
        (place / "run_0.mcap").write_text("data")
        assert not path.exists()
    assert tree(tmp_path) == {"bags": "folder", "bags/run": "folder", "bags/run/run_0.mcap": "data"}
    with pytest.raises(OutputError, match=f"{path} exists already"), new_folder(path):
        pass


def test_a_failed_folder_leaves_nothing(tmp_path: Path) -> None:
    def fail(error: OSError) -> None:
        with new_folder(tmp_path / "bags/run") as place:
            place.mkdir()
            raise error

    with pytest.raises(
        OutputError, match=r"bags/run: cannot be written \(No space left on device\)"
    ):
        fail(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    with pytest.raises(FileNotFoundError, match=r"data\.csv"):
        fail(FileNotFoundError(errno.ENOENT, "No such file", "data.csv"))
    assert not tree(tmp_path)


def test_a_lone_file_is_written_only_where_nothing_is(tmp_path: Path) -> None:
    path = tmp_path / "pages/report.html"
    write_new(path, "one")
    assert path.read_text() == "one"
    for taken in (path, tmp_path / "link"):
        if taken != path:
            taken.symlink_to(tmp_path / "nowhere")
        with pytest.raises(OutputError, match=f"{taken} exists already"):
            write_new(taken, "two")
    assert tree(tmp_path)["pages/report.html"] == "one"
    check_new(tmp_path / "another")
