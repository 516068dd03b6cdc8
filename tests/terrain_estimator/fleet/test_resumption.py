# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet whose client, worker and scheduler are killed ends with the same tables.

Nothing that was finished is replayed again.
"""

import signal
import sqlite3
import subprocess
from collections import Counter
from contextlib import closing
from pathlib import Path

from tests.terrain_estimator.fleet import observed_worker as worker_module
from tests.terrain_estimator.fleet.fleets import (
    PATIENCE_S,
    Processes,
    free_port,
    kill,
    rows,
    tables,
    wait_for,
    write_bags,
)

BAGS = 10
SLOWNESS_S = 0.3
FEW = 2  # results after which something is killed


class Cluster:
    """A scheduler and workers as processes of their own; what they replay is in a file."""

    def __init__(self, processes: Processes, folder: Path) -> None:
        self.address = f"127.0.0.1:{free_port()}"
        self._processes, self._folder = processes, folder
        self._log = folder / "log"
        self._log.touch()
        self.scheduler = self.start_scheduler()

    def start_scheduler(self) -> subprocess.Popen[str]:
        port = self.address.rpartition(":")[2]
        arguments = ("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")
        self.scheduler = self._processes.start("dask", *arguments)
        return self.scheduler

    def start_worker(self) -> subprocess.Popen[str]:
        place = ("--local-directory", self._folder / "scratch", "--no-dashboard", "--no-nanny")
        observed = ("--preload", Path(worker_module.__file__))
        return self._processes.start(
            "dask", "worker", self.address, "--nthreads", "1", *place, *observed,
            FLEET_LOG=str(self._log), FLEET_SLOWNESS=str(SLOWNESS_S),
        )  # fmt: skip

    def count(self, what: str) -> Counter[str]:
        """Return how often each bag was begun or ended."""
        lines = map(str.split, self._log.read_text().splitlines())
        return Counter(name for word, name in lines if word == what)


def finished(out: Path) -> set[str]:
    """Return the names of the finished bags in the journal of a client that has ended."""
    with closing(sqlite3.connect(out / "journal.sqlite")) as base:
        return {Path(name).name for (name,) in base.execute(
            "SELECT name FROM bags WHERE outcome IS NOT NULL"
        )}  # fmt: skip


def test_kills_of_client_worker_and_scheduler_cost_only_what_was_under_way(tmp_path: Path) -> None:
    write_bags(tmp_path / "bags", BAGS)
    out = tmp_path / "out"
    with Processes() as processes:
        cluster = Cluster(processes, tmp_path)
        workers = [cluster.start_worker() for _ in range(2)]

        def start_client(out: Path = out) -> subprocess.Popen[str]:
            command = ("replay", tmp_path / "bags", "--scheduler", cluster.address, "--out", out)
            return processes.start("terrain_estimator.cli.fleet", *command)

        def wait_for_results(count: int) -> None:
            def replayed() -> bool:
                assert client.poll() is None, client.communicate()[0]
                return cluster.count("end").total() >= count

            wait_for(replayed, f"replay of {count} bags")

        client = start_client()
        wait_for_results(FEW)
        kill(client)
        known = finished(out)
        assert known
        before = cluster.count("begin")

        client = start_client()
        wait_for_results(2 * FEW + 1)
        kill(workers[0])
        wait_for_results(3 * FEW + 1)
        cluster.scheduler.send_signal(signal.SIGKILL)
        assert client.wait(PATIENCE_S) == 2
        assert client.stdout is not None
        assert "the scheduler was lost" in client.stdout.read()
        again = cluster.count("begin") - before
        assert not known & set(again)
        known = finished(out)
        assert len(known) < BAGS
        kill(workers[1])
        cluster.scheduler.wait(PATIENCE_S)
        before = cluster.count("begin")

        cluster.start_scheduler()
        workers = [cluster.start_worker() for _ in range(2)]
        client = start_client()
        assert client.wait(PATIENCE_S) == 0
        again = cluster.count("begin") - before
        assert not known & set(again)
        assert cluster.count("end").total() >= BAGS
        assert [row["outcome"] for row in rows(out)] == ["estimate"] * BAGS
        undisturbed = tmp_path / "undisturbed"
        assert start_client(undisturbed).wait(PATIENCE_S) == 0
        assert tables(undisturbed) == tables(out)
