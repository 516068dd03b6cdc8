# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Speed of a fleet on two workers beside one, and memory of client and scheduler while it grows.

python -m benchmarks.fleet COUNT FOLDER    # runs COUNT trivial tasks and prints memory, as JSON
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import psutil

from benchmarks.drives import long_drive
from benchmarks.lines import BenchmarkLine, Effort
from terrain_estimator.bags import Types
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.fleet.journal import Journal
from terrain_estimator.fleet.sources import FoundBag, find_bags
from terrain_estimator.fleet.tables import FleetTables
from terrain_estimator.fleet.task import BagResult, Settings, content_of, replayed
from terrain_estimator.fleet.work import ContentOf, Dispatch, Replayed, work
from terrain_estimator.offline.cluster import Cluster, cluster
from terrain_estimator.offline.topic_mapping import bag_topics
from tests.drives import write_bag

BAR = 1.7
"""[1] Least speed of two workers over that of one, given two cores."""
GROWTH = 1.1
"""[1] Largest ratio of the memory after many tasks to that after few."""
BAGS, SPAN_S = 16, 300.0
FEW, MANY = 1000, 10_000


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the speed of two workers, and the memory after many tasks."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write_bags(folder / "bags", effort)
        count = min(2, len(os.sched_getaffinity(0)))
        alone, both = (_bags_a_minute(folder, workers) for workers in (1, 2))
        yield BenchmarkLine(
            f"fleet on two workers, {count} cores",
            both / alone,
            "x one worker",
            BAR,
            least=True,
            reference="one worker",
            against=1.0,
            note=f"{BAGS} bags; {both:.0f} a minute, {alone:.0f} with one",
        )
        few, many = effort.count(FEW, least=50), effort.count(MANY, least=100)
        memory = _memory(folder, few, many)
    what = f"memory of client and scheduler after {many} bags"
    yield BenchmarkLine(
        what,
        memory[many],
        "MB",
        GROWTH * memory[few],
        reference=f"after {few} bags",
        against=memory[few],
        note="trivial tasks on one worker",
    )


def _write_bags(folder: Path, effort: Effort) -> None:
    """Write bags of different contents: each begins a second later in one long drive."""
    types = Types()
    events = list(long_drive(types.make, effort.seconds(SPAN_S, least=20.0)))
    for number in range(BAGS):
        write_bag(folder / f"drive_{number}", events[50 * number :], types)


def _bags_a_minute(folder: Path, workers: int) -> float:
    """Return the speed once all workers have loaded the model."""
    config = EstimatorConfig()
    settings = Settings(config, bag_topics([], ""), load("", config.runtime).model.sha256)
    replay = partial(replayed, settings=settings)
    with cluster("", workers) as on:
        first = next(find_bags(str(folder / "bags"), print))
        list(on(replay, [first] * 2 * workers))
        begun_s = time.perf_counter()
        counts = _run(on, folder / f"out_{workers}", folder / "bags", content_of, replay)
        spent_s = time.perf_counter() - begun_s
    if counts != BAGS:
        raise ChildProcessError(f"{counts} of {BAGS} bags gave an estimate")
    return 60.0 * BAGS / spent_s


def _run(on: Cluster, out: Path, bags: Path, hashes: ContentOf, replay: Replayed) -> int:
    results = ResultFolder(out)
    with results.renewing("fleet.json") as new:
        (new / "fleet.json").touch()
    with Journal(out / "journal.sqlite", {}) as journal:
        tables = FleetTables(results, journal)
        work(Dispatch(on, journal, hashes, replay), journal, tables, [str(bags)])
        tables.complete()
        return journal.counts["estimate"]


def _memory(folder: Path, few: int, many: int) -> dict[int, float]:
    """Return the memory [MB] of a process with client and scheduler after so many tasks."""
    memory = {}
    for count in (few, many):
        command = [sys.executable, "-m", "benchmarks.fleet", str(count), str(folder / str(count))]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if ended.returncode != 0:
            raise ChildProcessError(ended.stderr[-2000:])
        memory[count] = float(json.loads(ended.stdout.splitlines()[-1]))
    return memory


def trivial(bag: FoundBag) -> BagResult:
    """Return an empty result with a content of its own."""
    return BagResult(f"{bag.size:064x}", "estimate", {"tan_phi": 0.5})


def main(count: int, folder: Path) -> None:
    """List and run trivial tasks, with client and scheduler in this process."""
    for number in range(count):
        place = folder / "bags" / f"{number // 100:06d}"
        place.mkdir(parents=True, exist_ok=True)
        with (place / f"{number}.mcap").open("wb") as file:
            file.truncate(number + 1)  # sizes differ, so that nothing is hashed
    with cluster("", 1) as on:
        done = _run(on, folder / "out", folder / "bags", content_of, trivial)
        if done != count:
            raise ChildProcessError(f"{done} of {count} tasks were done")
        print(json.dumps(psutil.Process().memory_info().rss / 1e6))


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
