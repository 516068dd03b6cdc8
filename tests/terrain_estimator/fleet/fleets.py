# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings for fleets: short ones, each with a content of its own, and the tables of a fleet."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import pyarrow.parquet as pq

from terrain_estimator.bags import Types
from tests.drives import drive_messages, write_bag

PATIENCE_S = 60.0
SECONDS = 6.0
TOPICS = 5


def write_bags(folder: Path, count: int, *, first: int = 0) -> list[Path]:
    """Write bags of one drive, each of which begins a tenth of a second later than the last."""
    types = Types()
    events = list(drive_messages(types.make, SECONDS))
    return [
        write_bag(folder / f"drive_{number:03d}", events[number * TOPICS :], types)
        for number in range(first, first + count)
    ]


def rows(out: Path) -> list[dict[str, Any]]:
    table: list[dict[str, Any]] = pq.read_table(out / "bags.parquet").to_pylist()
    return table


def tables(out: Path) -> tuple[bytes, bytes]:
    return (out / "bags.parquet").read_bytes(), (out / "seconds.parquet").read_bytes()


def free_port() -> int:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        return int(server.getsockname()[1])


def wait_for(happened: Callable[[], Any], what: str) -> Any:
    """Return what ``happened`` returns once that is true."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not (found := happened()):
        assert time.monotonic() < deadline_s, f"{what} took more than {PATIENCE_S:g} s"
        time.sleep(0.02)
    return found


class Processes:
    """Processes of a test, each in a group of its own, all of which are ended with the block."""

    def __init__(self) -> None:
        self._running: list[subprocess.Popen[str]] = []

    def start(self, *arguments: str | Path, **environment: str) -> subprocess.Popen[str]:
        """Start a module of Python."""
        path = os.pathsep.join(map(str, filter(None, sys.path)))
        process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-m", *map(str, arguments)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"PYTHONPATH": path, "OMP_NUM_THREADS": "1"} | environment,
            start_new_session=True,
        )
        self._running.append(process)
        return process

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running:
            kill(process)
            if process.stdout:
                process.stdout.close()


def kill(process: subprocess.Popen[str]) -> None:
    """Kill a process and those that it started."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait(PATIENCE_S)
