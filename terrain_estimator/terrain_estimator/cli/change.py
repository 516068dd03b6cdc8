# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``change``: drive onto other ground and judge how soon the estimator says so and follows; a JSON file and a page of tables."""

import argparse
import dataclasses
import json
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from datetime import UTC, datetime
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import torch

from terrain_estimator.cli.change_table import Run, page
from terrain_estimator.cli.progress import ProgressReport
from terrain_estimator.config import CoreConfig
from terrain_estimator.learning.change import Change, ChangeScore, FalseAlarms, study_change, study_constant
from terrain_estimator.learning.study import ROVERS, SOILS
from terrain_estimator.model_file import ModelFileError, load_model
from terramechanics.loading import ConfigError

LOOSE, COMPACT, REGOLITH = SOILS
KINDS = (
    (LOOSE, COMPACT, 0.0),
    (COMPACT, LOOSE, 0.0),
    (LOOSE, LOOSE, 0.0),
    (LOOSE, REGOLITH, 0.0),
    (LOOSE, LOOSE, 20.0),
    (LOOSE, LOOSE, 60.0),
)
"""Soil before, soil after, and the time of a gradual change [s]."""


def main(argv: list[str] | None = None) -> int:
    """Entry point. 0: measured, whatever the figures are; 2: an argument is wrong or a file cannot be read or written."""
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    try:
        config = CoreConfig(drift=args.drift)
        for rover in args.rover:
            load_model(rover)
        results = _measure(_jobs(args, config), args.jobs)
        scores = [result for result in results if isinstance(result, ChangeScore)]
        alarms = [result for result in results if isinstance(result, FalseAlarms)]
        run = Run(datetime.now(UTC).date().isoformat(), args.drives, args.seed, args.drift, scores, alarms)
        for path, text in ((args.out, json.dumps(dataclasses.asdict(run), indent=1) + "\n"), (args.table, page(run))):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    except (ModelFileError, ConfigError, OSError) as error:
        sys.stderr.write(f"change: {error}\n")
        return 2
    sys.stdout.write(f"{args.out} and {args.table}: {len(scores)} changes of {args.drives} drives\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="change", description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--drives", type=int, default=100, help="drives of each change")
    parser.add_argument("--hours", type=float, default=20.0, help="simulated hours on constant ground, for each rover")
    parser.add_argument("--seed", type=int, default=6_000_000, help="of all that is drawn; not the one of any choice")
    parser.add_argument("--rover", nargs="+", choices=ROVERS, default=ROVERS, help="rovers, each with its model of several soils")
    parser.add_argument("--drift", type=float, default=CoreConfig().drift, help="the estimator's parameter drift [1/sqrt(s)]")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time; the results do not depend on it")
    parser.add_argument("--out", type=Path, default=Path("out/change.json"), help="file of all figures")
    parser.add_argument("--table", type=Path, default=Path("docs/change.md"), help="page of the tables")
    return parser


Result = ChangeScore | FalseAlarms


def _jobs(args: argparse.Namespace, config: CoreConfig) -> list[Callable[[], Result]]:
    jobs: list[Callable[[], Result]] = []
    for rover in args.rover:
        for index, (before, after, gradual) in enumerate(KINDS):
            jobs.append(partial(judge_change, Change(rover, before, after, gradual), config, args.drives, args.seed + index))
        for index, soil in enumerate(SOILS if args.hours > 0.0 else ()):
            jobs.append(partial(judge_constant, rover, soil, config, args.hours / len(SOILS), args.seed + 100 + index))
    return jobs


def judge_change(change: Change, config: CoreConfig, drives: int, seed: int) -> ChangeScore:
    """One change with the rover's model."""
    return study_change(change, load_model(change.rover), config, drives, seed)


def judge_constant(rover: str, soil: str, config: CoreConfig, hours: float, seed: int) -> FalseAlarms:
    """Constant ground with the rover's model."""
    return study_constant(load_model(rover), soil, config, hours, seed)


def _measure(jobs: Sequence[Callable[[], Result]], processes: int) -> list[Result]:
    """Results in the order of the jobs, whatever finishes first."""
    results: dict[int, Result] = {}
    with ProgressReport(f"change: {len(jobs)} settings") as report:
        if processes == 1:
            for index, job in enumerate(jobs):
                results[index] = job()
                report.at(len(results) / len(jobs), "")
        else:
            with ProcessPoolExecutor(processes, get_context("spawn"), torch.set_num_threads, (1,)) as pool:
                futures = {pool.submit(job): index for index, job in enumerate(jobs)}
                for future in as_completed(futures):
                    results[futures[future]] = future.result()
                    report.at(len(results) / len(jobs), "")
    return [results[index] for index in range(len(jobs))]


if __name__ == "__main__":
    sys.exit(main())
