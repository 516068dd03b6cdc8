# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Judge the estimator on simulated drives with known truth; called by ``make accuracy``.

Writes a JSON file and two pages of tables. Drives are computed in batches, each of which is kept: a
run that ended early continues where it was.
"""

import argparse
import dataclasses
import json
import sys
from functools import partial

import torch

from docs.provenance import digest, measured
from studies.accuracy.cells import SIDE_BATCHES, CellBatch, Setting, is_main, settings, study
from studies.accuracy.lines import lines
from studies.accuracy.pieces import read_part, write_part
from studies.accuracy.table import AccuracyRun, page, tables_page
from studies.command import add_record_options, refuse, refuse_too_short, study_parser
from studies.records import Piece, compute, write_results
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.tasks import ROVERS, SOILS
from terramechanics.simulation.schedules import SCHEDULES

BATCH = 100
"""Drives of a setting that are computed at once."""
_CONSTANTS = ("exact", "wrong")


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the study.

    Exit codes: 0 measured, whatever the figures are; 1 no time for one batch of each setting; 2 an
    argument or a file is wrong.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    chosen = [setting for setting in settings() if _is_chosen(setting, args)]
    if not chosen:
        return refuse(
            "accuracy",
            "no such setting: S2, S3 and S4 are driven on loose_sand with exact constants",
        )
    batches = _batches(chosen, args)
    try:
        missing = [batch for _, batch in batches if read_part(batch.path) is None]
        compute("accuracy", missing, args.jobs, args.minutes, write_part)
        run = _gathered(batches, args)
        if run is None:
            return refuse_too_short("accuracy", "batch of every setting")
        figures = json.dumps(dataclasses.asdict(run), indent=1) + "\n"
        tables = args.table.with_name(f"{args.table.stem}_tables.md")
        write_results({args.out: figures, args.table: page(run), tables: tables_page(run)})
    except OSError as error:
        return refuse("accuracy", error)
    sys.stdout.write(f"{args.out}, {args.table} and {tables}: {len(run.cells)} cells\n")
    return 0


def _batches(
    chosen: list[Setting], args: argparse.Namespace
) -> list[tuple[Setting, Piece[CellBatch]]]:
    """Return every setting's first batch, then every setting's second, and so on.

    After SIDE_BATCHES only the main settings have batches.
    """
    folder, found = args.records / f"{digest('accuracy')}-{args.seed}", []
    for number, start in enumerate(range(0, args.episodes, BATCH)):
        for setting in chosen if number < SIDE_BATCHES else filter(is_main, chosen):
            episodes = min(BATCH, args.episodes - start)
            drives = (
                setting.rover,
                setting.soil,
                setting.schedule,
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
    """Return the figures of all batches that are done, None where a setting has none."""
    parts: dict[Setting, list[CellBatch]] = {setting: [] for setting, _ in batches}
    for setting, batch in batches:
        if part := read_part(batch.path):
            parts[setting].append(part)
    if not all(parts.values()):
        return None
    first = [of_setting[0] for of_setting in parts.values()]
    return AccuracyRun(
        measured=measured("accuracy"),
        episodes=args.episodes,
        seed=args.seed,
        cells=[
            line for setting, of_setting in parts.items() for line in lines(setting, of_setting)
        ],
        reference=[check for part in first for check in part.reference],
        net=[share for part in first for share in part.net],
    )


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("accuracy", __doc__)
    parser.add_argument(
        "--episodes",
        type=COUNT,
        default=1000,
        help="drives of 40 s over hills a cell; 200 where other things change",
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
    add_record_options(parser, "accuracy", "batch")
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
