# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""studies.calibration: thresholds of find_missing_effect, from simulated runs of known truth.

Nothing missing but soil constants wrong by up to 5 %; each effect of the library, its size swinging
a little in the course of a drive, since no real effect keeps exactly to a law; and each with the
effect taken out of the library, so that no name is right. Every case is written as it comes, and a
file that has some is continued.
"""

import argparse
import contextlib
import dataclasses
import json
import math
import sys
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from studies.calibration.thresholds import CalibrationCase, sample, thresholds
from terrain_estimator.console.arguments import SEED
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.evidence.verdict import Gains
from terrain_estimator.discovery.hypotheses.library import (
    TYPICAL,
    Hypothesis,
    LibraryEffect,
    testable,
)
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.runs import Blocks, RecordedRun, RunError, cut
from terrain_estimator.files.atomic import write_file
from terrain_estimator.learning.tasks import measure_tasks, random_ground
from terramechanics.effects import describe, make_effect
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation import sample as simulated
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate

SOILS = ("loose_sand", "regolith")
DRIVES, SECONDS = 4, 60.0
FACTORS = (1.0, 0.5, 2.0)
"""[1] Of the typical size, in turn."""
VARIATION, PERIOD = 0.4, 40.0
"""[1], [s] Amplitude and period of a size about its nominal one, with another phase each drive."""


class Swinging(Plant):
    """One effect whose size swings: no real effect keeps exactly to a law."""

    def __init__(self, name: str, size: float, axle: int, phase: Tensor) -> None:
        """Take the nominal size and the phase [batch] [rad] of its swing."""
        self._nominal, self._phase, self._effect = size, phase, describe(name)
        self._acting = make_effect(name, self._size(0.0), axle)
        super().__init__([self._acting])

    def _size(self, time: float) -> Tensor:
        swing = 1.0 + VARIATION * torch.sin(2.0 * math.pi * time / PERIOD + self._phase)
        return (self._nominal * swing).clamp(max=self._effect.high)

    def sensed(self, sample: simulated.Sample) -> simulated.Sample:
        """Return the sample of the sensors at the end of a step; the next step has another size."""
        seen = super().sensed(sample)
        self._acting.values = self._effect.values(self._size(float(sample.time[0])))
        return seen


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Run the calibration; returns 0, or 2 where a file cannot be read or written."""
    torch.set_num_threads(1)
    options = _parser().parse_args(arguments)
    plan = [("", k) for k in range(options.nulls)] + [
        (name, k) for k in range(options.cases) for name in testable()
    ]
    try:
        done = _read(options.samples)
        with (
            ProgressReport(f"studies.calibration: {len(plan)} cases") as report,
            options.samples.open("a", encoding="utf-8") as output,
        ):
            for number, (truth, k) in enumerate(plan):
                report.at(number / len(plan), truth or "nothing missing")
                if (truth, options.seed + k) not in done:
                    found = _case(truth, k, options.seed)
                    done[truth, options.seed + k] = found
                    output.write(
                        json.dumps({"truth": truth, "seed": options.seed + k, **_plain(found)})
                        + "\n"
                    )
                    output.flush()
        chosen = thresholds(list(done.values()))
        nulls = sum(not truth for truth, _ in done)
        counts = {
            "seeds": sorted({seed for _, seed in done}),
            "nulls": nulls,
            "effects": len(done) - nulls,
        }
        record = dataclasses.asdict(chosen) | counts
        write_file(options.out, json.dumps(record, indent=1) + "\n")
    except OSError as error:
        sys.stderr.write(f"studies.calibration: {error}\n")
        return 2
    sys.stdout.write(f"{options.out}: {chosen}\n")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="studies.calibration",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--nulls",
        type=int,
        default=40,
        help="cases in which nothing is missing (default: %(default)s)",
    )
    parser.add_argument(
        "--cases", type=int, default=6, help="cases of each effect (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=SEED, default=7_000_000, help="of all that is drawn (default: %(default)s)"
    )
    parser.add_argument(
        "--samples",
        type=Path,
        default=Path("out/calibration.jsonl"),
        help="file of the cases (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/thresholds.json"),
        help="file of the thresholds (default: %(default)s)",
    )
    return parser


def draw_runs(truth: str, k: int, seed: int) -> tuple[str, list[RecordedRun]]:
    """Return the soil and the runs of case ``k``: some drives, the effect the same in all."""
    generator = torch.Generator().manual_seed(
        seed + k + 1000 * (1 + list(TYPICAL).index(truth) if truth else 0)
    )
    rover, name = load_rover("mars_rover"), SOILS[k % len(SOILS)]
    size = TYPICAL[truth] * FACTORS[k // len(SOILS) % len(FACTORS)] if truth else 0.0
    ground = random_ground(load_soil(name), DRIVES, generator)
    phase = 2.0 * math.pi * torch.rand(DRIVES, generator=generator, dtype=torch.float64)
    plant = Swinging(truth, size, k % rover.axles, phase) if truth else None
    drive = simulate(rover, ground, "S1", SECONDS, generator, DRIVES, plant=plant)
    packed = measure_tasks(drive, Noise(), generator).measured
    time = TIME_STEP * torch.arange(packed.shape[1], dtype=torch.float64)
    ends = (~drive.sample.stuck).sum(1).tolist()
    return name, [
        RecordedRun(f"run {j}", packed[j, :end], drive.seen.wheel_rate[j, :end], time[:end])
        for j, end in enumerate(ends)
    ]


def _case(truth: str, k: int, seed: int) -> CalibrationCase:
    with torch.inference_mode():
        soil, runs = draw_runs(truth, k, seed)
        nominal = nominal_of(load_rover("mars_rover"), load_soil(soil))
        return sample(Study(nominal, _usable(runs, nominal)), truth, lambda _share, _label: None)


def _usable(runs: list[RecordedRun], nominal: Nominal) -> list[Blocks]:
    """Return the blocks of the runs that have some: a rover may get stuck at once."""
    found = []
    for run in runs:
        with contextlib.suppress(RunError):
            found.append(cut(run, nominal.contact))
    return found


def _plain(found: CalibrationCase) -> dict[str, object]:
    """Return a sample as numbers and names."""
    return {
        "with": _plain_gains(found.with_truth),
        "without": _plain_gains(found.without_truth) if found.without_truth else None,
    }


def _plain_gains(gains: Gains) -> dict[str, object]:
    named = [
        [[[effect.name, effect.axle] for effect in hypothesis.effects], gain]
        for hypothesis, gain in gains.named
    ]
    return {"named": named, "nothing_with": gains.nothing_with, "best_with": gains.best_with}


def _read(path: Path) -> dict[tuple[str, int], CalibrationCase]:
    """Return the cases of an earlier call."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists():
        return {}
    found = {}
    for entry in (json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()):
        without = _gains(entry["without"]) if entry["without"] else None
        found[entry["truth"], entry["seed"]] = CalibrationCase(
            entry["truth"], _gains(entry["with"]), without
        )
    return found


def _gains(plain: dict[str, Any]) -> Gains:
    named = tuple(
        (Hypothesis(tuple(LibraryEffect(*effect) for effect in effects)), gain)
        for effects, gain in plain["named"]
    )
    return Gains(named, float(plain["nothing_with"]), float(plain["best_with"]))


if __name__ == "__main__":
    sys.exit(main())
