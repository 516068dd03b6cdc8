# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run three rovers for long and test for growth; called by ``make soak``.

Three rovers drive 24 simulated hours each through the core, and two hours each over DDS at four
times real time. With four processors the core runs beside the DDS part, in processes of lower
priority, and all takes 38 minutes. With fewer, the core's hours follow. Each part runs until its
hours or its time are over. The result is in out/soak.json and docs/faults.md.

Exit codes: 0 all was run and nothing grows; 1 something grows, or a part fell short of its hours or
its rate; 2 a process failed.
"""

import argparse
import inspect
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

from benchmarks import trend
from benchmarks.machine import machine
from benchmarks.soak import live
from benchmarks.soak.core import ProcessSample
from benchmarks.soak.page import HEADING, section
from benchmarks.soak.verdict import DDS_HOURS, HOURS, Ran, core_trends, live_trends
from benchmarks.trend import Trend
from terrain_estimator.files.atomic import write_file
from tests.faults.page import PAGE, replace_section

AT_ONCE = len(os.sched_getaffinity(0)) >= 4
MINUTES, DDS_SHARE, CORE_SHARE = 38.0 if AT_ONCE else 75.0, 0.85 if AT_ONCE else 0.5, 0.95
ROVERS = 3
START_S = 120.0
"""[s] Allowed lateness of a process of the core, on a busy machine."""


def main(arguments: list[str] | None = None) -> int:
    """Run both parts, judge, write; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="make soak", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--minutes", type=float, default=MINUTES, help="of wall time for all (default: %(default)s)"
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/soak.json"),
        help="file of the result (default: %(default)s)",
    )
    parser.add_argument(
        "--page",
        type=Path,
        default=PAGE,
        help="whose section is replaced (default: docs/faults.md)",
    )
    options = parser.parse_args(arguments)
    begun_s, where = time.monotonic(), machine()
    try:
        core, series = soak(60.0 * options.minutes)
        trends = [
            each
            for place, samples in enumerate(core, 1)
            for each in core_trends(f"rover{place}", samples)
        ]
        trends += [each for rover in series for each in live_trends(rover)]
    except (AssertionError, ChildProcessError, ValueError) as error:
        print(f"soak: {error}", file=sys.stderr)
        return 2
    ran = Ran.of(core, series, (time.monotonic() - begun_s) / 60.0)
    record: dict[str, object] = {
        "machine": where,
        "ran": asdict(ran),
        "short": list(ran.shortfalls()),
    }
    record |= {"test": inspect.getdoc(trend), "trends": [each.record() for each in trends]}
    record |= {
        "series": [asdict(rover) for rover in series],
        "samples": [[asdict(each) for each in samples] for samples in core],
    }
    options.out.parent.mkdir(parents=True, exist_ok=True)
    write_file(options.out, json.dumps(record, indent=1) + "\n")
    replace_section(options.page, HEADING, section(trends, ran))
    return verdict(trends, ran)


def soak(seconds: float) -> tuple[list[list[ProcessSample]], list[live.RoverSeries]]:
    """Run both parts; raises AssertionError or ChildProcessError where a process fails."""
    with tempfile.TemporaryDirectory() as name:
        folder, begun_s = Path(name), time.monotonic()
        files = [folder / f"rover{number}.json" for number in range(1, ROVERS + 1)]
        children = _cores(CORE_SHARE * seconds, files) if AT_ONCE else []
        try:
            series = live.drive(
                ROVERS, DDS_HOURS, DDS_SHARE * seconds, folder, lambda text: print(text, flush=True)
            )
            children = children or _cores(
                CORE_SHARE * seconds - (time.monotonic() - begun_s), files
            )
            for child in children:
                code = child.wait(max(1.0, seconds + START_S - (time.monotonic() - begun_s)))
                if code != 0:
                    raise ChildProcessError(f"the process of the core ended with code {code}")
        except subprocess.TimeoutExpired as error:
            raise ChildProcessError("a process of the core did not end in its time") from error
        finally:
            for child in children:
                child.kill()
        return [
            [ProcessSample(**each) for each in json.loads(file.read_text(encoding="utf-8"))]
            for file in files
        ], series


def _cores(seconds: float, files: list[Path]) -> list[subprocess.Popen[bytes]]:
    module = [sys.executable, "-m", "benchmarks.soak.core"]
    given = (
        [str(number), str(HOURS), str(seconds), str(file)] for number, file in enumerate(files, 1)
    )
    return [subprocess.Popen([*module, *each]) for each in given]  # noqa: S603 - ourselves


def verdict(trends: list[Trend], ran: Ran) -> int:
    """Print what was run, what fell short and what grows; return the exit code."""
    print(f"ran: {json.dumps(asdict(ran))}")
    short = list(ran.shortfalls())
    for text in short:
        print(f"SHORT {text}")
    for each in trends:
        print(
            f"{'GROWS' if each.grows else 'flat '} {each.what}: level {each.level:.4g}, growth"
            f" {each.growth:.2g} (allowed {each.allowed:g})"
        )
    return 1 if short or any(each.grows for each in trends) else 0


if __name__ == "__main__":
    sys.exit(main())
