# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge a recursion that accumulates linearly and reads out nonlinearly, beside the model's.

Called by ``make recursion``; writes a JSON file and a page. Drives are computed in batches, each
of which is kept: a run that ended early continues where it was.
"""

import argparse
import json
import sys
from dataclasses import asdict
from functools import partial

import torch

from docs.provenance import digest, measured
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.records import Piece, compute, read_record, write_record, write_results
from studies.recursion.study import ROVERS, Record, study
from studies.recursion.table import Line, cells, page
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible

SHORT_S, LONG_S = (10.0, 40.0), (40.0, 100.0, 200.0, 400.0)
"""[s] Times at which short and long drives are judged."""
SHORT_BATCH, LONG_BATCH = 50, 20
"""Drives that are computed at once."""
_LONG_SEED = 1000
"""Of the first long batch, counted from that of the first short one."""


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
        every = [piece for kind in pieces.values() for piece in kind]
        missing = [piece for piece in every if read_record(piece.path) is None]
        compute("studies.recursion", missing, args.jobs, args.minutes, write_record)
        lines = [
            line for (rover, times), kind in pieces.items() for line in _lines(rover, times, kind)
        ]
        if not lines:
            return refuse_too_short("recursion", "batch")
        when = measured("recursion")
        figures = {"measured": when, "seed": args.seed, "cells": [asdict(line) for line in lines]}
        text = json.dumps(figures, indent=1) + "\n"
        write_results({args.out: text, args.table: page(lines, when, args.seed)})
    except OSError as error:
        return refuse("recursion", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(lines)} lines\n")
    return 0


def _lines(rover: str, times_s: tuple[float, ...], pieces: list[Piece[Record]]) -> list[Line]:
    """Return the lines of the batches that are done."""
    done = [record for piece in pieces if (record := read_record(piece.path))]
    return cells(rover, done, times_s) if done else []


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("recursion", __doc__)
    parser.add_argument(
        "--rover", nargs="+", choices=ROVERS, default=ROVERS, help="rovers on loose sand"
    )
    parser.add_argument(
        "--short", type=COUNT, default=4, help=f"batches of {SHORT_BATCH} drives of 40 s"
    )
    parser.add_argument(
        "--long", type=COUNT, default=10, help=f"batches of {LONG_BATCH} drives of 400 s"
    )
    parser.add_argument(
        "--seed",
        type=SEED,
        default=26_000_000,
        help="of all that is drawn; not the one of any training or choice",
    )
    add_record_options(parser, "recursion", "batch")
    return parser


def _pieces(args: argparse.Namespace) -> dict[tuple[str, tuple[float, ...]], list[Piece[Record]]]:
    """Return the batches by rover and by the times at which their drives are judged."""
    folder = args.records / f"{digest('recursion')}-{args.seed}"
    kinds = (
        ("short", args.short, SHORT_BATCH, SHORT_S, args.seed),
        ("long", args.long, LONG_BATCH, LONG_S, args.seed + _LONG_SEED),
    )
    return {
        (rover, times): [
            Piece(
                partial(study, rover, drives, times, first + k), folder / f"{rover}-{name}-{k}.npz"
            )
            for k in range(count)
        ]
        for rover in args.rover
        for name, count, drives, times, first in kinds
    }


if __name__ == "__main__":
    sys.exit(main())
