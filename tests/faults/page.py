# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of measured faults: each command replaces its own section."""

import os
import platform
import re
from datetime import UTC, datetime
from pathlib import Path

import torch

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"


def replace_section(page: Path, heading: str, text: str) -> None:
    """Put ``text`` between a heading of the second level and the next one. Raises ValueError where the page lacks it."""
    before, found, rest = page.read_text(encoding="utf-8").partition(f"\n## {heading}\n")
    if not found:
        raise ValueError(f"{page}: no section {heading!r}")
    _, following, after = rest.partition("\n## ")
    page.write_text(f"{before}{found}\n{text.rstrip()}\n{following}{after}", encoding="utf-8")


def machine() -> str:
    """On what and when it was measured."""
    cpu = re.search(r"^model name\s*: (.+)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE)
    name = cpu[1] if cpu else platform.machine()
    return f"Measured on {os.cpu_count()} cores ({name}), torch {torch.__version__}, {datetime.now(UTC):%Y-%m-%d}"
