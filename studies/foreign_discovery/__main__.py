# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Search for the missing effect on the drives in ``bags/foreign``, and compare with the truth.

Called by ``make foreign-discovery``; writes a JSON file and a page. Each search is kept: a run that
ended early continues where it was.
"""

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from docs.provenance import digest, measured
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.foreign.logs import log_names
from studies.foreign_discovery.searched import (
    DEFAULT,
    HELD_OUT,
    LAW,
    Searched,
    Signal,
    groups,
    searched,
)
from studies.foreign_discovery.table import page
from studies.records import Piece, compute, read_record, write_record, write_results
from terrain_estimator.console.arguments import SEED
from terrain_estimator.console.interrupting import interruptible

NAME = "foreign-discovery"


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for every search; 2 a file cannot be
    read or written, or there are no drives.
    """
    args = _parser().parse_args(argv)
    try:
        pieces = _pieces(args)
        missing = [piece for piece in pieces if read_record(piece.path) is None]
        compute(NAME, missing, args.jobs, args.minutes, _keep)
        kept = [read_record(piece.path) for piece in pieces]
        found = [_searched(json.loads(str(each["text"]))) for each in kept if each]
        if len(found) < len(pieces):
            return refuse_too_short(NAME, "search of every soil and law")
        when = measured(NAME)
        figures = {
            "measured": when,
            "seed": args.seed,
            "searches": [asdict(each) for each in found],
        }
        text = json.dumps(figures, indent=1) + "\n"
        write_results({args.out: text, args.table: page(found, when, args.seed)})
    except OSError as error:
        return refuse(NAME, error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(found)} searches\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser(NAME, __doc__)
    parser.add_argument("--seed", type=SEED, default=0, help="of the sensors' noise")
    add_record_options(parser, "foreign_discovery", "search")
    return parser


def _pieces(args: argparse.Namespace) -> list[Piece[Searched]]:
    """Return the searches; of drives that no run can prove also those with the law by name."""
    records, pieces, names = args.records / digest(NAME), [], log_names()
    for soil, law in groups():
        proven = f"{soil}_{HELD_OUT}_{law}" in names
        for library in (DEFAULT,) if proven else (DEFAULT, LAW):
            work = partial(searched, soil, law, library, args.seed)
            path = records / f"{soil}-{law}-{library}-{args.seed}.npz"
            pieces.append(Piece(work, path))
    return pieces


def _keep(found: Searched, path: Path) -> None:
    write_record({"text": np.array(json.dumps(asdict(found)))}, path)


def _searched(stored: Mapping[str, Any]) -> Searched:
    return Searched(**{**stored, "signals": tuple(Signal(**each) for each in stored["signals"])})


if __name__ == "__main__":
    sys.exit(main())
