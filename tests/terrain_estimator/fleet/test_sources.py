# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bags are found in folders as replay takes them, one folder after the other."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest
from fsspec.implementations.local import LocalFileSystem

from terrain_estimator.fleet.sources import FleetError, FoundBag, find_bags, full_name


def fill(folder: Path, *names: str) -> None:
    for number, name in enumerate(names, start=1):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x" * number)


def found(source: object) -> list[FoundBag]:
    troubles: list[str] = []
    bags = list(find_bags(str(source), troubles.append))
    assert not troubles
    return bags


def test_a_bag_is_a_folder_with_metadata_a_killed_recording_or_a_bare_file(tmp_path: Path) -> None:
    fill(
        tmp_path,
        "monday/hills/metadata.yaml",
        "monday/hills/hills_0.mcap",
        "monday/hills/hills_10.mcap",
        "monday/hills/hills_2.mcap",
        "killed/killed_0.mcap",
        "bare/one.mcap",
        "bare/two.mcap",
        "bare/notes.txt",
        ".hidden/three.mcap",
        "bare/.four.mcap.unfinished",
    )
    assert found(tmp_path) == [
        FoundBag(f"{tmp_path}/bare/one.mcap", (), 6),
        FoundBag(f"{tmp_path}/bare/two.mcap", (), 7),
        FoundBag(f"{tmp_path}/killed", ("killed_0.mcap",), 5),
        FoundBag(
            f"{tmp_path}/monday/hills",
            ("metadata.yaml", "hills_0.mcap", "hills_2.mcap", "hills_10.mcap"),
            9,
        ),
    ]
    assert [bag.name for bag in found(tmp_path / "bare/one.mcap")] == [f"{tmp_path}/bare/one.mcap"]
    assert found(tmp_path / "monday/hills")[0].storage[2] == "hills_10.mcap"


def test_a_folder_is_listed_only_when_its_bags_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(tmp_path, *(f"{letter}/run.mcap" for letter in "abc"))
    listed, real = [], LocalFileSystem.ls

    def ls(self: Any, path: str, *arguments: Any, **options: Any) -> Any:
        listed.append(Path(path).name)
        return real(self, path, *arguments, **options)

    monkeypatch.setattr(LocalFileSystem, "ls", ls)
    bags: Iterator[FoundBag] = find_bags(str(tmp_path), print)
    next(bags)
    assert listed == [tmp_path.name, "a"]
    assert len(list(bags)) == 2


def test_links_to_folders_are_passed_over_and_end_no_search(tmp_path: Path) -> None:
    fill(tmp_path, "a/run.mcap")
    (tmp_path / "a/loop").symlink_to(tmp_path)
    (tmp_path / "a/again.mcap").symlink_to(tmp_path / "a/run.mcap")
    assert [Path(bag.name).name for bag in found(tmp_path)] == ["again.mcap", "run.mcap"]


def test_a_folder_that_cannot_be_listed_is_named_and_the_others_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(tmp_path, "a/run.mcap", "b/run.mcap")
    real = os.scandir

    def scandir(path: str) -> Any:
        if path == f"{tmp_path}/a":
            raise PermissionError(13, "Permission denied", path)
        return real(path)

    monkeypatch.setattr(os, "scandir", scandir)
    troubles: list[str] = []
    bags = list(find_bags(str(tmp_path), troubles.append))
    assert [bag.name for bag in bags] == [f"{tmp_path}/b/run.mcap"]
    assert troubles == [f"{tmp_path}/a: Permission denied: its bags are left out"]


def test_a_name_that_is_no_text_is_reported(tmp_path: Path) -> None:
    fill(tmp_path, os.fsdecode(b"bad\xff.mcap"), "good.mcap")
    troubles: list[str] = []
    bags = list(find_bags(str(tmp_path), troubles.append))
    assert [bag.name for bag in bags] == [f"{tmp_path}/good.mcap"]
    assert "bad\\udcff.mcap" in troubles[0]


def test_other_stores_are_named_by_their_addresses() -> None:
    store = fsspec.filesystem("memory")
    store.pipe({"/fleet/deep/run.mcap": b"123", "/fleet/drive/metadata.yaml": b"1"})
    assert found("memory://fleet") == [
        FoundBag("memory:///fleet/deep/run.mcap", (), 3),
        FoundBag("memory:///fleet/drive", ("metadata.yaml",), 0),
    ]


def test_a_source_that_is_not_there_is_an_error_that_names_it(tmp_path: Path) -> None:
    for source in (str(tmp_path / "nothing"), "nosuchstore://bucket"):
        with pytest.raises(FleetError, match=r"nothing|nosuchstore"):
            found(source)
    assert full_name("a/b") == f"{Path.cwd()}/a/b"
