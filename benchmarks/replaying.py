# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Speed and memory of the command ``replay`` on a short bag and on a long one."""

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

from benchmarks import reading
from benchmarks.drives import long_drive
from benchmarks.lines import BenchmarkLine, Effort
from terrain_estimator.bags import Types
from tests.drives import write_bag

BAR = 1000.0
"""[1] Times real time."""
GROWTH = 1.1
"""[1] Largest ratio of the memory of the long bag to that of the short one."""
SHORT_S, LONG_S = 600.0, 36000.0
POLL_S = 0.1
"""[s] From one look at the memory to the next."""


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the speed of both, and the memory of the long one beside that of the short one."""
    types = Types()
    spans = [effort.seconds(full, least=20.0) for full in (SHORT_S, LONG_S)]
    memory: dict[float, float] = {}
    note = f"replay takes {min(2, len(os.sched_getaffinity(0)))} processes, the reference one"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for span_s in spans:
            bag = write_bag(folder / f"drive_{span_s:g}", long_drive(types.make, span_s), types)
            begun_s = time.perf_counter()
            reading.by_rosbags(bag)
            alone = span_s / (time.perf_counter() - begun_s)
            speed, memory[span_s] = replayed(bag, folder / f"estimates_{span_s:g}")
            what = f"replay of {span_s / 60.0:g} min"
            yield BenchmarkLine(
                what,
                speed,
                "x real time",
                BAR,
                least=True,
                reference="rosbags decoding the same bag",
                against=alone,
                note=note,
            )
    short, long = (memory[span_s] for span_s in spans)
    what = f"largest memory of replaying {spans[1] / 60.0:g} min"
    yield BenchmarkLine(
        what,
        long,
        "MB",
        GROWTH * short,
        reference=f"a replay of {spans[0] / 60.0:g} min",
        against=short,
    )


def replayed(bag: Path, output: Path) -> tuple[float, float]:
    """Return the speed over real time, and the largest resident memory [MB] of either process.

    The command runs as a user starts it, so that it loads what it needs and no more.
    """
    command = [sys.executable, "-m", "terrain_estimator.cli.replay", str(bag)]
    command += ["--out", str(output)]
    log, largest = output.with_suffix(".log"), 0.0
    with log.open("w") as written:
        process = subprocess.Popen(command, stdout=written, stderr=written)  # noqa: S603
        while process.poll() is None:
            largest = max(largest, _peak(process.pid))
            time.sleep(POLL_S)
    if process.returncode != 0:
        raise ChildProcessError(log.read_text()[-2000:])
    (run,) = json.loads((output / "summary.json").read_text())["bags"]
    return float(run["times_real_time"]), largest


def _peak(pid: int) -> float:
    """Return the largest resident memory [MB] so far of a process or one of its children.

    What ``wait4`` reports holds that of this process, too: it is counted before the command starts.
    """
    try:
        every = [pid, *(child.pid for child in psutil.Process(pid).children(recursive=True))]
        status = [Path(f"/proc/{each}/status").read_text(encoding="ascii") for each in every]
    except (OSError, psutil.Error):  # one has just ended
        return 0.0
    found = [re.search(r"VmHWM:\s+(\d+) kB", each) for each in status]
    return max((float(each.group(1)) / 1024.0 for each in found if each), default=0.0)
