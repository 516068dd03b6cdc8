# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A drive of eight seconds, and the command that replays it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from terrain_estimator.bags import BagReader, BagWriter, compare
from terrain_estimator.cli import replay
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES

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


def with_estimates(
    folder: Path, bag: Path, estimates_bag: Path, changed: Callable[[Any], Any] = lambda said: said
) -> Path:
    """Write a bag of the inputs of one bag and the outputs of another, as of a live node."""
    with (
        BagWriter(folder) as writer,
        BagReader(bag) as inputs,
        BagReader(estimates_bag) as outputs,
    ):
        topics = {
            f"/{name}": writer.add_topic(f"/{name}", type_name)
            for name, type_name in (INPUT_TYPES | OUTPUT_TYPES).items()
        }
        for number, raw in enumerate([*inputs.messages(), *outputs.messages()]):
            data = raw.data
            if raw.topic == "/terrain_estimate":
                data = outputs.types.serialize(changed(outputs.decode(raw)))
            writer.write(topics[raw.topic], data, number)
    return folder
