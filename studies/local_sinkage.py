# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimates from sinkages of the local surface against those from undisturbed ground.

python -m studies.local_sinkage prints figures of docs/limitations.md for one rover. Drives are the
simulator's, over hills of loose sand: c uniform in 0.5 to 5 kPa, phi in 15 to 45 deg, each soil
constant within 5 %. A rover that drives straight follows S1, with its model that ships. With
--by-wheel it is a skid-steer that turns left and right by turns, with a model by wheel that is
compiled in --models, which takes a minute. Both sinkages are of the same drive.
"""

import dataclasses
import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from rover_sim_node.config import FOLLOW, SimulatorConfig, SoilOverrides
from rover_sim_node.messages import step_messages
from rover_sim_node.run import SimulatedRun
from rover_sim_node.turning_run import TurningRun
from studies.by_wheel.drives import compiled, model_of_soils
from studies.command import study_parser
from studies.false_names.table import limits
from terrain_estimator.compiled.finding import ends_here, load
from terrain_estimator.config.estimator import AUTO, COMPILED, EstimatorConfig
from terrain_estimator.console.arguments import COUNT, SEED
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.observation import Floats
from terrain_estimator.topics import LOCAL, UNDISTURBED, Message
from terrain_estimator.update import Update
from terramechanics.description.layout import track_width_of
from terramechanics.presets import load_rover, load_soil
from terramechanics.vehicle.wheel_places import WheelPlaces

SOIL = "loose_sand"
SPEED, TURNS = 0.15, (0.0, 0.3, 0.0, -0.3)
"""[m/s]; [rad/s], each for ten seconds."""
REFERENCES = (UNDISTURBED, LOCAL)


def drawn(rover: str, seed: int, drives: int, *, by_wheel: bool) -> Iterator[SimulatorConfig]:
    """Yield drives on random ground."""
    random, soil = np.random.default_rng(seed), load_soil(SOIL)
    names = ("n", "k_c", "k_phi", "shear_modulus", "c1", "c2")
    for number in range(drives):
        cohesion = random.uniform(500.0, 5000.0)
        tan_phi = math.tan(math.radians(random.uniform(15.0, 45.0)))
        factors = 1.0 + 0.05 * random.uniform(-1.0, 1.0, len(names))
        constants = {
            name: float(getattr(soil, name) * factor)
            for name, factor in zip(names, factors, strict=True)
        }
        ground = SoilOverrides(cohesion=cohesion, tan_phi=tan_phi, **constants)
        config = SimulatorConfig(
            rover=rover, soil=SOIL, seed=seed + number, soil_overrides=ground, profile="hills"
        )
        yield (
            dataclasses.replace(config, schedule=FOLLOW, steering="skid")
            if by_wheel
            else dataclasses.replace(config, schedule="S1", profile="")
        )


def messages(config: SimulatorConfig, seconds: float) -> Iterator[tuple[str, Message]]:
    """Yield the messages of a drive."""
    run = TurningRun(config) if config.steering else SimulatedRun(config)
    for step in range(round(seconds * config.rate)):
        if isinstance(run, TurningRun):
            turn = TURNS[int(step / config.rate / 10.0) % len(TURNS)]
            run.commands.request((SPEED, 0.0, 0.0), (0.0, 0.0, turn))
        reading = run.step()
        yield from step_messages(reading, config, round(1e9 * reading.time) + 10**9, step).items()


@dataclasses.dataclass(frozen=True, slots=True)
class Chosen:
    """A model, and how it is run."""

    pipeline: EstimatorConfig
    path: str

    def ended(self, config: SimulatorConfig, seconds: float) -> tuple[Update, Status]:
        """Return the last answer to a drive, and its status."""
        model = load(self.path, self.pipeline.runtime).model
        pipeline = Pipeline(model, self.pipeline)
        answers = [
            answer
            for topic, message in messages(config, seconds)
            for answer in pipeline.add(topic, message)
        ]
        last = [*answers, *pipeline.flush()][-1].update
        return last, status_of(last, pipeline.meta.rows)


def chosen(rover: str, models: Path, *, by_wheel: bool) -> Chosen:
    """Return the model that ships for the rover; one by wheel is made and compiled."""
    if not by_wheel:
        name = "" if rover == "mars_rover" else rover
        return Chosen(EstimatorConfig(model=name, runtime=load(name, AUTO).runtime), name)
    path, body = models / f"{rover}_by_wheel.pt", load_rover(rover)
    if not path.with_suffix(ends_here()[0]).exists():
        models.mkdir(parents=True, exist_ok=True)
        places = WheelPlaces.of(body, track_width_of(body))
        soils = [load_soil(SOIL).for_wheel(body.wheel_width)]
        model_of_soils(body, places, soils, DEFAULT_PRIOR, path)
        compiled(path)
    return Chosen(EstimatorConfig(model=str(path), runtime=COMPILED), str(path))


def lines(found: dict[str, list[tuple[Update, Status]]], truth: Floats) -> Iterator[str]:
    """Yield a line for each reference, and one of their difference."""
    means, deviations = {}, {}
    for reference, ends in found.items():
        estimates = [update.estimate for update, _ in ends]
        mean = means[reference] = np.array([each.mean for each in estimates])
        spread = np.array([np.sqrt(np.diag(each.covariance)) for each in estimates])
        deviations[reference] = spread
        held = np.array([(each.lower_95, each.upper_95) for each in estimates])
        inside = (held[:, 0] <= truth) & (truth <= held[:, 1])
        holds = inside.sum(0)
        error, stated = (100.0 * np.median(np.abs(x) / truth, 0) for x in (mean - truth, spread))
        identified = np.array([status is Status.IDENTIFIED for _, status in ends])
        ranges = [limits(int(count), len(ends)) for count in holds]
        shown = [
            f"{count} of {len(ends)} ({100.0 * low:.0f} to {100.0 * high:.0f} %)"
            for count, (low, high) in zip(holds, ranges, strict=True)
        ]
        yield (
            f"{reference}: intervals hold c {shown[0]}, tan phi {shown[1]}; median error"
            f" {error[0]:.1f} / {error[1]:.1f} %, stated {stated[0]:.1f} / {stated[1]:.1f} %;"
            f" IDENTIFIED {identified.sum()}, of these wrong {(identified & ~inside.all(1)).sum()}"
        )
    apart = (means[LOCAL] - means[UNDISTURBED]) / deviations[UNDISTURBED]
    mean, root = apart.mean(0), np.sqrt((apart**2).mean(0))
    yield (
        f"difference in deviations, c / tan phi: mean {mean[0]:+.2f} / {mean[1]:+.2f}, root mean"
        f" square {root[0]:.2f} / {root[1]:.2f}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code."""
    parser = study_parser("local_sinkage", __doc__)
    parser.add_argument("--rover", default="mars_rover", help="name of a rover that ships")
    parser.add_argument("--by-wheel", action="store_true", help="it turns, with a model by wheel")
    parser.add_argument("--drives", type=COUNT, default=60, help="number of drives")
    parser.add_argument("--seconds", type=float, default=40.0, help="of each drive")
    parser.add_argument("--seed", type=SEED, default=91_000_000, help="of ground and noise")
    parser.add_argument("--models", type=Path, default=Path("out/local_sinkage"), help="folder")
    given = parser.parse_args(arguments)
    model = chosen(given.rover, given.models, by_wheel=given.by_wheel)
    found: dict[str, list[tuple[Update, Status]]] = {reference: [] for reference in REFERENCES}
    truth = []
    for config in drawn(given.rover, given.seed, given.drives, by_wheel=given.by_wheel):
        for reference in REFERENCES:
            drive = dataclasses.replace(config, sinkage_reference=reference)
            found[reference].append(model.ended(drive, given.seconds))
        truth.append((config.soil_overrides.cohesion, config.soil_overrides.tan_phi))
    print(*lines(found, np.array(truth)), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
