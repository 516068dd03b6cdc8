# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Memory of the onboard nodes: in one process, and in one each."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import psutil
from domain_coordinator import domain_id as reserve_domain_id

from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.live import START_S, WARM_UP, MessageSender, sets
from terrain_estimator.nodes.onboard import NODES
from tests.system.processes import Process, Starter

COMPOSED_MB = 160.0
SECONDS, RATE_HZ = 20.0, 10.0


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the resident memory of the composed set, beside that of processes of their own."""
    seconds = effort.seconds(SECONDS, least=3.0)
    yield BenchmarkLine(
        f"{', '.join(NODES)} in one process at 10 Hz: resident memory",
        resident_mb(seconds, together=True),
        "MB",
        COMPOSED_MB,
        reference="the same nodes in a process each",
        against=resident_mb(seconds, together=False),
    )


def resident_mb(seconds: float, *, together: bool) -> float:
    """Return the memory [MB] of all nodes after a drive."""
    with (
        tempfile.TemporaryDirectory() as folder,
        reserve_domain_id() as domain_id,
        Starter(Path(folder), domain_id) as start,
    ):
        # its slip comes from the odometry, and is not that of the rover
        own = {
            "slip_source": [
                *("-r", "velocity:=odom", "-r", "wheel_slip:=own_slip"),
                *("-p", "rover:=mars_rover"),
            ],
            "recorder": ["-p", f"output:={folder}/bag"],
        }
        words = {name: ["--ros-args", *own.get(name, [])] for name in NODES}
        processes: list[Process] = []
        if together:
            arguments = [word for name, each in words.items() for word in (name, *each)]
            processes.append(start("terrain_estimator", "onboard", *arguments))
            processes[0].wait_for_output("estimator.*ready", START_S)
        else:
            for name, each in words.items():
                processes.append(start("terrain_estimator", name, *each))
                processes[-1].wait_for_output("ready|waiting for", START_S)
        with MessageSender(domain_id) as rover:
            rover.meet()
            steps = round(seconds * RATE_HZ)
            rover.drive(sets(WARM_UP + steps), WARM_UP + steps, RATE_HZ)
            total = sum(psutil.Process(one.pid).memory_info().rss for one in processes)
        for process in processes:
            process.interrupt()
        return total / 1e6
