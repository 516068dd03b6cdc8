# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bags in an object store: a real S3 server, whose bags are brought to the worker and removed."""

import dataclasses
import json
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import fsspec
import pytest

from terrain_estimator.cli import find_missing_effect
from terrain_estimator.cli.fleet import main
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.fleet import bringing, task
from terrain_estimator.fleet.sources import find_bags
from terrain_estimator.fleet.task import BagResult, Failure, Settings, replayed
from terrain_estimator.offline.replay import estimate
from terrain_estimator.offline.topic_mapping import bag_topics
from tests.hidden.cases import Plan, draw_cases
from tests.hidden.sealing import seal
from tests.terrain_estimator.fleet.fleets import (
    Processes,
    free_port,
    rows,
    wait_for,
    write_bags,
)

SOURCE = "s3://rovers/fleet"


@pytest.fixture(scope="module")
def store() -> Iterator[fsspec.AbstractFileSystem]:
    port = free_port()
    address = f"http://127.0.0.1:{port}"
    with Processes() as processes, pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", address)
        patch.setenv("AWS_ACCESS_KEY_ID", "tests")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "tests")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        processes.start("moto.server", "-H", "127.0.0.1", "-p", str(port))

        def answers() -> bool:
            try:
                with urlopen(f"{address}/moto-api/", timeout=1.0) as answer:
                    return bool(answer.status == 200)
            except (URLError, OSError):
                return False

        wait_for(answers, "the start of the S3 server")
        yield fsspec.filesystem("s3", skip_instance_cache=True)


@pytest.fixture(scope="module")
def bags(store: fsspec.AbstractFileSystem, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of three bags, two of them equal, and of a file that is none.

    The bucket has the same.
    """
    folder = tmp_path_factory.mktemp("bags")
    shutil.copytree(write_bags(folder, 2)[0], folder / "deep/er/again")
    (folder / "deep/broken.mcap").write_bytes(b"no bag")
    store.mkdir("rovers")
    store.put(f"{folder}/", "rovers/fleet", recursive=True)
    return folder


def test_bags_in_an_object_store_are_replayed_like_those_in_a_folder(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    remote, here = tmp_path / "remote", tmp_path / "here"
    assert main(["replay", SOURCE, "--workers", "1", "--out", str(remote)]) == 2
    assert f"fleet: {SOURCE}/deep/broken.mcap is not an MCAP file" in capsys.readouterr().err
    assert main(["replay", str(bags), "--workers", "1", "--out", str(here)]) == 2

    def renamed(out: Path, place: str) -> list[dict[str, object]]:
        return [
            {name: str(value).replace(place, "") for name, value in row.items()}
            for row in rows(out)
        ]

    assert renamed(remote, SOURCE) == renamed(here, str(bags))
    assert [row["outcome"] for row in rows(remote)] == ["damaged", "estimate", "equal", "estimate"]


@pytest.mark.usefixtures("bags")
def test_what_is_brought_is_removed_again_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "others.txt").touch()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    seen = []

    def observed(bag: Path, *arguments: Any, **options: Any) -> Any:
        assert bag.is_relative_to(tmp_path)
        seen.append(sum(path.is_file() for path in tmp_path.rglob("*")))
        return estimate(bag, *arguments, **options)

    monkeypatch.setattr(task, "estimate", observed)
    config = EstimatorConfig()
    settings = Settings(config, bag_topics([], ""), load(config.model, config.runtime).model.sha256)
    found = list(find_bags(SOURCE, print))
    results = [replayed(bag, settings) for bag in found]
    assert [result.outcome for result in results if isinstance(result, BagResult)] == [
        "damaged", "estimate", "estimate", "estimate"
    ]  # fmt: skip
    assert seen == [2, 3, 3, 3]  # a bare file, or metadata.yaml and one, and the other's
    assert [path.name for path in tmp_path.iterdir()] == ["others.txt"]
    # what has gone from the store meanwhile may come back
    gone = replayed(dataclasses.replace(found[0], name=f"{SOURCE}/gone.mcap"), settings)
    assert isinstance(gone, Failure)
    assert f"{SOURCE}/gone.mcap" in gone.message


def test_bags_at_an_address_are_copied_once_and_searched_like_those_in_a_folder(
    store: fsspec.AbstractFileSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = draw_cases(Plan((("drive_drag", 1.0),), soil="loose_sand", seconds=9.0), 1, seed=5)[0]
    bags = list(seal(case, tmp_path / "sealed"))[:3]
    for bag in bags:
        store.put(f"{bag}/", f"rovers/runs/{bag.name}", recursive=True)
    here, there = tmp_path / "here", tmp_path / "there"
    library = ["--library", "drive_drag"]
    assert find_missing_effect.main([*map(str, bags), *library, "--out", str(here)]) == 0
    brought = tmp_path / "brought"
    address = [f"{SOURCE[:-6]}/runs", "--bring", str(brought)]
    assert main(["discover", *address, *library, "--out", str(there)]) == 0
    copies = sorted(path for path in brought.rglob("*") if path.is_file())
    assert len(copies) == 2 * len(bags)  # metadata.yaml and one file of messages each
    found = [json.loads((out / "finding.json").read_text()) for out in (here, there)]
    assert found[0]["verdict"] == found[1]["verdict"]

    def fail(*_: Any) -> None:
        raise AssertionError("a bag was copied again")

    monkeypatch.setattr(bringing, "copy_bag", fail)
    assert main(["discover", *address, *library, "--out", str(there)]) == 0
    copies[-1].write_bytes(b"another file")
    assert main(["discover", *address, *library, "--out", str(there)]) == 2
    assert copies[-1].read_bytes() == b"another file"


@pytest.mark.usefixtures("store")
def test_a_bucket_that_is_not_there_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", "s3://nobody", "--workers", "1", "--out", str(tmp_path / "out")]) == 2
    assert "s3://nobody" in capsys.readouterr().err
