# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page docs/faults.md, of which each command replaces its own section."""

import os
import platform
import re
from pathlib import Path

import torch

from docs.provenance import measured
from tests.faults.fault import Fault, Seen

MATRIX = """{measured}
Machine: {machine}.

Each row starts the real processes, drives with sound messages at 10 Hz, and applies one fault. The
fault lasts eight seconds unless the row gives another duration. Then the rover drives on.

- **Outcome**: outcomes of the observations during the fault.
- **Diagnostics**: the worst levels during the fault.
- **Log**: all lines from WARN on.
- **Lost**: sound observations that did not enter the estimate. The posterior is kept unless the row
  names it.

The command exits with code 1 if a row is not as expected.

| fault | what was done | outcome | diagnostics | log | back after | lost |
|---|---|---|---|---|---|---|
"""
PAGE = Path(__file__).parents[2] / "docs" / "faults.md"


def replace_section(page: Path, heading: str, text: str) -> None:
    """Put ``text`` between a heading of the second level and the next one.

    Raises ValueError where the page has no such heading.
    """
    before, found, rest = page.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
    if not found:
        raise ValueError(f"{page}: no section {heading!r}")
    _, following, after = rest.partition("\n## ")
    page.write_text(f"{before}{found}\n{text.rstrip()}\n{following}{after}", encoding="utf-8")


def matrix(rows: list[tuple[Fault, Seen | None]]) -> str:
    """Return the table of all faults and their outcomes."""
    lines = (
        f"| {' | '.join(cell.replace('|', ' ') for cell in _cells(fault, seen))} |"
        for fault, seen in rows
    )
    return MATRIX.format(measured=measured("faults"), machine=machine()) + "\n".join(lines)


def _cells(fault: Fault, seen: Seen | None) -> tuple[str, ...]:
    if seen is None:
        return fault.name, fault.what, "not measured", "", "", "", ""
    outcomes = (
        ", ".join(
            name if count == 1 else f"{count} {name}" for name, count in seen.outcomes.items()
        )
        or "no observation"
    )
    levels = ", ".join(f"{name}: {level}" for name, level in seen.diagnostics.items()) or "OK"
    log = "<br>".join(re.sub(r"/tmp/\w+/", "", line) for line in seen.log) or "nothing"
    back = f"{seen.back_after_s:.1f} s" + (
        f", {seen.back_after} observations" if seen.back_after else ""
    )
    lost = f"{seen.lost} {fault.lost_is}" + ("" if seen.kept else " and the posterior")
    return (
        fault.name,
        fault.what,
        outcomes.replace("none", "without answer"),
        levels,
        log,
        back,
        lost,
    )


def machine() -> str:
    """Return processor, cores and the version of torch."""
    cpu = re.search(
        r"^model name\s*: (.+)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE
    )
    name = cpu[1] if cpu else platform.machine()
    return f"{os.cpu_count()} cores ({name}), torch {torch.__version__}"
