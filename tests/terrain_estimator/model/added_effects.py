# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The value of a model with a named effect online.

``python -m tests.terrain_estimator.model.added_effects [NAME ...]``

The same drives three times: without the effect, with the library's law at the size that is
equivalent to the hidden one, and with the hidden law of that name. The model as shipped and the one
with the effect, whose prior is the library's range, estimate each.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.model.effects import LAWS
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.update import Estimate
from terramechanics.effects import describe, make_effect
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import Drive, Measurement
from terramechanics.simulation.sensors import Noise, measure_drive, per_wheel
from terramechanics.simulation.simulation import simulate
from tests.hidden.cases import EACH, Simulated, drive_ends, simulate_cases
from tests.hidden.cases import Plan as Hidden
from tests.hidden.equivalent import equivalent_size
from tests.hidden.ground import draw_ground, draw_terrain
from tests.hidden.matters import axle_means

SEED = 11
LAW = ("none", "library", "hidden")


@dataclass(frozen=True, slots=True)
class Run:
    """One drive and the truth about it."""

    observations: list[Observation]
    cohesion_pa: float
    tan_phi: float
    size: float  # of the effect, in the library's unit


def hidden(name: str, cases: int, seconds: float) -> tuple[Simulated, list[float]]:
    """Cases with the hidden law at the size that matters, and their sizes in the library's unit."""
    simulated = simulate_cases(Hidden(((name, 1.0),), seconds=seconds), cases, SEED)
    episodes = [list(range(k * EACH, (k + 1) * EACH)) for k in range(cases)]
    return simulated, [
        equivalent_size(name, simulated.effects[0], simulated.drive, chosen) for chosen in episodes
    ]


def library(
    name: str, like: Simulated, sizes: Sequence[float], seconds: float
) -> tuple[Drive, Measurement]:
    """The drives of ``like`` with the library's law of these sizes."""
    described, rover, generator = (
        describe(name),
        like.drive.rover,
        torch.Generator().manual_seed(2 * SEED),
    )
    possible = [min(max(size, described.low), described.high) for size in sizes]
    ground = draw_ground([soil for soil in like.soils for _ in range(EACH)], generator)
    terrain = draw_terrain(
        [kind for kind in like.terrains for _ in range(EACH)], rover, ground, generator
    )
    size = torch.tensor(possible, dtype=torch.float64).repeat_interleave(EACH)
    drive = simulate(
        rover,
        ground,
        "S1",
        seconds,
        generator,
        len(size),
        terrain,
        Plant([make_effect(name, size)]),
    )
    return drive, measure_drive(rover, per_wheel(rover, drive.seen), Noise(), generator)


def runs(drive: Drive, measured: Measurement, sizes: Sequence[float], each: int) -> list[Run]:
    """The first ``each`` drives of every case, up to where the rover gets stuck."""
    means, ends, strength = (
        axle_means(measured, drive.rover.axles),
        drive_ends(drive),
        drive.sample.strength,
    )
    chosen = [(k * EACH + j, size) for k, size in enumerate(sizes) for j in range(each)]
    return [
        Run(
            observations_of(means, index)[: int(ends[index])],
            float(strength[index, 0, 0, 0]),
            float(strength[index, 0, 0, 1]),
            size,
        )
        for index, size in chosen
    ]


def estimated(model: LoadedModel, run: Run) -> Estimate:
    """The last estimate of a drive."""
    estimator = Estimator(model, CoreConfig())
    return [estimator.update(observation) for observation in run.observations][-1].estimate


def line(
    name: str, law: str, found: Sequence[Run], before: Sequence[Estimate], after: Sequence[Estimate]
) -> str:
    """The results of the drives of one law."""
    size = np.array([run.size for run in found])
    mean, sd = np.array([(each.effects[0].mean, each.effects[0].sd) for each in after]).T
    truth = np.array([[run.cohesion_pa, run.tan_phi] for run in found])
    columns = [
        np.abs(size).mean(),
        np.median(mean - size),
        np.median(sd),
        (abs(mean - size) < HALF_WIDTH_95 * sd).sum(),
    ]
    for estimates in (before, after):
        at = np.stack([each.mean for each in estimates])
        wide = np.stack([np.sqrt(np.diagonal(each.covariance)) for each in estimates])
        error = np.abs(at - truth)
        columns += [
            *(100.0 * np.median(error / truth, 0)).tolist(),
            *(holds := error < HALF_WIDTH_95 * wide).sum(0).tolist(),
            (identified := np.array([all(each.identified) for each in estimates])).sum(),
            (identified & ~holds.all(1)).sum(),
        ]
    return f"{name:>16}{law:>9}{len(found):4d}" + "".join(f"{column:13.4g}" for column in columns)


def study(
    name: str,
    cases: int,
    each: int,
    seconds: float,
    plain: LoadedModel,
    with_it: LoadedModel,
    laws: Sequence[str] = LAW,
) -> Iterator[str]:
    """A line for each of the ``laws``."""
    secret, sizes = hidden(name, cases, seconds)
    for law in laws:
        drive, measured, true_sizes = secret.drive, secret.measured, sizes
        if law == "none":
            nothing = simulate_cases(Hidden(seconds=seconds), cases, SEED)
            drive, measured, true_sizes = nothing.drive, nothing.measured, [0.0] * cases
        elif law == "library":
            drive, measured = library(name, secret, sizes, seconds)
        found = runs(drive, measured, true_sizes, each)
        yield line(
            name,
            law,
            found,
            *([estimated(model, run) for run in found] for model in (plain, with_it)),
        )


def main() -> None:
    """Print a line for each effect and law."""
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", default=list(LAWS), help="effects")
    parser.add_argument(
        "--cases",
        type=int,
        default=2,
        help="of which each has an own size, soils and terrains in turn",
    )
    parser.add_argument("--laws", nargs="+", choices=LAW, default=LAW, help="that act")
    parser.add_argument("--each", type=int, default=3, help="drives of a case")
    parser.add_argument("--seconds", type=float, default=40.0, help="length of a drive")
    options = parser.parse_args()
    plain = load_model()
    ground = [
        f"{part} {what}"
        for part in ("before", "after")
        for what in ("c %", "tan %", "c in", "tan in", "ident", "wrong")
    ]
    columns = ["|size|", "error", "sd", "in 95 %", *ground]
    sys.stdout.write(
        f"{'effect':>16}{'law':>9}{'n':>4}" + "".join(f"{column:>13}" for column in columns) + "\n"
    )
    for name in options.names:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{name}.pt"
            add_effects(plain, [Sized.of_library(name)], path)
            for text in study(
                name,
                options.cases,
                options.each,
                options.seconds,
                plain,
                load_model(str(path)),
                options.laws,
            ):
                sys.stdout.write(text + "\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main()
