# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Log and /diagnostics of a process."""

import re
from typing import Any

from terrain_estimator.messaging.diagnostics import CHECKS, LATENCY, Level

_LINE = re.compile(r"^\[(?:WARN|ERROR|FATAL)\] \[[\d.]+\] \[[\w.]+\]: (.*)$", re.MULTILINE)
_OF_THE_MACHINE = (LATENCY.name, LATENCY.quantity)
"""Lines that a busy machine causes."""


def log_lines(output: str) -> list[str]:
    """Return the lines from WARN on without those of a busy machine; a traceback is one line."""
    found = [line for line in _LINE.findall(output) if not line.startswith(_OF_THE_MACHINE)]
    return [*found, "Traceback"] if "Traceback" in output else found


def worst_levels(messages: list[Any], node: str) -> dict[str, str]:
    """Return the worst level of every check that was not OK, over its subjects."""
    levels: dict[str, int] = {}
    for status in (status for message in messages for status in message.status):
        name = status.name.removeprefix(f"/{node}: ")
        if name != status.name:
            check = next(check.name for check in CHECKS if name.startswith(check.name))
            levels[check] = max(levels.get(check, 0), status.level[0])
    return {
        name: Level(level).name
        for name, level in sorted(levels.items())
        if level and name != LATENCY.name
    }
