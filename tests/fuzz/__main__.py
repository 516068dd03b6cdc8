# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fuzz the readers of bags, YAML, JSON, CSV and saved states with atheris (libFuzzer): `make fuzz`.

A finding is an exception other than the reader's documented one, a time-out, or too much memory.
Its input is kept, and the exit code is 1.
"""

import argparse
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from docs.provenance import measured
from tests.faults.page import PAGE, machine, replace_section
from tests.fuzz.mutations import SLOWEST_S, mutations
from tests.fuzz.targets import TARGETS

HEADING = "Fuzzing"
SECTION = """{measured}
Machine: {machine}.

atheris (libFuzzer) changes sound files, guided by the branches that readers, mcap, rosbags and
PyYAML take. A finding is any error but the one that a reader documents, more than {timeout_s} s, or
more than {memory_gib} GiB of memory.

| reader | executions | features covered | finding |
|---|---|---|---|
"""
DAMAGE_HEADING = "Random damage"
DAMAGE = """{measured}
Machine: {machine}.

Each sound file gets one to eight random changes: bytes changed, cut, repeated, moved or inserted.
The damage is drawn independently, so that the count limits the share of damaged files that would be
a finding: an undocumented error, or more than {slowest_s:g} s of processor time.

| reader | damaged files | findings | at most, in % of such files (95 %) | slowest [s] |
|---|---|---|---|---|
"""
LONGEST_INPUT = 16384  # bytes, of targets whose seeds are no longer
MINUTES = 78.0
"""Ten each for bags, their definitions and metadata, YAML, mappings and CSV, two for the others."""
TIMEOUT_S = 20
MEMORY_MB = 3072


@dataclass(frozen=True, slots=True)
class Result:
    """Summary of one run of libFuzzer."""

    executions: int
    coverage: int
    finding: str  # the exception or libFuzzer's summary, empty where there is none

    @classmethod
    def of(cls, log: str, code: int) -> Self:
        """Read the summary from its log and exit code."""
        executions = (
            re.findall(r"stat::number_of_executed_units: +(\d+)", log)
            or re.findall(r"^#(\d+)", log, re.MULTILINE)
            or ["0"]
        )
        coverage = re.findall(r" cov: (\d+)", log) or ["0"]
        words = re.findall(
            r"=== Uncaught Python exception: ===\n(.*)|^(?:SUMMARY: |==\d+== ERROR: )(.*)",
            log,
            re.MULTILINE,
        )
        text = next((first or second for first, second in words), f"exit code {code}")
        return cls(int(executions[-1]), int(coverage[-1]), text if code else "")


def main() -> int:
    """Fuzz all targets, each for its share of the time, and write the section of the page."""
    options = _parser().parse_args()
    chosen = options.only or list(TARGETS)
    if options.mutations:
        return _damage(options, chosen)
    unit_s = 60.0 * options.minutes / sum(TARGETS[name].weight for name in chosen)
    results = {name: _fuzz(name, options.out, unit_s * TARGETS[name].weight) for name in chosen}
    if not options.only:
        replace_section(options.page, HEADING, section(results, options.minutes))
    return int(any(result.finding for result in results.values()))


def _fuzz(name: str, out: Path, seconds: float) -> Result:
    folder = out / name.replace(" ", "_")
    corpus, seeds = folder / "corpus", folder / "seeds"
    for each in (corpus, seeds):
        each.mkdir(parents=True, exist_ok=True)
    contents = TARGETS[name].seeds()
    longest = max(LONGEST_INPUT, 2 * max(map(len, contents)))
    for number, data in enumerate(contents):
        (seeds / str(number)).write_bytes(data)
    limits = [
        f"-max_total_time={seconds:.0f}",
        f"-timeout={TIMEOUT_S}",
        f"-rss_limit_mb={MEMORY_MB}",
        f"-max_len={longest}",
    ]
    limits += ["-print_final_stats=1", f"-artifact_prefix={folder}/"]
    command = [sys.executable, "-m", "tests.fuzz.drive", name, *limits, str(corpus), str(seeds)]
    done = subprocess.run(
        command,
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
        env={**os.environ, "PYTHONWARNINGS": ""},
    )
    (folder / "log.txt").write_text(done.stdout + done.stderr, encoding="utf-8")
    result = Result.of(done.stdout + done.stderr, done.returncode)
    sys.stdout.write(
        f"{name}: {result.executions} executions, coverage {result.coverage},"
        f" {result.finding or 'no finding'}\n"
    )
    sys.stdout.flush()
    return result


def section(results: dict[str, Result], minutes: float) -> str:
    """Return the section of the page."""
    head = SECTION.format(
        measured=measured("fuzz", f"--minutes {minutes:g}"),
        machine=machine(),
        timeout_s=TIMEOUT_S,
        memory_gib=MEMORY_MB >> 10,
    )
    rows = (
        f"| {name} | {each.executions} | {each.coverage} | {each.finding or 'none'} |"
        for name, each in results.items()
    )
    return head + "\n".join(rows)


def _damage(options: argparse.Namespace, chosen: list[str]) -> int:
    """Read randomly damaged files with the targets and write the section of the page."""
    number, seed = options.mutations, options.seed
    found = {name: mutations(name, number, seed, options.out) for name in chosen}
    given = "".join(f" --only '{name}'" for name in options.only or ())
    head = DAMAGE.format(
        measured=measured("fuzz", f"--mutations {number} --seed {seed}{given}"),
        machine=machine(),
        slowest_s=SLOWEST_S,
    )
    rows = (
        f"| {name} | {each.files} | {each.findings} | {100.0 * each.limit:.2g} |"
        f" {each.slowest_s:.2f} |"
        for name, each in found.items()
    )
    replace_section(options.page, DAMAGE_HEADING, head + "\n".join(rows))
    return int(any(each.findings for each in found.values()))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=MINUTES,
        help="for all readers together (default: %(default)s)",
    )
    parser.add_argument(
        "--only",
        action="append",
        choices=list(TARGETS),
        help="this reader, again for more; no page then",
    )
    parser.add_argument(
        "--mutations",
        type=int,
        default=0,
        metavar="N",
        help="instead, read N files with random damage for each reader; a section of its own",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the damage (default: %(default)s)")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/fuzz"),
        help="folder of inputs and findings (default: %(default)s)",
    )
    parser.add_argument(
        "--page",
        type=Path,
        default=PAGE,
        help="whose section is replaced (default: docs/faults.md)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
