# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Measure every speed that has a bar, beside a reference of the same run; called by ``make bench``.

Writes out/bench.json, and after a whole run at full scale docs/benchmarks.md. Exit code 1 where a
bar is missed; all lines are measured and written all the same.
"""

import argparse
import importlib
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.machine import machine
from benchmarks.page import number, page, quantity
from terrain_estimator.files.atomic import write_file

NAMES = (
    "observation",
    "latency",
    "onboard",
    "rate",
    "replaying",
    "fleet",
    "reading",
    "simulation",
    "discovery",
    "training",
    "cost",
)
"""Modules of this folder; each has ``lines(effort)``."""
PAGE = Path("docs/benchmarks.md")


def main(arguments: list[str] | None = None) -> int:
    """Measure, print and write; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="make bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", nargs="+", choices=NAMES, default=NAMES, help="what to measure (default: all)"
    )
    parser.add_argument(
        "--scale",
        type=float,
        default=1.0,
        help="of lengths and repetitions; below 1 nothing is published (default: 1)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/bench.json"),
        help="file of the results (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    where = machine()
    lines = [line for name in options.only for line in measured(name, Effort(options.scale))]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    record = {"machine": where, "scale": options.scale, "lines": [line.record() for line in lines]}
    write_file(options.out, json.dumps(record, indent=2) + "\n")
    if options.scale == 1.0 and set(options.only) == set(NAMES):
        write_file(PAGE, page(lines, where, NAMES))
    missed = [line for line in lines if not line.met]
    print(
        f"{len(missed)} of {len(lines)} bars missed; {options.out}"
        if missed
        else f"no bar missed; {options.out}"
    )
    return 1 if missed else 0


def measured(name: str, effort: Effort) -> Sequence[BenchmarkLine]:
    """Return the lines of one module; where it fails, the last one names the error."""
    found: list[BenchmarkLine] = []
    try:
        for line in importlib.import_module(f"benchmarks.{name}").lines(effort):
            show(line)
            found.append(line)
    except Exception as error:  # noqa: BLE001 - whatever it is, the other lines are measured
        reason = (str(error).splitlines() or [""])[0]
        line = BenchmarkLine(
            name,
            math.nan,
            "",
            math.nan,
            reference="none",
            against=math.nan,
            note=f"failed: {type(error).__name__}: {reason}",
        )
        show(line)
        found.append(line)
    return found


def show(line: BenchmarkLine) -> None:
    """Print one line."""
    bar = (
        ""
        if line.bar is None
        else (
            f" (bar: {'at least' if line.least else 'at most'} {number(line.bar)},"
            f" {'met' if line.met else 'MISSED'})"
        )
    )
    note = f"; {line.note}" if line.note else ""
    print(
        f"{line.what}: {quantity(line)}{bar}, {number(line.ratio)} of {line.reference}{note}",
        flush=True,
    )


if __name__ == "__main__":
    sys.exit(main())
