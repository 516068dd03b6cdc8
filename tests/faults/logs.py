# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a process says of itself: its log and /diagnostics."""

import re
from typing import Any

from terrain_estimator.messaging.diagnostics import CHECKS, LATENCY, Level

_LINE = re.compile(r"^\[(?:WARN|ERROR|FATAL)\] \[[\d.]+\] \[[\w.]+\]: (.*)$", re.MULTILINE)
_OF_THE_MACHINE = (LATENCY.name, LATENCY.quantity)
"""A busy machine is no fault."""


def log_lines(output: str) -> list[str]:
    """Texts of the lines from WARN on, without what is the machine's fault; a traceback counts as a line."""
    found = [line for line in _LINE.findall(output) if not line.startswith(_OF_THE_MACHINE)]
    return [*found, "Traceback"] if "Traceback" in output else found


def worst_levels(messages: list[Any], node: str) -> dict[str, str]:
    """The worst level of every check of a node that was not OK, over its subjects."""
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
