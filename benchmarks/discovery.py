# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Processor time of find_missing_effect on four one-minute drives and a held-out one, on one core.

The reference is one evaluation of the stress integrals of a million wheels: what a search spends
most of its time on, and which no search avoids.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import torch

from benchmarks.lines import BenchmarkLine, Effort
from terramechanics.contact.stresses import many_wheel_forces, quadrature
from terramechanics.presets import load_rover, load_soil
from tests.hidden.cases import Plan, draw_cases
from tests.hidden.sealing import seal

BAR_S = 10.0
SEED = 77_100
SECONDS = 60.0
WHEELS = 1_000_000
CASES: dict[str, tuple[tuple[str, float], ...]] = {
    "nothing missing": (),
    "one effect": (("drive_drag", 1.0),),
    "two effects": (("payload", 1.0), ("drive_drag", 1.0)),
}


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the time where nothing, one effect and two are missing."""
    torch.set_num_threads(1)
    for name, parts in CASES.items():
        reference_s = integrals_s()
        yield BenchmarkLine(
            f"find_missing_effect on four drives of one minute, one core: {name}",
            searched_s(parts, effort.seconds(SECONDS, least=18.0)),
            "s",
            BAR_S,
            reference="stress integrals of a million wheels",
            against=reference_s,
            note="processor time of the whole command, start and proof on a fifth drive included",
        )


def searched_s(parts: tuple[tuple[str, float], ...], seconds: float) -> float:
    """Return the processor time [s] of the command on drives with these hidden effects."""
    with tempfile.TemporaryDirectory() as folder:
        plan = Plan(parts, soil="loose_sand", seconds=seconds)
        bags = seal(draw_cases(plan, 1, seed=SEED)[0], Path(folder) / "bags")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(  # noqa: S603
            [
                *(sys.executable, "-m", "terrain_estimator.cli.find_missing_effect"),
                *map(str, bags[:-1]),
                *("--hold-out", str(bags[-1]), "--workers", "1", "--out", f"{folder}/out"),
            ],
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            check=True,
            capture_output=True,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def integrals_s() -> float:
    """Return the processor time [s] of the forces of a million wheels."""
    rover, soil = load_rover("mars_rover"), load_soil("loose_sand")
    slip = torch.linspace(0.05, 0.6, WHEELS, dtype=torch.float64)
    sinkage = torch.full_like(slip, 0.1 * rover.wheel_radius)
    given = (slip, sinkage, soil.constants(), rover.wheel_radius, rover.wheel_width, quadrature())
    many_wheel_forces(*given)
    begun_s = time.process_time()
    many_wheel_forces(*given)
    return time.process_time() - begun_s
