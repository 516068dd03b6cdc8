# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run the experiments of Banerjee et al. on two plants; called by ``make paper``.

The plants are the closed form of their code and the integrated one of their text.
"""

import argparse
import dataclasses
import json
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import torch

from docs.provenance import measured
from rover_parameters.records import ConfigError
from studies.command import refuse, study_parser
from studies.paper.cases import QUICK, SOILS, Size
from studies.paper.experiment import CellResult, run
from studies.paper.figures import draw_all
from studies.paper.plants import PaperPlant
from studies.paper.published import ESTIMATES, TRADE_OFF
from studies.paper.random_inputs import SEEDS, SeedScores, compare_all
from studies.paper.tables import random_inputs_tables, tables
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.files.atomic import write_file

DRIVES, RANDOM_INPUTS = "drives", "random_inputs"


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run all experiments.

    Exit codes: 0 everything is written; 2 an argument or the output folder is wrong.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    size = dataclasses.replace(
        QUICK if args.quick else Size(), seed=args.seed, trainings=args.trainings
    )
    started_s = time.monotonic()
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        paths: list[Path] = []
        if args.only != RANDOM_INPUTS:
            with ProgressReport("paper") as report:
                results = run(size, args.jobs, report.at)
            paths += _write(results, size, time.monotonic() - started_s, args.out)
        if args.only != DRIVES:
            paths += _write_random_inputs(_compared(size, args), size, args)
    except (ConfigError, OSError, ValueError) as error:
        return refuse("paper", error)
    sys.stdout.write("".join(f"{path}\n" for path in paths))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = study_parser("paper", __doc__)
    parser.add_argument(
        "--out", type=Path, default=Path("out/paper"), help="folder of tables and pictures"
    )
    parser.add_argument("--seed", type=SEED, default=0, help="of everything that is drawn")
    parser.add_argument(
        "--trainings",
        type=COUNT,
        default=Size().trainings,
        help="of every model, from different seeds",
    )
    parser.add_argument(
        "--only",
        choices=(DRIVES, RANDOM_INPUTS),
        default="",
        help="leave out the training on random inputs, or everything else",
    )
    parser.add_argument("--jobs", type=COUNT, default=2, help="processes")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="run through everything in seconds; the numbers mean nothing",
    )
    return parser


def _compared(size: Size, args: argparse.Namespace) -> list[SeedScores]:
    results: list[SeedScores] = []
    seeds = 2 if args.quick else SEEDS
    with ProgressReport("paper") as report:
        for each in compare_all(size, args.jobs, seeds):
            results.append(each)
            report.at(len(results) / (seeds * len(SOILS)), "training on random inputs")
    return results


def _write_random_inputs(
    results: list[SeedScores], size: Size, args: argparse.Namespace
) -> list[Path]:
    """Write the comparison on random inputs; return its paths."""
    content = {"size": dataclasses.asdict(size), "seeds": [dataclasses.asdict(r) for r in results]}
    arguments = f"--only {args.only}" * bool(args.only)
    paths = [args.out / "random_inputs.json", args.out / "random_inputs.md"]
    write_file(paths[0], json.dumps(content, indent=1) + "\n")
    write_file(paths[1], f"{measured('paper', arguments)}\n\n{random_inputs_tables(results)}")
    return paths


def _write(results: list[CellResult], size: Size, seconds: float, folder: Path) -> list[Path]:
    """Write tables, pictures and the circumstances of the run; return their paths."""
    paths = []
    for plant in PaperPlant:
        cells = {result.cell.soil: result for result in results if result.cell.plant is plant}
        content = {
            soil: {"kept": result.kept, "testing": result.testing, "exact_constants": result.narrow}
            for soil, result in cells.items()
        }
        paths.append(folder / f"{plant.name.lower()}.json")
        write_file(paths[-1], json.dumps(content, indent=1) + "\n")
    arguments = f"--trainings {size.trainings}" * (size.trainings != Size().trainings)
    when = measured("paper", arguments)
    how = {
        "size": dataclasses.asdict(size),
        "seconds": seconds,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "measured": when,
    }
    published = {"trade_off_percent": TRADE_OFF, "estimates_percent": ESTIMATES}
    paths += [folder / "run.json", folder / "tables.md"]
    write_file(
        paths[-2],
        json.dumps({**how, "torch": torch.__version__, "published": published}, indent=1) + "\n",
    )
    write_file(paths[-1], f"{when}\n\n{tables(results)}")
    return paths + draw_all(results, folder)


if __name__ == "__main__":
    sys.exit(main())
