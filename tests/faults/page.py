# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of measured faults: each command replaces its own section."""

import os
import platform
import re
from datetime import UTC, datetime
from pathlib import Path

import torch

from tests.faults.fault import Fault, Seen

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"


def replace_section(page: Path, heading: str, text: str) -> None:
    """Put ``text`` between a heading of the second level and the next one. Raises ValueError where the page lacks it."""
    before, found, rest = page.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
    if not found:
        raise ValueError(f"{page}: no section {heading!r}")
    _, following, after = rest.partition("\n## ")
    page.write_text(f"{before}{found}\n{text.rstrip()}\n{following}{after}", encoding="utf-8")


def matrix(rows: list[tuple[Fault, Seen | None]]) -> str:
    """The table of all faults and what came of them."""
    lines = [
        (
            "`make faults`: each row starts the real processes, drives soundly at 10 Hz, does one"
            " thing to them for eight seconds unless it"
        ),
        (
            "says otherwise, and drives on. Outcomes are those of the observations meanwhile,"
            " diagnostics the worst levels meanwhile, the log"
        ),
        (
            "all lines from WARN on. Lost are sound observations that did not enter the estimate;"
            " what was known of the ground is kept unless"
        ),
        f"the row says otherwise. Exit code 1 where a row changes. {machine()}.",
        "",
        "| fault | what was done | outcome | diagnostics | log | back after | lost |",
        "|---|---|---|---|---|---|---|",
    ]
    return "\n".join(
        [
            *lines,
            *(
                f"| {' | '.join(cell.replace('|', ' ') for cell in _cells(fault, seen))} |"
                for fault, seen in rows
            ),
        ]
    )


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
    lost = f"{seen.lost} {fault.lost_is}" + ("" if seen.kept else ", what was known")
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
    """On what and when it was measured."""
    cpu = re.search(
        r"^model name\s*: (.+)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE
    )
    name = cpu[1] if cpu else platform.machine()
    return (
        f"Measured on {os.cpu_count()} cores ({name}), torch {torch.__version__},"
        f" {datetime.now(UTC):%Y-%m-%d}"
    )
