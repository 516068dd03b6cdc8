# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge what the estimator publishes where the world is not its model's.

Called by ``make robustness``; writes a JSON file and a page. Drives are computed in batches, each
of which is kept: a run that ended early continues where it was.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial

import torch

from docs.provenance import digest, measured
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.records import Piece, compute, read_record, write_record, write_results
from studies.robustness.drives import Record, drive_batch, joined
from studies.robustness.table import WorldScore, line, page
from studies.robustness.worlds import BATCH, World, together, worlds
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible

SMALL_BATCH = 5
"""Drives that are computed at once where each batch has a world of its own."""
MIXED = 8
"""Such worlds for every batch of the others."""


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for one batch of each world; 2 a
    file cannot be read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    pieces = list(_pieces(args))
    try:
        missing = [piece for _, piece in pieces if read_record(piece.path) is None]
        compute("studies.robustness", missing, args.jobs, args.minutes, write_record)
        lines = _lines(pieces)
        if len(lines) < len({world.name for world, _ in pieces}):
            return refuse_too_short("robustness", "batch of every world")
        when = measured("robustness")
        figures = {"measured": when, "seed": args.seed, "worlds": [asdict(each) for each in lines]}
        text = json.dumps(figures, indent=1) + "\n"
        write_results({args.out: text, args.table: page(lines, when, args.seed)})
    except OSError as error:
        return refuse("robustness", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(lines)} worlds\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("robustness", __doc__)
    parser.add_argument(
        "--batches", type=COUNT, default=5, help=f"of {BATCH} drives for each world"
    )
    parser.add_argument(
        "--seed",
        type=SEED,
        default=52_000_000,
        help="of all that is drawn; not the one of any training or choice",
    )
    add_record_options(parser, "robustness", "batch")
    return parser


def _pieces(args: argparse.Namespace) -> Iterator[tuple[World, Piece[Record]]]:
    """Yield every world's first batch, then every world's second; worlds share their grounds."""
    folder = args.records / f"{digest('robustness')}-{args.seed}"
    drawing = torch.Generator().manual_seed(args.seed)
    for k in range(args.batches):
        for number, world in enumerate(worlds()):
            work = partial(drive_batch, world, BATCH, args.seed + k)
            yield world, Piece(work, folder / f"{number}-{k}.npz")
        for number in range(MIXED * k, MIXED * (k + 1)):
            world = together(drawing)
            work = partial(drive_batch, world, SMALL_BATCH, args.seed + 1000 + number)
            yield world, Piece(work, folder / f"together-{number}.npz")


def _lines(pieces: list[tuple[World, Piece[Record]]]) -> list[WorldScore]:
    """Return the lines of the worlds, each from its batches that are done."""
    done: dict[str, list[Record]] = {}
    worlds_of: dict[str, World] = {}
    for world, piece in pieces:
        if record := read_record(piece.path):
            worlds_of.setdefault(world.name, world)
            done.setdefault(world.name, []).append(record)
    return [line(worlds_of[name], joined(records)) for name, records in done.items()]


if __name__ == "__main__":
    sys.exit(main())
