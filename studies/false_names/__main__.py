# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Count false names on simulated tables of one wheel, foreign to the library.

Called by ``make names``; writes a JSON file and a page. Records of finished tables are kept,
so that the command goes on where it was.
"""

import argparse
import dataclasses
import json
import sys
from functools import partial
from pathlib import Path

import numpy as np

from docs.provenance import measured
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.false_names.drawn import HIDDEN
from studies.false_names.judged import Judged, judged
from studies.false_names.table import FalseNames, page
from studies.records import Piece, compute, read_record, write_record, write_results
from terrain_estimator.console.arguments import COUNT
from terrain_estimator.console.interrupting import interruptible

CALIBRATION_SEED = 101
"""Of the tables that were looked at when NAME was set."""
FROZEN = "3f2718e11335c709f795b96c5d26a2ba59911a1a"
"""Commit of the rule, from which the judged tables are drawn."""


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 the time was too short for one table; 2 a
    file cannot be read or written.
    """
    args = _parser().parse_args(argv)
    seed = int(args.frozen[:8], 16)
    parts = {
        "calibration": _pieces(args.records, CALIBRATION_SEED, args.calibration, hidden=False),
        "nothing": _pieces(args.records, seed, args.tables, hidden=False),
        "hidden": _pieces(args.records, seed, args.hidden, hidden=True),
    }
    # spread over each other, so that a run that ends early has some of each kind
    every = [
        piece
        for _, piece in sorted(
            (
                (k / len(pieces), piece)
                for pieces in parts.values()
                for k, piece in enumerate(pieces)
            ),
            key=lambda pair: pair[0],
        )
    ]
    try:
        missing = [piece for piece in every if not piece.path.exists()]
        compute("studies.false_names", missing, args.jobs, args.minutes, _keep)
        found = {
            name: [each for each in map(_read, pieces) if each is not None]
            for name, pieces in parts.items()
        }
        if not all(found.values()):
            return refuse_too_short("false_names", "table of each kind")
        run = FalseNames(measured("names"), args.frozen, seed, CALIBRATION_SEED, **found)
        text = json.dumps(dataclasses.asdict(run), indent=1) + "\n"
        write_results({args.out: text, args.table: page(run)})
    except OSError as error:
        return refuse("false_names", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(run.nothing)} tables of nothing\n")
    return 0


def _pieces(records: Path, seed: int, count: int, *, hidden: bool) -> list[Piece[Judged]]:
    kinds = [HIDDEN[k % len(HIDDEN)] if hidden else "" for k in range(count)]
    return [
        Piece(partial(judged, seed, k, kind), records / f"{seed}-{kind or 'nothing'}-{k}.npz")
        for k, kind in enumerate(kinds)
    ]


def _commit(text: str) -> str:
    """Return a commit in hexadecimal digits."""
    int(text[:8], 16)
    return text


def _keep(result: Judged, path: Path) -> None:
    write_record({"judged": np.array(json.dumps(dataclasses.asdict(result)))}, path)


def _read(piece: Piece[Judged]) -> Judged | None:
    stored = read_record(piece.path)
    return None if stored is None else Judged(**json.loads(str(stored["judged"])))


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("false_names", __doc__)
    parser.add_argument("--tables", type=COUNT, default=200, help="judged ones that lack nothing")
    parser.add_argument("--hidden", type=COUNT, default=40, help="judged ones that do lack")
    parser.add_argument("--calibration", type=COUNT, default=40, help="of the calibration")
    parser.add_argument(
        "--frozen",
        type=_commit,
        default=FROZEN,
        help="commit of the rule; its first eight digits are the seed of the judged tables",
    )
    add_record_options(parser, "false_names", "table")
    return parser


if __name__ == "__main__":
    sys.exit(main())
