# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Slips, sinkages and velocity alone, by the commands: train, csv_to_bag and replay.

python -m studies.velocity_alone prints the table of docs/bring_your_own_data.md. It writes drives
of the paper's two plants as CSV, makes models with ``train --rows velocity``, imports each drive,
and replays it with each model. What is drawn and measured is that of studies/paper: drives of 40 s
on level ground, slip and sinkage to 5 %, velocity to 0.01 m/s.
"""

import csv
import itertools
import json
import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import torch

from studies.baselines.drives import LevelDrives
from studies.command import refuse, study_parser
from studies.paper.cases import Size
from studies.paper.plants import NARROW, TESTING, Draw, PaperPlant, draw_drives
from studies.paper.random_inputs import training_tasks
from studies.tables import table
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.learning.tasks import BENCHMARK, CONSTANTS_SPREAD
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import TIME_STEP

EXAMPLES = Path("docs/examples/closed_form")
DURATION_S, DRIVES, FIRST_SEED = 40.0, 40, 20261128
ROVER = "paper_rover"
WIDE = Draw(BENCHMARK.cohesion, BENCHMARK.angle)
"""Ground from the prior's range, with exact soil constants."""
WIDE_OFF = Draw(BENCHMARK.cohesion, BENCHMARK.angle, spread=CONSTANTS_SPREAD)
"""The same with soil constants wrong by up to 5 %."""
LINEAR, INTEGRALS = "linear_stress", "wong_reece"


@dataclass(frozen=True, slots=True)
class Told:
    """What a model takes for granted."""

    law: str  # of its soil
    constants_sd: float  # relative deviation of each soil constant


EXACT, UNCERTAIN = 0.0, DEFAULT_PRIOR.constants_sd


@dataclass(frozen=True, slots=True)
class Case:
    """Drives of one plant on one sand, and the models that estimate from them."""

    words: str
    plant: PaperPlant
    draw: Draw
    models: tuple[Told, ...]
    random: bool = False  # slips and sinkages are drawn at random, not driven

    def drives(self, sand: str, count: int, generator: torch.Generator) -> LevelDrives:
        """Draw and measure drives on one sand."""
        rover, soil = load_rover(ROVER), load_soil(sand)
        if self.random:
            size = Size(tasks=count, duration_s=DURATION_S)
            return training_tasks(self.draw, rover, soil, size, generator)
        return draw_drives(self.plant, rover, soil, self.draw, DURATION_S, count, generator).drives

    @property
    def alone(self) -> bool:
        """Whether each axle has one wheel."""
        return self.plant is PaperPlant.CLOSED_FORM

    @property
    def rover(self) -> str:
        """Name or file of the rover."""
        return str(EXAMPLES / "rover.yaml") if self.alone else ROVER

    @property
    def wheels(self) -> tuple[str, ...]:
        """Names of the wheels that are measured, front to rear."""
        return FRONT_TO_REAR if self.alone else tuple(f"{each}_left" for each in FRONT_TO_REAR)


FRONT_TO_REAR = ("front", "middle", "rear")
SANDS = ("loose_sand", "compact_sand")
_BOTH = (Told(LINEAR, EXACT), Told(LINEAR, UNCERTAIN))
CASES = {
    "closed": Case("closed form", PaperPlant.CLOSED_FORM, NARROW, (*_BOTH, Told(INTEGRALS, EXACT))),
    "closed_off": Case("closed form, constants off", PaperPlant.CLOSED_FORM, TESTING, _BOTH),
    "random": Case(
        "closed form, random slips and sinkages",
        PaperPlant.CLOSED_FORM,
        NARROW,
        _BOTH[:1],
        random=True,
    ),
    "integrated": Case("integrated", PaperPlant.INTEGRATED, WIDE, (Told(INTEGRALS, EXACT),)),
    "integrated_off": Case(
        "integrated, constants off",
        PaperPlant.INTEGRATED,
        WIDE_OFF,
        (Told(INTEGRALS, EXACT), Told(INTEGRALS, UNCERTAIN)),
    ),
}


@dataclass(frozen=True, slots=True)
class Result:
    """What a replay said of one drive, and the truth."""

    status: str
    truth: tuple[float, float]  # c [Pa], tan phi
    mean: tuple[float, float]
    lower: tuple[float, float]
    upper: tuple[float, float]

    @property
    def gave_estimate(self) -> bool:
        """Whether there is an estimate, not the prior."""
        return math.isfinite(self.mean[0])

    def error(self, index: int) -> float:
        """Return the relative error of c (0) or tan phi (1)."""
        return abs(self.mean[index] / self.truth[index] - 1.0)

    def holds(self, index: int) -> bool:
        """Return whether the 95 % interval holds the truth."""
        return self.lower[index] <= self.truth[index] <= self.upper[index]


def command(name: str, *arguments: str | Path, allowed: Sequence[int] = (0,)) -> None:
    """Run a command of the package. Raises RuntimeError with its words where it fails."""
    call = [sys.executable, "-m", f"terrain_estimator.cli.{name}", *map(str, arguments)]
    done = subprocess.run(call, check=False, capture_output=True, text=True)  # noqa: S603 (our own)
    if done.returncode not in allowed:
        raise RuntimeError(f"{name} ended with {done.returncode}: {done.stderr.strip()}")


