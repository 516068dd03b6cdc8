# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run one scenario with a fault at every call: a process for each, forked from this one.

Started with the preload filter; prints one line of JSON for each kind of fault.
"""

import argparse
import dataclasses
import json
import logging
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import torch

from tests.faults.syscalls.filter import KINDS, NOTHING, Filter, Passed
from tests.faults.syscalls.memory import Shortage
from tests.faults.syscalls.scenarios import SCENARIOS, Ended

MEMORY = "MemoryError"
EVERY, DRAWN = 200, 50
SEED = 20
LONGEST_S = 120.0


@dataclass(slots=True)
class Row:
    """Results of one scenario with one kind of fault."""

    scenario: str
    kind: str
    calls: int  # of the run without a fault
    runs: int = 0  # in which a call failed
    failed: dict[str, int] = field(default_factory=dict)  # by the name of the call
    codes: dict[str, int] = field(default_factory=dict)  # by exit code
    complaints: list[str] = field(default_factory=list)


def numbers(calls: int, only: int) -> list[int]:
    """Return the calls to fail: all up to EVERY and DRAWN others, or ``only`` of them, drawn."""
    generator = random.Random(SEED)
    chosen = list(range(1, min(calls, EVERY) + 1))
    later = range(EVERY + 1, calls + 1)
    chosen += sorted(generator.sample(later, min(DRAWN, len(later))))
    return sorted(generator.sample(chosen, min(only, len(chosen)))) if only else chosen


class Sweep:
    """The runs of one scenario."""

    def __init__(self, name: str, folder: Path) -> None:
        """Prepare what all runs share."""
        self.name, self._scenario, self._folder = name, SCENARIOS[name], folder
        self._prepared, self._filter = folder / "prepared", Filter()
        self._prepared.mkdir()
        self._scenario.prepare(self._prepared)

    def row(self, kind: str, only: int) -> Row:
        """Run without a fault, then with one at each chosen call."""
        result, passed = self._run(kind, 0)
        row = Row(self.name, kind, passed.seen)
        if complaints := self._complaints(result, hit=False):
            row.complaints += [f"without a fault: {line}" for line in complaints]
            return row
        failed, codes = Counter[str](), Counter[str]()
        for number in numbers(passed.seen, only):
            result, passed = self._run(kind, number)
            if not passed.hits:
                continue
            failed[passed.call] += 1
            codes[str(result.code)] += 1
            row.complaints += [
                f"call {number} ({passed.call}): {line}"
                for line in self._complaints(result, hit=True)
            ]
        row.runs, row.codes = failed.total(), dict(sorted(codes.items()))
        row.failed = dict(failed.most_common(6))
        return row

    def _complaints(self, ended: Ended, *, hit: bool) -> list[str]:
        found = (
            self._scenario.check(
                self._prepared, self._folder / "work", self._folder / "notes", ended
            )
            if ended.code in self._scenario.codes
            else [f"exit code {ended.code}"]
        )
        if not hit and ended.code:
            found.append(f"exit code {ended.code}")
        if ended.code and not ended.lines:
            found.append(f"exit code {ended.code} without a line")
        if len(ended.lines) > self._scenario.most_lines or any(
            "Traceback" in line for line in ended.lines
        ):
            found.append(f"{len(ended.lines)} lines: {' / '.join(ended.lines)[-600:]}")
        return found

    def _run(self, kind: str, number: int) -> tuple[Ended, Passed]:
        """Fork a process that runs the scenario; call ``number`` of it fails."""
        work, notes = self._folder / "work", self._folder / "notes"
        for each in (work, notes):
            shutil.rmtree(each, ignore_errors=True)
            each.mkdir()
        self._scenario.begin(self._prepared, work)
        sys.stdout.flush()
        child = os.fork()
        if not child:
            self._child(kind, number, work, notes)
        code = _awaited(child)
        lines = (notes / "lines").read_text().splitlines() if (notes / "lines").exists() else []
        path = notes / "passed"
        passed = Passed(*json.loads(path.read_text())) if path.exists() else Passed(0, 1, "?")
        return Ended(code, lines), passed

    def _child(self, kind: str, number: int, work: Path, notes: Path) -> None:
        """Run the scenario and end the process."""
        os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
        for stream, name in ((1, "output"), (2, "lines")):
            os.dup2(os.open(notes / name, os.O_WRONLY | os.O_CREAT), stream)
        logging.basicConfig(level=logging.WARNING, format="%(message)s")
        code, shortage = 99, Shortage(number)
        try:
            if kind == MEMORY:
                shortage.start()
            else:
                self._filter.arm(work, number, KINDS.get(kind, NOTHING))
            code = self._scenario.act(self._prepared, work, notes)
        except SystemExit as error:
            code = int(error.code or 0)
        except BaseException:  # noqa: BLE001 - the parent judges it
            traceback.print_exc()
        shortage.stop()
        passed = self._filter.disarm()
        if kind == MEMORY:
            passed = Passed(shortage.seen, bool(shortage.place), shortage.place)
        sys.stdout.flush()
        sys.stderr.flush()
        (notes / "passed").write_text(json.dumps(passed))
        os._exit(code)


def _awaited(child: int) -> int:
    """Return the exit code of a process; -1 where it hangs, and is killed."""
    end = time.monotonic() + LONGEST_S
    while time.monotonic() < end:
        found, status = os.waitpid(child, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -1


def main() -> int:
    """Print the rows of the scenarios; return 1 where something must not be."""
    parser = argparse.ArgumentParser(prog="sweep", description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=list(SCENARIOS), metavar="SCENARIO")
    parser.add_argument("--kind", action="append", choices=[*KINDS, MEMORY])
    parser.add_argument("--only", type=int, default=0, help="runs of each kind, drawn")
    options = parser.parse_args()
    torch.set_num_threads(1)
    wrong = False
    for name in options.scenarios:
        with tempfile.TemporaryDirectory(prefix="faults_") as folder:
            sweep = Sweep(name, Path(folder).resolve())
            for kind in options.kind or [*KINDS, MEMORY]:
                row = sweep.row(kind, options.only)
                wrong |= bool(row.complaints)
                sys.stdout.write(json.dumps(dataclasses.asdict(row)) + "\n")
                sys.stdout.flush()
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
