# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Arguments that several commands take, checked before any work starts."""

import math
from argparse import ArgumentParser, ArgumentTypeError, RawDescriptionHelpFormatter
from collections.abc import Callable, Sequence
from pathlib import Path

from rover_parameters.records import ConfigError

LARGEST_SEED = 2**32 - 1
"""Largest seed that torch and NumPy accept after commands have added to it."""


def command_parser(name: str, description: str | None) -> ArgumentParser:
    """Return the parser of a command, which shows ``description`` as it is written."""
    return ArgumentParser(
        prog=name, description=description, formatter_class=RawDescriptionHelpFormatter
    )


def add_out(parser: ArgumentParser, folder: str, what: str = "folder of the results") -> None:
    """Add the option ``--out``."""
    parser.add_argument(
        "--out", type=Path, default=Path(folder), help=f"{what} (default: %(default)s)"
    )


def whole(low: int, high: int | None = None) -> Callable[[str], int]:
    """Return an argparse type that reads a whole number from ``low`` to ``high``."""

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
WORKERS = whole(0)  # 0: choose a number that pays


def real(low: float, high: float = math.inf, *, exclusive: bool = False) -> Callable[[str], float]:
    """Return an argparse type for a finite number; ``exclusive`` leaves out the lower end."""

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


def deviations(text: str) -> dict[str, float]:
    """Read standard deviations such as ``mass=2,wheel_radius=0.002``, each name once."""
    found: dict[str, float] = {}
    for each in text.split(","):
        name, given, value = (part.strip() for part in each.partition("="))
        if not (name and given and value):
            raise ArgumentTypeError(f"{each!r}: give NAME=DEVIATION, several with commas between")
        if name in found:
            raise ArgumentTypeError(f"{name} is given twice: leave one out")
        try:
            found[name] = float(value)
        except ValueError as error:
            raise ArgumentTypeError(f"{name}={value}: {value!r} is no number") from error
    return found


def deviations_or_exact(text: str) -> dict[str, float]:
    """Read standard deviations, or ``exact`` for none."""
    return {} if text.strip() == "exact" else deviations(text)


def effects(text: str) -> tuple[str, ...]:
    """Split names at commas, each once."""
    return tuple(dict.fromkeys(name for each in text.split(",") if (name := each.strip())))


def add_search_options(parser: ArgumentParser, library: str, seed: str) -> None:
    """Add the options of every search for effects; ``library`` and ``seed`` explain two of them."""
    parser.add_argument(
        "--library",
        type=effects,
        default=(),
        metavar="NAME,...",
        help=f"effects to consider (default: {library})",
    )
    parser.add_argument(
        "--seed", type=SEED, default=0, help=f"seed of the {seed} (default: %(default)s)"
    )
    add_out(parser, "out/finding")


def refuse_twice(paths: Sequence[Path], why: str) -> None:
    """Raise ConfigError where two paths lead to the same file."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise ConfigError(f"{path} is given twice: {why}")
        seen.add(path.resolve())