def write_drive(path: Path, drives: LevelDrives, index: int, wheels: Sequence[str]) -> None:
    """Write what one drive measured, with a line for each step; slip and sinkage by wheel."""
    with path.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file)
        lines.writerow(
            ["t", *(f"slip_{each}" for each in wheels), *(f"z_{each}" for each in wheels), "v"]
        )
        for step in range(drives.slip.shape[1]):
            values = [
                *drives.slip[index, step].tolist(),
                *drives.sinkage[index, step].tolist(),
                float(drives.velocity[index, step + 1]),
            ]
            lines.writerow([f"{(step + 1) * TIME_STEP:.1f}", *map(repr, values)])


def mapping_of(case: Case, folder: Path) -> Path:
    """Return the mapping file of a case: that of the examples, for the wheels of its rover."""
    text = (EXAMPLES / "mapping.yaml").read_text(encoding="utf-8")
    for name, plain in zip(case.wheels, FRONT_TO_REAR, strict=True):
        text = text.replace(
            f"name: {plain}, slip: slip_{plain}, sinkage: z_{plain}",
            f"name: {name}, slip: slip_{name}, sinkage: z_{name}",
        )
    path = folder / "mapping.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def imported(case: Case, drives: LevelDrives, folder: Path) -> list[Path]:
    """Write the drives of a case as CSV to ``folder``, and import each; return the bags."""
    mapping, bags = mapping_of(case, folder), []
    for index in range(drives.slip.shape[0]):
        data, bag = folder / f"drive_{index}.csv", folder / f"drive_{index}"
        write_drive(data, drives, index, case.wheels)
        command("csv_to_bag", data, "--mapping", mapping, "--rover", case.rover, "--out", bag)
        bags.append(bag)
    return bags


def replayed(
    case: Case, told: Told, sand: str, bags: Sequence[Path], folder: Path
) -> list[dict[str, Any]]:
    """Make a model in ``folder`` and replay the bags; return what the summary says of each."""
    soil = str(EXAMPLES / f"{LINEAR}_{sand}.yaml") if told.law == LINEAR else sand
    command(
        "train", "--rover", case.rover, "--soil", soil, "--rows", "velocity",
        "--constants-sd", str(told.constants_sd), "--out", folder / "models",
        "--curves", folder / "curves",
    )  # fmt: skip
    model = next((folder / "models").glob("*.pt"))
    # 3: a bag gave no estimate, which the table counts
    command("replay", *bags, "--model", model, "--out", folder / "replay", allowed=(0, 3))
    text = (folder / "replay" / "summary.json").read_text(encoding="utf-8")
    bags_told: list[dict[str, Any]] = json.loads(text)["bags"]
    return bags_told


def judge(case: Case, sand: str, count: int, seed: int, folder: Path) -> Iterator[list[str]]:
    """Draw and import the drives of a case in a new ``folder``; yield a line for each model."""
    folder.mkdir(parents=True)
    drives = case.drives(sand, count, torch.Generator().manual_seed(seed))
    bags = imported(case, drives, folder)
    for number, told in enumerate(case.models):
        found = replayed(case, told, sand, bags, folder / str(number))
        truths = drives.strength.tolist()
        results = [result_of(*each) for each in zip(found, truths, strict=True)]
        words = [f"{case.words}, {sand.replace('_', ' ')}", told.law, f"{told.constants_sd:.2g}"]
        yield words + figures(results)


def result_of(told: dict[str, Any], truth: list[float]) -> Result:
    """Return what the summary of one replay says."""
    nothing = dict.fromkeys(("mean", "lower_95", "upper_95"), math.nan)
    found = [told["estimate"].get(name, nothing) for name in ("cohesion_pa", "tan_phi")]
    mean, lower, upper = (
        (found[0][key], found[1][key]) for key in ("mean", "lower_95", "upper_95")
    )
    return Result(str(told["status"]), (truth[0], truth[1]), mean, lower, upper)


def figures(results: Sequence[Result]) -> list[str]:
    """Return errors, intervals and statuses of some drives, as in the table."""
    given = [each for each in results if each.gave_estimate]
    errors = [100.0 * median(each.error(k) for each in given) for k in (0, 1)]
    held = [sum(each.holds(k) for each in given) for k in (0, 1)]
    return [
        f"{errors[0]:.3g} / {errors[1]:.3g} %",
        f"{held[0]} / {held[1]} of {len(given)}",
        str(sum(each.status == "IDENTIFIED" for each in results)),
        str(sum(each.status == "DISAGREES" for each in results)),
    ]


def main(arguments: list[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = study_parser("velocity_alone", __doc__)
    parser.add_argument("--drives", type=COUNT, default=DRIVES, help="drives of each case")
    parser.add_argument("--seed", type=SEED, default=FIRST_SEED, help="of the drives")
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES), help="cases")
    parser.add_argument(
        "--out", type=Path, default=Path("out/velocity_alone"), help="new folder of all files"
    )
    options = parser.parse_args(arguments)
    if options.out.exists():
        return refuse("velocity_alone", f"{options.out} exists: give another folder by --out")
    lines: list[list[str]] = []
    for name, sand in itertools.product(options.only, SANDS):
        folder = options.out / f"{name}_{sand}"
        for line in judge(CASES[name], sand, options.drives, options.seed, folder):
            lines.append(line)
            print(line, file=sys.stderr, flush=True)
    head = [
        "drives", "law of the model", "`--constants-sd`", "median error of c / tan phi",
        "95 % intervals hold", "IDENTIFIED", "DISAGREES",
    ]  # fmt: skip
    print(table(head, lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
