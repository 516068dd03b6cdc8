# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drive onto other ground and judge how soon the estimator detects it and follows.

Run by ``make change``; writes a JSON file and a page of tables.

Drives are computed in parts, each of which is kept: a run that was ended, or had no more time, goes
on where it was.
"""

import argparse
import dataclasses
import json
import sys
import zlib
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from docs.provenance import digest, measured
from rover_parameters.records import ConfigError
from studies.change.drives import (
    Change,
    FalseAlarms,
    Followed,
    judge_change,
    judge_constant,
    pool,
)
from studies.change.scores import score_change
from studies.change.table import ChangeRun, page
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.records import Piece, compute, read_record, write_record, write_results
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO
from terrain_estimator.console.arguments import SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.tasks import ROVERS, SOILS
from terrain_estimator.model.metadata import ModelFileError

LOOSE, COMPACT, REGOLITH = SOILS
FORGETTING_S = 60.0
KINDS = (
    (LOOSE, COMPACT),
    (COMPACT, LOOSE),
    (LOOSE, LOOSE),
    (LOOSE, REGOLITH),
    (REGOLITH, COMPACT),
    (LOOSE, LOOSE, 20.0),
    (LOOSE, LOOSE, 60.0),
    (LOOSE, LOOSE, 20.0, FORGETTING_S),
    (LOOSE, LOOSE, 60.0, FORGETTING_S),
)
"""Soil before, soil after, the time of a gradual change [s], and the forgetting_time [s]."""
PART_DRIVES = 25
"""Drives of a change that are computed at once."""
PART_HOURS = 1.0
"""[h] Time on constant ground that is computed at once."""


class _Constant(NamedTuple):
    """Ground that does not change."""

    rover: str
    soil: str


_Result = Followed | FalseAlarms
_Part = tuple[Change | _Constant, Piece[_Result]]


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for one part of each line; 2 an
    argument or a file is wrong.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    try:
        models = [load(rover, AUTO).model.metadata.model_id for rover in args.rover]
        parts = _parts(args)
        missing = [piece for _, piece in parts if read_record(piece.path) is None]
        compute("change", missing, args.jobs, args.minutes, _keep)
        run = _gathered(parts, args, models)
        if run is None:
            return refuse_too_short("change", "part of every line")
        write_results(
            {args.out: json.dumps(dataclasses.asdict(run), indent=1) + "\n", args.table: page(run)}
        )
    except (ModelFileError, ConfigError, OSError) as error:
        return refuse("change", error)
    sys.stdout.write(
        f"{args.out} and {args.table}: {len(run.changes)} changes,"
        f" {sum(score.drives[0] for score in run.changes)} drives\n"
    )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("change", __doc__)
    parser.add_argument("--drives", type=int, default=300, help="drives of each change")
    parser.add_argument(
        "--hours",
        type=float,
        default=60.0,
        help="simulated hours on constant ground, for each rover; 0: none",
    )
    parser.add_argument(
        "--seed",
        type=SEED,
        default=6_000_000,
        help="of all that is drawn; not the one of any choice",
    )
    parser.add_argument(
        "--rover",
        nargs="+",
        choices=ROVERS,
        default=ROVERS,
        help="rovers, each with its model of several soils",
    )
    add_record_options(parser, "change", "part")
    return parser


def _parts(args: argparse.Namespace) -> list[_Part]:
    """Return the first part of every line, then the second, and so on, each with its own seed."""
    found: list[tuple[int, _Part]] = []
    folder = args.records / f"{digest('change')}-{args.seed}"
    for rover in args.rover:
        for change in (Change(rover, *kind) for kind in KINDS):
            for number, drives in enumerate(_shares(args.drives, PART_DRIVES)):
                times = f"{change.gradual_s:g}-{change.forgetting_s:g}"
                kind = f"{change.before}-{change.after}-{times}"
                name = f"{rover}-{kind}-{number}-{drives:g}"
                seed = _seed(args.seed, name)
                follow = partial(judge_change, change, int(drives), seed)
                found.append((number, (change, Piece(follow, folder / f"{name}.npz"))))
        for constant in (_Constant(rover, soil) for soil in SOILS):
            for number, hours in enumerate(_shares(args.hours / len(SOILS), PART_HOURS)):
                name = f"{rover}-{constant.soil}-{number}-{hours:g}"
                seed = _seed(args.seed, name)
                watch = partial(judge_constant, *constant, hours, seed)
                found.append((number, (constant, Piece(watch, folder / f"{name}.npz"))))
    return [part for _, part in sorted(found, key=lambda numbered: numbered[0])]


def _seed(seed: int, name: str) -> int:
    """Return the seed of a part."""
    return seed + zlib.crc32(name.encode()) % 1_000_000


def _shares(whole: float, share: float) -> Iterable[float]:
    """Yield ``whole`` in pieces of ``share``; the last is the rest."""
    done = 0.0
    while whole - done > 1e-9:
        yield min(share, whole - done)
        done += share


def _keep(result: _Result, path: Path) -> None:
    fields = result._asdict() if isinstance(result, Followed) else dataclasses.asdict(result)
    write_record({name: np.asarray(value) for name, value in fields.items()}, path)


def _gathered(parts: list[_Part], args: argparse.Namespace, models: list[str]) -> ChangeRun | None:
    """Return the figures of all parts that are done, None where a line of the tables has none."""
    changes: dict[Change, list[Followed]] = {}
    constant: dict[_Constant, list[FalseAlarms]] = {}
    for line, piece in parts:
        record = read_record(piece.path)
        if isinstance(line, Change):
            changes.setdefault(line, []).extend([] if record is None else [Followed(**record)])
        else:
            found = (
                []
                if record is None
                else [FalseAlarms(**{name: value.item() for name, value in record.items()})]
            )
            constant.setdefault(line, []).extend(found)
    followed = [(change, pool(of_change, change)) for change, of_change in changes.items()]
    if not all(len(drives.error) for _, drives in followed) or not all(constant.values()):
        return None
    scores = [score_change(change, drives) for change, drives in followed]
    alarms = [
        FalseAlarms(
            *line,
            sum(e.hours for e in each),
            sum(e.alarms for e in each),
            sum(e.disagreements for e in each),
        )
        for line, each in constant.items()
    ]
    return ChangeRun(
        measured("change"),
        args.drives,
        args.hours,
        args.seed,
        models,
        scores,
        alarms,
    )


if __name__ == "__main__":
    sys.exit(main())
