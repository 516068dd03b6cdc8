# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge a candidate test of consistency that names rows.

Judged are its false alarms on honest drives and its power on hidden effects and foreign laws. The
test that ships adds up whole seconds (``terrain_estimator.estimator.consistency``). Thresholds come
from one half of the seeds and are judged on the other. Called by ``make consistency``, after ``make
foreign``, whose records it reads; writes out/consistency.json and .md. Every batch of drives is
kept: a run that ended early continues where it was.
"""

import argparse
import json
import sys
from collections.abc import Iterable
from dataclasses import asdict
from functools import partial
from pathlib import Path

import torch

from docs.provenance import commit
from studies.command import add_record_options, refuse, study_parser
from studies.consistency.power import Power, foreign_power, judge, page
from studies.consistency.sequences import Record, hidden, honest
from studies.records import Piece, compute, read_record, write_record, write_results
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.tasks import ROVERS
from tests.hidden.generators import GENERATORS
from tests.hidden.ground import SOILS

DRIVES, SECONDS = 45, 100.0
"""Of an honest batch: 1.25 h."""
CASES = 1
"""Hidden cases of eight drives of a minute in a batch."""


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study on what is there after the given minutes.

    Exit codes: 0 judged; 1 no honest drives yet; 2 a file cannot be read or written.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    pieces = _pieces(args)
    try:
        missing = [piece for piece in pieces.values() if read_record(piece.path) is None]
        compute("studies.consistency", missing, args.jobs, args.minutes, _keep)
        halves = [list(_done(pieces, f"honest-{half}-")) for half in range(2)]
        if not all(halves):
            return refuse("consistency", "not one honest batch of each half is done", 1)
        found = judge(halves[0], halves[1])
        powers = [
            *(found.power(name, list(_done(pieces, f"hidden-{name}-"))) for name in _effects()),
            *foreign_power(found, args.foreign),
        ]
        known = [each for each in powers if each.drives]
        write_results(_results(args, found.page(commit()) + page(known), known))
    except OSError as error:
        return refuse("consistency", error)
    sys.stdout.write(f"{args.table}: {len(known)} cases\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("consistency", __doc__)
    parser.add_argument("--parts", type=COUNT, default=2, help="honest batches of a half and cell")
    parser.add_argument("--seed", type=SEED, default=41_000_000, help="of all that is drawn")
    parser.add_argument(
        "--foreign", type=Path, default=Path("out/foreign"), help="records of make foreign"
    )
    add_record_options(parser, "consistency", "batch")
    parser.set_defaults(table=Path("out/consistency.md"))
    return parser


def _effects() -> list[str]:
    return ["none", *GENERATORS]


def _pieces(args: argparse.Namespace) -> dict[str, Piece[Record]]:
    """Return the batches by name: the first honest ones, hidden effects, the other honest ones."""
    cells = [(rover, soil) for rover in ROVERS for soil in SOILS]
    works = {}
    for part in range(args.parts):
        for k, (rover, soil) in enumerate(cells):
            for half in range(2):
                seed = args.seed + 100_000 * half + 100 * part + k
                work = partial(honest, rover, soil, DRIVES, SECONDS, seed)
                works[f"honest-{half}-{rover}-{soil}-{part}"] = work
        for soil in SOILS if part == 0 else ():
            for name in _effects():
                effect = "" if name == "none" else name
                work = partial(hidden, effect, 1.0, soil, CASES, args.seed + 900_000)
                works[f"hidden-{name}-{soil}"] = work
    return {name: Piece(work, args.records / f"{name}.npz") for name, work in works.items()}


def _keep(record: Record, path: Path) -> None:
    write_record(record, path)


def _done(pieces: dict[str, Piece[Record]], first: str) -> Iterable[Record]:
    """Yield the records that are there, of the batches whose name begins so."""
    for name, piece in pieces.items():
        if name.startswith(first) and (record := read_record(piece.path)):
            yield record


def _results(args: argparse.Namespace, text: str, powers: list[Power]) -> dict[Path, str]:
    figures = {"commit": commit(), "cases": [asdict(each) for each in powers]}
    return {args.table: text, args.out: json.dumps(figures, indent=1) + "\n"}


if __name__ == "__main__":
    sys.exit(main())
