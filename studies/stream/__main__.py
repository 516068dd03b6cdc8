# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge what the estimator publishes with default parameters and the models that ship.

Run by ``make stream``; writes a JSON file and a page.

Drives are computed in batches, each of which is kept: a run that was ended goes on where it was.
"""

import argparse
import json
import os
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import torch

from studies.accuracy.cells import WRONG
from studies.records import Piece, compute, digest, read_record, write_record, write_results
from studies.stream.drives import Streamed, joined, stream
from studies.stream.table import StreamCell, page, score
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.tasks import ROVERS, SOILS
from terrain_estimator.model.model_file import load_model
from terramechanics.terrain.soil import load_soil

BATCH = 5
"""Drives that are computed at once."""

Place = tuple[str, str, float]
"""Rover, soil, and by how much the constants are wrong."""


def study_batch(rover: str, soil: str, spread: float, seed: int) -> Streamed:
    """A batch of drives of a cell."""
    return stream(load_model(rover), load_soil(soil), spread, BATCH, seed)


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Entry point. 0: measured, whatever the figures are; 1: no time for one batch of each cell; 2: a file cannot be read or written."""
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    pieces = _pieces(args)
    every = [
        piece for same in zip(*pieces.values(), strict=True) for piece in same
    ]  # every cell's first batch, then every cell's second
    try:
        missing = [piece for piece in every if read_record(piece.path) is None]
        compute(
            "studies.stream",
            missing,
            args.jobs,
            args.minutes,
            lambda streamed, path: write_record(asdict(streamed), path),
        )
        cells = _cells(pieces)
        if len(cells) < len(pieces):
            sys.stderr.write(
                "studies.stream: not one batch of every cell was done in this time; call it again, it"
                " goes on where it was\n"
            )
            return 1
        date = datetime.now(UTC).date().isoformat()
        figures = {"date": date, "seed": args.seed, "cells": [asdict(cell) for cell in cells]}
        write_results(
            {
                args.out: json.dumps(figures, indent=1) + "\n",
                args.table: page(cells, date, args.seed),
            }
        )
    except OSError as error:
        sys.stderr.write(f"studies.stream: {error}\n")
        return 2
    sys.stdout.write(f"{args.out} and {args.table}: {len(cells)} cells\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="studies.stream",
        description=__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
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
    parser.add_argument(
        "--jobs",
        type=COUNT,
        default=os.cpu_count() or 1,
        help="processes at a time; the results do not depend on it",
    )
    parser.add_argument(
        "--minutes",
        type=float,
        default=0.0,
        help="after which no batch is begun; 0: until all is done",
    )
    parser.add_argument(
        "--records",
        type=Path,
        default=Path("out/stream_study"),
        help="folder of what is kept of every batch",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/stream_study.json"), help="file of all figures"
    )
    parser.add_argument(
        "--table", type=Path, default=Path("docs/stream_study.md"), help="page of the tables"
    )
    return parser


def _pieces(args: argparse.Namespace) -> dict[Place, list[Piece[Streamed]]]:
    """The batches of each cell."""
    folder = args.records / f"{digest()}-{args.seed}"
    places = [
        (rover, soil, spread) for rover in ROVERS for soil in SOILS for spread in (0.0, WRONG)
    ]
    found: dict[Place, list[Piece[Streamed]]] = {}
    for index, place in enumerate(places):
        rover, soil, spread = place
        if rover in args.rover and soil in args.soil:
            name, first = (
                f"{rover}-{soil}-{'wrong' if spread else 'exact'}",
                args.seed + 1000 * index,
            )
            found[place] = [
                Piece(partial(study_batch, *place, first + k), folder / f"{name}-{k}.npz")
                for k in range(args.batches)
            ]
    return found


def _cells(pieces: dict[Place, list[Piece[Streamed]]]) -> list[StreamCell]:
    """Of the batches that are done."""
    cells = []
    for (rover, soil, spread), of_cell in pieces.items():
        done = [
            Streamed(**arrays)
            for arrays in map(read_record, (piece.path for piece in of_cell))
            if arrays
        ]
        if done:
            cells.append(score(rover, load_model(rover).model_id, soil, spread, joined(done)))
    return cells


if __name__ == "__main__":
    sys.exit(main())
