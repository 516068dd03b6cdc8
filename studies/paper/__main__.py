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

from rover_parameters.records import ConfigError
from studies.paper.cases import QUICK, Size
from studies.paper.experiment import CellResult, run
from studies.paper.figures import draw_all
from studies.paper.plants import PaperPlant
from studies.paper.published import ESTIMATES, TRADE_OFF
from studies.paper.tables import tables
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Entry point. 0: everything is written; 2: an argument or the output folder is wrong."""
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    size = dataclasses.replace(
        QUICK if args.quick else Size(), seed=args.seed, trainings=args.trainings
    )
    started_s = time.monotonic()
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        with ProgressReport("paper") as report:
            results = run(size, args.jobs, report.at)
        paths = _write(results, size, time.monotonic() - started_s, args.out)
    except (ConfigError, OSError, ValueError) as error:
        sys.stderr.write(f"studies.paper: {error}\n")
        return 2
    sys.stdout.write("".join(f"{path}\n" for path in paths))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="studies.paper",
        description=__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
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
    parser.add_argument("--jobs", type=COUNT, default=2, help="processes")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="run through everything in seconds; the numbers mean nothing",
    )
    return parser


def _write(results: list[CellResult], size: Size, seconds: float, folder: Path) -> list[Path]:
    """Tables, pictures and how they came about."""
    paths = []
    for plant in PaperPlant:
        cells = {result.cell.soil: result for result in results if result.cell.plant is plant}
        content = {
            soil: {"kept": result.kept, "testing": result.testing, "exact_constants": result.narrow}
            for soil, result in cells.items()
        }
        paths.append(folder / f"{plant.name.lower()}.json")
        paths[-1].write_text(json.dumps(content, indent=1) + "\n")
    how = {
        "size": dataclasses.asdict(size),
        "seconds": seconds,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    published = {"trade_off_percent": TRADE_OFF, "estimates_percent": ESTIMATES}
    paths += [folder / "run.json", folder / "tables.md"]
    paths[-2].write_text(
        json.dumps({**how, "torch": torch.__version__, "published": published}, indent=1) + "\n"
    )
    paths[-1].write_text(tables(results))
    return paths + draw_all(results, folder)


if __name__ == "__main__":
    sys.exit(main())
