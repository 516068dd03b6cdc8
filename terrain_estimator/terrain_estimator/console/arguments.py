# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments that several commands take: refused by the option's name before any work, not in the middle of it or after."""

import math
from argparse import ArgumentTypeError
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryFile

from rover_parameters.records import ConfigError

LARGEST_SEED = 2**32 - 1
"""What torch's and NumPy's generators both take, with what commands add to it."""


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """Reads a whole number from ``low`` to ``high`` (type of an argument of argparse)."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError as error:
            raise ArgumentTypeError(f"{text!r} is no whole number") from error
        if value < low or (high is not None and value > high):
            raise ArgumentTypeError(
                f"{value}: give {f'at least {low}' if high is None else f'{low} to {high}'}"
            )
        return value

    return read


SEED = whole(0, LARGEST_SEED)
COUNT = whole(1)
WORKERS = whole(0)  # 0: as many as are worth it


def real(low: float, high: float = math.inf, *, exclusive: bool = False) -> Callable[[str], float]:
    """Reads a finite number from ``low`` to ``high``; ``exclusive`` takes the lower end out."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError as error:
            raise ArgumentTypeError(f"{text!r} is no number") from error
        if not (math.isfinite(value) and low <= value <= high) or (exclusive and value == low):
            upper = f" and at most {high:g}" if high < math.inf else ""
            raise ArgumentTypeError(
                f"{value:g}: give a finite number {'above' if exclusive else 'at least'}"
                f" {low:g}{upper}"
            )
        return value

    return read


def effects(text: str) -> tuple[str, ...]:
    """Names between commas, each once."""
    return tuple(dict.fromkeys(name for each in text.split(",") if (name := each.strip())))


def make_folder(option: str, folder: Path) -> None:
    """Make the folder that ``option`` names. Raises ConfigError where files cannot be written into it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ConfigError(
            f"{option} {folder}: no file can be written there ({error.strerror}): give another"
            " folder"
        ) from error


def refuse_twice(paths: Sequence[Path], why: str) -> None:
    """Raises ConfigError where two paths are of one file, whatever their names."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise ConfigError(f"{path} is given twice: {why}")
        seen.add(path.resolve())
