# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A fleet whose client, worker and scheduler are killed ends with the same tables.

Nothing that was finished is replayed again.
"""

import shutil
import signal
import sqlite3
import subprocess
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from terrain_estimator.fleet.work import AHEAD
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


def stored(out: Path, scratch: Path) -> set[str]:
    """Return the names of the bags whose results a running client has on the disk.

    The client has its journal to itself, so a copy is read: what a kill would leave.
    """
    copy = scratch / "copy"
    copy.mkdir(exist_ok=True)
    for name in ("journal.sqlite", "journal.sqlite-wal"):
        if not (out / name).exists():
            return set()
        shutil.copyfile(out / name, copy / name)
    (copy / "journal.sqlite-shm").unlink(missing_ok=True)
    try:
        return finished(copy)
    except sqlite3.DatabaseError:  # its tables are not there yet, or the copy is torn
        return set()


def test_kills_of_client_worker_and_scheduler_cost_only_what_was_under_way(tmp_path: Path) -> None:
    write_bags(tmp_path / "bags", BAGS)
    out = tmp_path / "out"
    with Processes() as processes:
        cluster = Cluster(processes, tmp_path)
        workers = [cluster.start_worker() for _ in range(2)]

        def start_client(out: Path = out) -> subprocess.Popen[str]:
            command = ("replay", tmp_path / "bags", "--scheduler", cluster.address, "--out", out)
            return processes.start("terrain_estimator.cli.fleet", *command)

        def wait_for_results(count: int, ended: Callable[[], int]) -> None:
            def happened() -> bool:
                assert client.poll() is None, client.communicate()[0]
                return ended() >= count

            wait_for(happened, f"replay of {count} bags")

        def replayed() -> int:
            return cluster.count("end").total()

        client = start_client()
        # a worker has ended a bag some time before the client has its result
        wait_for_results(FEW, lambda: len(stored(out, tmp_path)))
        kill(client)
        known = finished(out)
        assert known
        before = cluster.count("begin")

        client = start_client()
        wait_for_results(2 * FEW + 1, replayed)
        kill(workers[0])
        wait_for_results(3 * FEW + 1, replayed)
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
        # what is under way at a kill may be begun again: on both workers at that of the client and
        # of the scheduler, on one at its own
        begun = cluster.count("begin")
        assert len(begun) == BAGS
        assert begun.total() - BAGS <= (2 + 1 + 2) * AHEAD
        assert [row["outcome"] for row in rows(out)] == ["estimate"] * BAGS
        undisturbed = tmp_path / "undisturbed"
        assert start_client(undisturbed).wait(PATIENCE_S) == 0
        assert tables(undisturbed) == tables(out)
