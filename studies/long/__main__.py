# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge the estimator after minutes and after an hour on one ground; called by ``make long``.

Writes a JSON file and a page. Drives are computed in batches, each of which is kept: a run that
ended early continues where it was.
"""

import argparse
import dataclasses
import json
import sys
import zlib
from functools import partial
from typing import NamedTuple

import torch

from docs.provenance import digest, measured
from studies.accuracy.cells import WRONG
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.long.table import LongLine, lines, page
from studies.records import Piece, compute, read_record, write_results
from studies.stream.drives import CONFIGS, EVERY_ROW, Streamed, joined, stream_cell
from studies.stream.pieces import Record, streamed_of, write_cell
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.tasks import ROVERS

SOIL = "loose_sand"
MINUTES_S, HOUR_S = (40.0, 100.0, 200.0, 400.0), (400.0, 1200.0, 3600.0)
"""[s] Times at which drives of minutes and of an hour are judged."""
HOUR_ROWS = ("v+L", EVERY_ROW)
BATCH = 50
"""Drives that are computed at once."""


class Setting(NamedTuple):
    """One set of drives, simulated once."""

    rover: str
    spread: float  # [1] of the soil constants
    times_s: tuple[float, ...]  # [s] at which it is judged; a drive lasts until the last
    rows: tuple[str, ...]
    hour: bool = False


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for one batch; 2 a file
    cannot be read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    pieces = _pieces(args)
    try:
        missing = [piece for _, piece in pieces if read_record(piece.path) is None]
        compute("studies.long", missing, args.jobs, args.minutes, write_cell)
        found = _lines(pieces)
        if not found:
            return refuse_too_short("long", "batch")
        when = measured("long")
        said = {"measured": when, "seed": args.seed, "cells": list(map(dataclasses.asdict, found))}
        text = json.dumps(said, indent=1) + "\n"
        write_results({args.out: text, args.table: page(found, when, args.seed)})
    except OSError as error:
        return refuse("long", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(found)} lines\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("long", __doc__)
    for name, times, count in (("minutes-of-driving", MINUTES_S, 4), ("hours", HOUR_S, 2)):
        words = f"batches of {BATCH} drives of {times[-1]:g} s for each rover"
        parser.add_argument(f"--{name}", type=COUNT, default=count, help=words)
    parser.add_argument(
        "--seed",
        type=SEED,
        default=31_000_000,
        help="of all that is drawn; not the one of any training or choice",
    )
    add_record_options(parser, "long_drives", "batch")
    return parser


def _pieces(args: argparse.Namespace) -> list[tuple[Setting, Piece[dict[str, Streamed]]]]:
    """Return every setting's first batch, then every setting's second, and so on; hours last."""
    folder = args.records / f"{digest('long')}-{args.seed}"
    found = []
    for hour, count in ((False, args.minutes_of_driving), (True, args.hours)):
        chosen = [each for each in _settings() if each.hour is hour]
        for number in range(count):
            for setting in chosen:
                kind = "hour" if hour else "minutes"
                path = folder / f"{setting.rover}-{kind}-{setting.spread:g}-{number}.npz"
                seed = args.seed + zlib.crc32(path.name.encode()) % 1_000_000
                rover, spread, times, rows, _ = setting
                work = partial(
                    stream_cell, rover, SOIL, spread, BATCH, seed, times, rows, bound=not hour
                )
                found.append((setting, Piece(work, path)))
    return found


def _settings() -> list[Setting]:
    """Return what is driven: minutes with exact and with wrong constants, an hour with wrong."""
    minutes = [
        Setting(rover, spread, MINUTES_S, tuple(CONFIGS))
        for rover in ROVERS
        for spread in (0.0, WRONG)
    ]
    hours = [Setting(rover, WRONG, HOUR_S, HOUR_ROWS, hour=True) for rover in ROVERS]
    return minutes + hours


def _lines(pieces: list[tuple[Setting, Piece[dict[str, Streamed]]]]) -> list[LongLine]:
    """Return the lines of the batches that are done."""
    parts: dict[Setting, list[Record]] = {}
    for setting, piece in pieces:
        if record := read_record(piece.path):
            parts.setdefault(setting, []).append(record)
    return [
        line
        for setting, records in parts.items()
        for line in lines(
            setting.rover,
            setting.spread,
            setting.times_s,
            {rows: joined(streamed_of(each, rows) for each in records) for rows in setting.rows},
        )
    ]


if __name__ == "__main__":
    sys.exit(main())
