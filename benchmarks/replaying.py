# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Speed and memory of the replay of a short bag and of a long one, each in a process of its own.

python -m benchmarks.replaying BAG OUTPUT      # replays one and prints what it took, as JSON
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import torch

from benchmarks import reading
from benchmarks.drives import long_drive
from benchmarks.lines import BenchmarkLine, Effort
from terrain_estimator.bags import Types
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, EstimatorConfig
from terrain_estimator.offline.replay import replay
from terrain_estimator.offline.topic_mapping import bag_topics
from tests.drives import write_bag

BAR = 1000.0
"""[1] Times real time."""
GROWTH = 1.1
"""[1] Largest ratio of the memory of the long bag to that of the short one."""
SHORT_S, LONG_S = 600.0, 36000.0


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
    """Return the speed over real time, and the largest resident memory [MB] of either process."""
    command = [sys.executable, "-m", "benchmarks.replaying", str(bag), str(output)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    if ended.returncode != 0:
        raise ChildProcessError(ended.stderr[-2000:])
    speed, memory = json.loads(ended.stdout.splitlines()[-1])
    return float(speed), float(memory)


def main(bag: str, output: str) -> None:
    """Replay like the command."""
    torch.set_num_threads(1)
    done = replay(Path(bag), Path(output), load("", AUTO), EstimatorConfig(), bag_topics([], ""))
    memory = (
        max(
            resource.getrusage(who).ru_maxrss
            for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        )
        / 1024.0
    )
    print(json.dumps([done.times_real_time, memory]))


if __name__ == "__main__":
    main(*sys.argv[1:])
