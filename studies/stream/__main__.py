# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge what the estimator publishes with default parameters and the models that ship.

Called by ``make stream``; writes a JSON file and a page. Drives are computed in batches, each of
which is kept: a run that ended early continues where it was.
"""

import argparse
import json
import sys
from dataclasses import asdict
from functools import partial

import torch

from docs.provenance import digest, measured
from studies.accuracy.cells import WRONG
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.records import Piece, compute, read_record, write_results
from studies.stream.drives import CONFIGS, EVERY_ROW, Streamed, joined, stream_cell
from studies.stream.pieces import streamed_of, write_cell
from studies.stream.table import StreamCell, page, score
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.tasks import ROVERS, SOILS
from terrain_estimator.model.model_file import load_model

BATCH = 50
"""Drives that are computed at once."""
TIMES_S = (40.0,)
"""[s] Times at which they are judged; a drive lasts until the last."""

Place = tuple[str, str, float]
"""Rover, soil, and by how much the constants are wrong."""


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for one batch of each cell; 2 a file
    cannot be read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    pieces = _pieces(args)
    # every cell's first batch, then every cell's second
    every = [piece for same in zip(*pieces.values(), strict=True) for piece in same]
    try:
        missing = [piece for piece in every if read_record(piece.path) is None]
        keep = partial(write_cell, whole=(EVERY_ROW,))
        compute("studies.stream", missing, args.jobs, args.minutes, keep)
        cells = _cells(pieces)
        if len(cells) < len(pieces):
            return refuse_too_short("stream", "batch of every cell")
        when = measured("stream")
        figures = {"measured": when, "seed": args.seed, "cells": [asdict(cell) for cell in cells]}
        text = json.dumps(figures, indent=1) + "\n"
        write_results({args.out: text, args.table: page(cells, when, args.seed)})
    except OSError as error:
        return refuse("stream", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(cells)} cells\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("stream", __doc__)
    parser.add_argument(
        "--batches",
        type=COUNT,
        default=10,
        help=f"of {BATCH} drives of 40 s each, for each rover, soil and kind of constants",
    )
    parser.add_argument(
        "--seed",
        type=SEED,
        default=12_000_000,
        help="of all that is drawn; not the one of any training or choice",
    )
    parser.add_argument(
        "--rover",
        nargs="+",
        choices=ROVERS,
        default=ROVERS,
        help="rovers, each with the model that ships",
    )
    parser.add_argument("--soil", nargs="+", choices=SOILS, default=SOILS, help="soils")
    add_record_options(parser, "stream_study", "batch")
    return parser


def _pieces(args: argparse.Namespace) -> dict[Place, list[Piece[dict[str, Streamed]]]]:
    """Return the batches of each cell."""
    folder = args.records / f"{digest('stream')}-{args.seed}"
    places = [
        (rover, soil, spread) for rover in ROVERS for soil in SOILS for spread in (0.0, WRONG)
    ]
    found: dict[Place, list[Piece[dict[str, Streamed]]]] = {}
    for index, place in enumerate(places):
        rover, soil, spread = place
        if rover in args.rover and soil in args.soil:
            name, first = (
                f"{rover}-{soil}-{'wrong' if spread else 'exact'}",
                args.seed + 1000 * index,
            )
            found[place] = [
                Piece(
                    partial(stream_cell, *place, BATCH, first + k, TIMES_S, tuple(CONFIGS)),
                    folder / f"{name}-{k}.npz",
                )
                for k in range(args.batches)
            ]
    return found


def _cells(pieces: dict[Place, list[Piece[dict[str, Streamed]]]]) -> list[StreamCell]:
    """Return the cells, each from its batches that are done."""
    cells = []
    for (rover, soil, spread), of_cell in pieces.items():
        records = [record for piece in of_cell if (record := read_record(piece.path))]
        if records:
            found = {rows: joined(streamed_of(each, rows) for each in records) for rows in CONFIGS}
            cells.append(score(rover, load_model(rover).model_id, soil, spread, found))
    return cells


if __name__ == "__main__":
    sys.exit(main())
