# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``accuracy``: judge the estimator on simulated drives with known truth; a JSON file and a page of tables."""

import argparse
import dataclasses
import itertools
import json
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path

import torch

from terrain_estimator.cli.accuracy_table import Run, page
from terrain_estimator.cli.progress import ProgressReport
from terrain_estimator.learning.study import ROVERS, SOILS, Outcome, Setting, settings, study
from terramechanics.schedules import SCHEDULES

_CONSTANTS = ("exact", "wrong")


def main(argv: list[str] | None = None) -> int:
    """Entry point. 0: measured, whatever the figures are; 2: an argument is wrong or a file cannot be written."""
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    chosen = [setting for setting in settings() if _is_chosen(setting, args)]
    if not chosen:
        sys.stderr.write("accuracy: no such setting: S2, S3 and S4 are driven on loose_sand with exact constants\n")
        return 2
    outcomes = _in_order(chosen, args)
    run = Run(
        date=datetime.now(UTC).date().isoformat(),
        episodes=args.episodes,
        seed=args.seed,
        cells=list(itertools.chain.from_iterable(outcome.cells for outcome in outcomes)),
        reference=list(itertools.chain.from_iterable(outcome.reference for outcome in outcomes)),
        net=list(itertools.chain.from_iterable(outcome.net for outcome in outcomes)),
    )
    try:
        for path, text in ((args.out, json.dumps(dataclasses.asdict(run), indent=1) + "\n"), (args.table, page(run))):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        sys.stderr.write(f"accuracy: {error}\n")
        return 2
    sys.stdout.write(f"{args.out} and {args.table}: {len(run.cells)} cells of {run.episodes} episodes\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="accuracy", description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--episodes", type=int, default=1000, help="drives of 40 s a cell")
    parser.add_argument("--seed", type=int, default=5_000_000, help="of all that is drawn; not the one of any training")
    parser.add_argument("--rover", nargs="+", choices=ROVERS, default=ROVERS, help="rovers")
    parser.add_argument("--soil", nargs="+", choices=SOILS, default=SOILS, help="soils")
    parser.add_argument("--schedule", nargs="+", choices=SCHEDULES, default=SCHEDULES, help="schedules")
    parser.add_argument(
        "--constants", nargs="+", choices=_CONSTANTS, default=_CONSTANTS, help="soil constants known exactly, or 5 %% wrong"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time; the results do not depend on it")
    parser.add_argument("--out", type=Path, default=Path("out/accuracy.json"), help="file of all figures")
    parser.add_argument("--table", type=Path, default=Path("docs/accuracy.md"), help="page of the tables")
    return parser


def _is_chosen(setting: Setting, args: argparse.Namespace) -> bool:
    constants = "wrong" if setting.spread else "exact"
    here = (setting.rover in args.rover, setting.soil in args.soil, setting.schedule in args.schedule, constants in args.constants)
    return all(here)


def _in_order(chosen: list[Setting], args: argparse.Namespace) -> list[Outcome]:
    """The outcomes of all settings, in their order, whatever finishes first."""
    outcomes: dict[int, Outcome] = {}
    with ProgressReport(f"accuracy: {len(chosen)} settings of {args.episodes} drives") as report:
        for index, outcome in _finished(chosen, args):
            outcomes[index] = outcome
            setting = chosen[index]
            report.at(len(outcomes) / len(chosen), f"{setting.rover} {setting.soil} {setting.schedule}")
    return [outcomes[index] for index in range(len(chosen))]


def _finished(chosen: list[Setting], args: argparse.Namespace) -> Iterator[tuple[int, Outcome]]:
    if args.jobs == 1:
        for index, setting in enumerate(chosen):
            yield index, study(setting, args.episodes, args.seed)
        return
    with ProcessPoolExecutor(args.jobs, get_context("spawn"), torch.set_num_threads, (1,)) as pool:
        futures = {pool.submit(study, setting, args.episodes, args.seed): index for index, setting in enumerate(chosen)}
        for future in as_completed(futures):
            yield futures[future], future.result()


if __name__ == "__main__":
    sys.exit(main())
