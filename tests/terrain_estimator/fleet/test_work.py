# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Dispatch of bags: few are under way, and each content is replayed once."""

import gc
import os
import signal
import time
from collections import Counter
from functools import partial
from pathlib import Path

import pytest

from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, EstimatorConfig
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.fleet.journal import Journal
from terrain_estimator.fleet.sources import FleetError, FoundBag, find_bags
from terrain_estimator.fleet.tables import FleetTables
from terrain_estimator.fleet.task import BagResult, Failure, Settings, content_of, replayed
from terrain_estimator.fleet.work import AHEAD, Dispatch, work
from terrain_estimator.offline.cluster import cluster
from terrain_estimator.offline.topic_mapping import bag_topics
from tests.samples import LONG
from tests.terrain_estimator.fleet.fleets import rows, write_bags

WORKERS, CONTENTS, COPIES = 2, 8, 4


def write_log(bag: FoundBag, log: Path) -> BagResult | Failure:
    """Replay nothing, slowly; a bag called fails.mcap fails."""
    with log.open("a", encoding="utf-8") as file:
        file.write(f"{Path(bag.name).stem}\n")
    time.sleep(0.05)
    if Path(bag.name).stem == "fails":
        return Failure(f"{bag.name}: the disk is full")
    sha256 = content_of(bag)
    assert isinstance(sha256, str)
    return BagResult(sha256, "estimate", {"tan_phi": 0.5})


class Watched(Dispatch):
    """A dispatch that notes how many bags are under way."""

    most = 0

    def fill(self) -> None:
        super().fill()
        self.most = max(self.most, self.under_way)


def test_each_content_is_replayed_once_and_few_bags_are_under_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bags, log, out = tmp_path / "bags", tmp_path / "log", tmp_path / "out"
    for copy in range(COPIES):
        folder = bags / f"copy_{copy}"
        folder.mkdir(parents=True)
        for number in range(CONTENTS):  # all of one size
            (folder / f"{number}.mcap").write_bytes(b"%d" % number)
    (bags / "fails.mcap").write_bytes(b"fails")
    results = ResultFolder(out)
    with results.renewing("fleet.json") as new:
        (new / "fleet.json").touch()
    with Journal(out / "journal", {}) as journal, cluster("", WORKERS) as on:
        dispatch = Watched(on, journal, content_of, partial(write_log, log=log))
        tables = FleetTables(results, journal)
        assert work(dispatch, journal, tables, [str(bags)])
        assert not any((out / "bags.parquet").parent.glob("*.parquet"))
        assert len(list((out / "parts/bags.parquet").iterdir())) == 1
        tables.complete()
    names = [str(number) for number in range(CONTENTS)]
    assert Counter(log.read_text().split()) == Counter([*names, "fails"])
    assert dispatch.most == AHEAD * WORKERS
    assert Counter(row["outcome"] for row in rows(out)) == {
        "estimate": CONTENTS,
        "equal": CONTENTS * (COPIES - 1),
        "failed": 1,
    }
    assert "fails.mcap: the disk is full; the same command tries it again" in (
        capsys.readouterr().err
    )
    assert not (out / "parts").exists()


def kill_or_not(bag: FoundBag) -> BagResult | Failure:
    """End the worker at a bag called kills.mcap; replay nothing else."""
    if Path(bag.name).stem == "kills":
        os.kill(os.getpid(), signal.SIGKILL)
    return BagResult(f"{bag.size}", "estimate", {})


@pytest.mark.skipif(not LONG, reason="in make test-long: four workers are started anew")
def test_a_bag_that_ends_every_worker_fails_and_the_others_are_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for size, name in enumerate(("one", "kills", "two"), start=1):
        (tmp_path / f"{name}.mcap").write_bytes(b"x" * size)
    results = ResultFolder(tmp_path / "out")
    with results.renewing("fleet.json") as new:
        (new / "fleet.json").touch()
    with Journal(tmp_path / "out/journal", {}) as journal, cluster("", 1) as on:
        dispatch = Dispatch(on, journal, content_of, kill_or_not)
        work(dispatch, journal, FleetTables(results, journal), [str(tmp_path)])
        found = {Path(row["bag"]).stem: row["outcome"] for row in journal.rows()}
    assert found == {"kills": "failed", "one": "estimate", "two": "estimate"}
    assert "Memory is the usual cause" in capsys.readouterr().err


def test_a_worker_keeps_nothing_of_a_bag(tmp_path: Path) -> None:
    settings = Settings(EstimatorConfig(), bag_topics([], ""), load("", AUTO).model.sha256)
    write_bags(tmp_path, 4)
    bags = list(find_bags(str(tmp_path), print))

    def classes_after(bag: FoundBag) -> int:
        assert isinstance(replayed(bag, settings), BagResult)
        gc.collect()
        return sum(issubclass(type(each), type) for each in gc.get_objects())

    assert len({classes_after(bag) for bag in bags[1:]}) == 1


def test_a_worker_with_another_model_ends_the_fleet(tmp_path: Path) -> None:
    bag = FoundBag(str(tmp_path / "none.mcap"), (), 1)
    settings = Settings(EstimatorConfig(), bag_topics([], ""), load("", AUTO).model.sha256)
    assert isinstance(replayed(bag, settings), Failure)
    with pytest.raises(FleetError, match="install the same version on both"):
        replayed(bag, Settings(settings.config, settings.names, "another"))
