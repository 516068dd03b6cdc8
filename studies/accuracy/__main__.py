# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m studies.accuracy``: judge the estimator on simulated drives with known truth; a JSON file and a page of tables.

Drives are computed in batches, each of which is kept: a run that was ended, or had no more time,
goes on where it was.
"""

import argparse
import dataclasses
import json
import math
import os
import sys
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import torch

from studies.accuracy.cells import SIDE_BATCHES, CellBatch, Setting, is_main, settings, study
from studies.accuracy.lines import lines
from studies.accuracy.pieces import read_part, write_part
from studies.accuracy.scores import LONG_TIMES_S
from studies.accuracy.table import AccuracyRun, page
from studies.records import Piece, compute, digest, write_results
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.tasks import ROVERS, SOILS
from terramechanics.simulation.schedules import SCHEDULES

BATCH = 100
"""Drives of a setting that are computed at once."""
LONG_SHARE = 0.4
"""[1] Of these where drives are long."""
_CONSTANTS = ("exact", "wrong")


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Entry point. 0: measured, whatever the figures are; 1: no time for one batch of each setting; 2: an argument or a file is wrong."""
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    chosen = [setting for setting in settings() if _is_chosen(setting, args)]
    if not chosen:
        sys.stderr.write(
            "studies.accuracy: no such setting: S2, S3 and S4 are driven on loose_sand with exact"
            " constants\n"
        )
        return 2
    batches = _batches(chosen, args)
    try:
        missing = [batch for _, batch in batches if read_part(batch.path) is None]
        compute("accuracy", missing, args.jobs, args.minutes, write_part)
        run = _gathered(batches, args)
        if run is None:
            sys.stderr.write(
                "studies.accuracy: not one batch of every setting was done in this time; call it again, it"
                " goes on where it was\n"
            )
            return 1
        write_results(
            {args.out: json.dumps(dataclasses.asdict(run), indent=1) + "\n", args.table: page(run)}
        )
    except OSError as error:
        sys.stderr.write(f"studies.accuracy: {error}\n")
        return 2
    sys.stdout.write(f"{args.out} and {args.table}: {len(run.cells)} cells\n")
    return 0


def _batches(
    chosen: list[Setting], args: argparse.Namespace
) -> list[tuple[Setting, Piece[CellBatch]]]:
    """Every setting's first batch, then every setting's second, and so on; after SIDE_BATCHES of the main settings alone."""
    folder, found = args.records / f"{digest()}-{args.seed}", []
    for number, start in enumerate(range(0, args.episodes, BATCH)):
        for setting in chosen if number < SIDE_BATCHES else filter(is_main, chosen):
            episodes = math.ceil(
                (LONG_SHARE if setting.times_s == LONG_TIMES_S else 1.0)
                * min(BATCH, args.episodes - start)
            )
            drives = (
                setting.rover,
                setting.soil,
                f"{setting.schedule}-{setting.times_s[-1]:g}s",
                _constants(setting),
                setting.truth,
            )
            place = (*drives, number, episodes)
            work = partial(study, setting, episodes, args.seed, number)
            found.append((setting, Piece(work, folder / ("-".join(map(str, place)) + ".npz"))))
    return found


def _gathered(
    batches: list[tuple[Setting, Piece[CellBatch]]], args: argparse.Namespace
) -> AccuracyRun | None:
    """The figures of all batches that are done, None where a setting has none."""
    parts: dict[Setting, list[CellBatch]] = {setting: [] for setting, _ in batches}
    for setting, batch in batches:
        if part := read_part(batch.path):
            parts[setting].append(part)
    if not all(parts.values()):
        return None
    first = [of_setting[0] for of_setting in parts.values()]
    return AccuracyRun(
        date=datetime.now(UTC).date().isoformat(),
        episodes=args.episodes,
        seed=args.seed,
        cells=[
            line for setting, of_setting in parts.items() for line in lines(setting, of_setting)
        ],
        reference=[check for part in first for check in part.reference],
        net=[share for part in first for share in part.net],
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="studies.accuracy",
        description=__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument(
        "--episodes",
        type=COUNT,
        default=1000,
        help="drives of 40 s over hills a cell; 200 where other things change, 80 of 400 s at most",
    )
    parser.add_argument(
        "--seed",
        type=SEED,
        default=5_000_000,
        help="of all that is drawn; not the one of any training",
    )
    parser.add_argument("--rover", nargs="+", choices=ROVERS, default=ROVERS, help="rovers")
    parser.add_argument("--soil", nargs="+", choices=SOILS, default=SOILS, help="soils")
    parser.add_argument(
        "--schedule", nargs="+", choices=SCHEDULES, default=SCHEDULES, help="schedules"
    )
    parser.add_argument(
        "--constants",
        nargs="+",
        choices=_CONSTANTS,
        default=_CONSTANTS,
        help="soil constants known exactly, or 5 %% wrong",
    )
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
        default=Path("out/accuracy"),
        help="folder of what is kept of every batch",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/accuracy.json"), help="file of all figures"
    )
    parser.add_argument(
        "--table", type=Path, default=Path("docs/accuracy.md"), help="page of the tables"
    )
    return parser


def _constants(setting: Setting) -> str:
    return "wrong" if setting.spread else "exact"


def _is_chosen(setting: Setting, args: argparse.Namespace) -> bool:
    constants = _constants(setting)
    here = (
        setting.rover in args.rover,
        setting.soil in args.soil,
        setting.schedule in args.schedule,
        constants in args.constants,
    )
    return all(here)


if __name__ == "__main__":
    sys.exit(main())
