# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge the estimator beside a posterior that shares no rows with it.

Called by ``make independent-reference``; writes a JSON file and a page. Every drive is kept: a run
that ended early continues where it was.
"""

import argparse
import json
import sys
from dataclasses import asdict
from functools import partial

import torch

from docs.provenance import digest, measured
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.independent_reference.drives import Compared, Place, compare
from studies.independent_reference.table import page, score
from studies.records import Piece, compute, read_record, write_record, write_results
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible

PLACES = tuple(Place("mars_rover", "loose_sand", torque) for torque in (True, False))


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for one drive of each row set; 2 a
    file cannot be read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    pieces = _pieces(args)
    every = [piece for of_place in pieces.values() for piece in of_place]
    try:
        missing = [piece for piece in every if read_record(piece.path) is None]
        compute(
            "studies.independent_reference",
            missing,
            args.jobs,
            args.minutes,
            lambda compared, path: write_record(asdict(compared), path),
        )
        scores = {place: score(place, done) for place in PLACES if (done := _done(pieces[place]))}
        if len(scores) < len(PLACES):
            return refuse_too_short("independent_reference", "drive of each row set")
        when = measured("independent-reference")
        lines = [asdict(each) for each in scores.values()]
        text = json.dumps({"measured": when, "seed": args.seed, "scores": lines}, indent=1) + "\n"
        shown = page(list(scores.values()), when, args.seed)
        write_results({args.out: text, args.table: shown})
    except OSError as error:
        return refuse("independent_reference", error)
    sys.stdout.write(f"{args.out} and {args.table}: {len(scores)} row sets\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("independent_reference", __doc__)
    parser.add_argument("--drives", type=COUNT, default=20, help="of 10 s each, by row set")
    parser.add_argument(
        "--twice",
        type=int,
        default=3,
        help="first drives with every row that are judged once more, by twice as many samples",
    )
    parser.add_argument(
        "--seed",
        type=SEED,
        default=41_000_000,
        help="of all that is drawn; not the one of any training or choice",
    )
    add_record_options(parser, "independent_reference", "drive")
    return parser


def _pieces(args: argparse.Namespace) -> dict[Place, list[Piece[Compared]]]:
    """Return the drives of each row set."""
    folder = args.records / f"{digest('independent-reference')}-{args.seed}"
    found: dict[Place, list[Piece[Compared]]] = {}
    for place in PLACES:
        name = f"{place.rover}-{place.soil}-{'M' if place.torque else 'no-M'}"
        for drive in range(args.drives):
            twice = place.torque and drive < args.twice
            path = folder / f"{name}-{drive}{'-twice' if twice else ''}.npz"
            work = partial(compare, place, drive, args.seed, twice=twice)
            found.setdefault(place, []).append(Piece(work, path))
    return found


def _done(pieces: list[Piece[Compared]]) -> list[Compared]:
    """Return the drives that are done."""
    records = (read_record(piece.path) for piece in pieces)
    return [Compared(**record) for record in records if record]


if __name__ == "__main__":
    sys.exit(main())
