# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A drive of eight seconds, and the command that replays it."""

import json
from pathlib import Path
from typing import Any

from terrain_estimator.bags import BagReader, compare
from terrain_estimator.cli import replay
from terrain_estimator.topics import OUTPUT_TYPES

SECONDS = 8.0


def run(out: Path, *arguments: str | Path) -> tuple[int, dict[str, Any]]:
    """Return the exit code, and the summary where one was written."""
    code = replay.main([*map(str, arguments), "--out", str(out)])
    path = out / "summary.json"
    return code, json.loads(path.read_text()) if path.exists() else {}


def estimates(folder: Path) -> list[Any]:
    with BagReader(folder) as reader:
        return [reader.decode(raw) for raw in reader.messages(["/terrain_estimate"])]


def identical(one: Path, other: Path) -> bool:
    return all(compare(one, f"/{topic}", other, f"/{topic}") is None for topic in OUTPUT_TYPES)
