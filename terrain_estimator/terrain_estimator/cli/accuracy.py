# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``accuracy``: judge the estimator on simulated drives with known truth; a JSON file and a page of tables.

Drives are computed in batches, each of which is kept: a run that was ended, or had no more time, goes on where it was.
"""

import argparse
import dataclasses
import itertools
import json
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import torch

from terrain_estimator.cli.accuracy_lines import lines
from terrain_estimator.cli.accuracy_records import digest, read_part, write_part
from terrain_estimator.cli.accuracy_table import Run, page
from terrain_estimator.cli.progress import ProgressReport
from terrain_estimator.learning.study import ROVERS, SIDE_BATCHES, SOILS, Part, Setting, is_main, settings, study
from terramechanics.schedules import SCHEDULES

BATCH = 100
"""Drives of a setting that are computed at once."""
_CONSTANTS = ("exact", "wrong")


class _Batch(NamedTuple):
    """A piece of work and where its result is kept."""

    setting: Setting
    number: int
    episodes: int
    path: Path


def main(argv: list[str] | None = None) -> int:
    """Entry point. 0: measured, whatever the figures are; 1: no time for one batch of each setting; 2: an argument or a file is wrong."""
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    chosen = [setting for setting in settings() if _is_chosen(setting, args)]
    if not chosen:
        sys.stderr.write("accuracy: no such setting: S2, S3 and S4 are driven on loose_sand with exact constants\n")
        return 2
    batches = _batches(chosen, args)
    try:
        _compute([batch for batch in batches if read_part(batch.path) is None], args)
        run = _gathered(batches, args)
        if run is None:
            sys.stderr.write("accuracy: not one batch of every setting was done in this time; call it again, it goes on where it was\n")
            return 1
        for path, text in ((args.out, json.dumps(dataclasses.asdict(run), indent=1) + "\n"), (args.table, page(run))):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        sys.stderr.write(f"accuracy: {error}\n")
        return 2
    sys.stdout.write(f"{args.out} and {args.table}: {len(run.cells)} cells\n")
    return 0


def _batches(chosen: list[Setting], args: argparse.Namespace) -> list[_Batch]:
    """Every setting's first batch, then every setting's second, and so on; after SIDE_BATCHES of the main settings alone."""
    folder, found = args.records / f"{digest()}-{args.seed}", []
    for number, start in enumerate(range(0, args.episodes, BATCH)):
        episodes = min(BATCH, args.episodes - start)
        for setting in chosen if number < SIDE_BATCHES else filter(is_main, chosen):
            place = (setting.rover, setting.soil, setting.schedule, _constants(setting), setting.truth, number, episodes)
            found.append(_Batch(setting, number, episodes, folder / ("-".join(map(str, place)) + ".npz")))
    return found


def _gathered(batches: list[_Batch], args: argparse.Namespace) -> Run | None:
    """The figures of all batches that are done, None where a setting has none."""
    parts: dict[Setting, list[Part]] = {batch.setting: [] for batch in batches}
    for batch in batches:
        if part := read_part(batch.path):
            parts[batch.setting].append(part)
    if not all(parts.values()):
        return None
    first = [of_setting[0] for of_setting in parts.values()]
    return Run(
        date=datetime.now(UTC).date().isoformat(),
        episodes=args.episodes,
        seed=args.seed,
        cells=[line for setting, of_setting in parts.items() for line in lines(setting, of_setting)],
        reference=[check for part in first for check in part.reference],
        net=[share for part in first for share in part.net],
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="accuracy", description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument(
        "--episodes", type=int, default=1000, help="drives of 40 s a main cell, over hills with truth from the prior; at most 200 of others"
    )
    parser.add_argument("--seed", type=int, default=5_000_000, help="of all that is drawn; not the one of any training")
    parser.add_argument("--rover", nargs="+", choices=ROVERS, default=ROVERS, help="rovers")
    parser.add_argument("--soil", nargs="+", choices=SOILS, default=SOILS, help="soils")
    parser.add_argument("--schedule", nargs="+", choices=SCHEDULES, default=SCHEDULES, help="schedules")
    parser.add_argument(
        "--constants", nargs="+", choices=_CONSTANTS, default=_CONSTANTS, help="soil constants known exactly, or 5 %% wrong"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time; the results do not depend on it")
    parser.add_argument("--minutes", type=float, default=0.0, help="after which no batch is begun; 0: until all is done")
    parser.add_argument("--records", type=Path, default=Path("out/accuracy"), help="folder of what is kept of every batch")
    parser.add_argument("--out", type=Path, default=Path("out/accuracy.json"), help="file of all figures")
    parser.add_argument("--table", type=Path, default=Path("docs/accuracy.md"), help="page of the tables")
    return parser


def _constants(setting: Setting) -> str:
    return "wrong" if setting.spread else "exact"


def _is_chosen(setting: Setting, args: argparse.Namespace) -> bool:
    constants = _constants(setting)
    here = (setting.rover in args.rover, setting.soil in args.soil, setting.schedule in args.schedule, constants in args.constants)
    return all(here)


def _compute(missing: list[_Batch], args: argparse.Namespace) -> None:
    """Compute and keep these batches, as many as there is time for."""
    end = time.monotonic() + 60.0 * args.minutes if args.minutes else float("inf")
    with ProgressReport(f"accuracy: {len(missing)} batches") as report:
        for done, (batch, part) in enumerate(_finished(missing, args, end), 1):
            write_part(part, batch.path)
            report.at(done / len(missing), batch.path.stem)


def _finished(missing: list[_Batch], args: argparse.Namespace, end: float) -> Iterator[tuple[_Batch, Part]]:
    """Results as they come; after ``end`` no batch is begun."""
    waiting = itertools.takewhile(lambda _: time.monotonic() < end, missing)
    if args.jobs == 1:
        for batch in waiting:
            yield batch, study(batch.setting, batch.episodes, args.seed, batch.number)
        return
    with ProcessPoolExecutor(args.jobs, get_context("spawn"), torch.set_num_threads, (1,)) as pool:
        running: dict[Future[Part], _Batch] = {}
        while True:
            for batch in itertools.islice(waiting, args.jobs - len(running)):
                running[pool.submit(study, batch.setting, batch.episodes, args.seed, batch.number)] = batch
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()


if __name__ == "__main__":
    sys.exit(main())
