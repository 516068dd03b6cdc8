# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives into patches of soft ground: rovers that the planner's stop saves, and its false stops.

A stop ends a drive and changes nothing before it. So each drive is simulated once, to its end and
without the planner. The planner then gets the measurements of the sensors, and the time of its stop
is noted.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.departures import Family, largest_sizes
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.learning.tasks import StrengthRange, degrees, random_ground, uniform
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Observation
from terrain_estimator.planning.belief import Belief, widened
from terrain_estimator.planning.planner import Planner, Reason
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.table import TractionTable
from terrain_estimator.update import Update
from terramechanics.contact.sinkage import drawbar_capability
from terramechanics.effects import make_effect
from terramechanics.presets import load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import TIME_STEP, Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import STUCK_TIME, simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import random_hills
from terramechanics.vehicle.rover import Rover

FIRM = StrengthRange(((1500.0, 5000.0),), (degrees(30.0, 45.0),))
"""Ground at the start of the drives."""
SOFT = StrengthRange(((200.0, 2000.0),), (degrees(10.0, 35.0),))
"""Ground of the patches: some hold the rover, some do not."""
SPREAD = 0.05
"""[1] Each soil constant is wrong by up to this share."""
DURATION_S = 70.0
STARTS, LENGTHS, BORDERS = (3.0, 6.0), (1.0, 4.0), (0.05, 0.5)
"""[m] Start and length of a patch, and the length over which its borders are blurred."""
WITH_EFFECT = 0.5
"""[1] Share of the drives with one effect that is not in the planner's model."""
BATCH = 20
"""Drives that are simulated together, each onto a patch in the same place."""
PERIOD = 5
"""Observations between two pieces of advice: 0.5 s."""


@dataclass(frozen=True, slots=True)
class PatchOutcome:
    """One drive."""

    effect: str  # empty: none
    met_s: float  # when the front axle met the patch; infinite where it never did
    stuck_s: float  # when slip exceeded the recoverable; infinite where the rover passed
    stop_s: float  # when the planner stopped it; infinite for never
    rest_s: float  # when the rover would have come to rest
    reason: Reason
    slip: float  # mean slip at the stop
    axles: int  # that were on the patch then
    holds: bool  # the patch, under all wheels, would have held the rover on the slope of the stop

    @property
    def counts(self) -> bool:
        """True where the drive met its patch before it got stuck."""
        return self.met_s < min(self.stuck_s, math.inf)

    @property
    def trapped(self) -> bool:
        """True where the rover gets stuck without the planner."""
        return math.isfinite(self.stuck_s)

    @property
    def saved(self) -> bool:
        """True where the planner stops a rover before it gets stuck."""
        return self.trapped and self.rest_s < self.stuck_s

    @property
    def false_stop(self) -> bool:
        """True where the planner stops a rover that would have passed."""
        return not self.trapped and math.isfinite(self.stop_s)


@dataclass(frozen=True, slots=True)
class PatchDrives:
    """A batch of drives: the truth, and each rover's measurements."""

    rover: Rover
    sample: Sample
    observations: list[list[Observation]]
    patch: tuple[float, float]  # [m] where the patch begins and ends
    capability: Tensor  # [batch] largest pull over weight on the patch's ground
    effects: list[str]


def draw_drives(rover: Rover, soil: str, count: int, generator: torch.Generator) -> PatchDrives:
    """Simulate drives (S1, over hills) from firm ground across a patch of soft ground.

    Both are of the same soil. The patch is in the same place for all drives.
    """
    kind = load_soil(soil)
    firm, soft = (
        random_ground(kind, count, generator, SPREAD, strength).patches[0]
        for strength in (FIRM, SOFT)
    )
    place = torch.rand(3, generator=generator, dtype=torch.float64)
    start, length, border = (
        float(uniform((ends,), place[k])) for k, ends in enumerate((STARTS, LENGTHS, BORDERS))
    )
    names, plant = _effects(rover, count, generator)
    hills = random_hills(count, drawbar_capability(rover, firm.constants, firm.strength), generator)
    ground = Ground(
        [
            firm,
            Patch(soft.constants, soft.strength, start, border, "patch"),
            Patch(firm.constants, firm.strength, start + length, border, "firm"),
        ]
    )
    drive = simulate(rover, ground, "S1", DURATION_S, generator, count, hills, plant)
    measured = measure_drive(rover, drive.seen, Noise(), generator)
    observations = [observations_of(measured, k) for k in range(count)]
    return PatchDrives(
        rover,
        drive.sample,
        observations,
        (start, start + length),
        drawbar_capability(rover, soft.constants, soft.strength),
        names,
    )


def _effects(rover: Rover, count: int, generator: torch.Generator) -> tuple[list[str], Plant]:
    """Draw one effect of random kind and size in a share of the drives."""
    ranges = {
        name: ends for family in Family for name, ends in largest_sizes(family, rover).items()
    }
    there = torch.rand(count, generator=generator, dtype=torch.float64) < WITH_EFFECT
    kind = torch.randint(len(ranges), (count,), generator=generator)
    place = torch.rand(count, generator=generator, dtype=torch.float64)
    effects = []
    for number, (name, (low, high)) in enumerate(ranges.items()):
        effects.append(
            make_effect(
                name, torch.where(there & (kind == number), low + (high - low) * place, 0.0)
            )
        )
    chosen = list(ranges)
    return [chosen[int(k)] if here else "" for k, here in zip(kind, there, strict=True)], Plant(
        effects
    )


def belief_of(update: Update) -> Belief:
    """Return the belief that the planner gets from an update."""
    estimate = update.estimate
    return Belief(
        estimate.mean,
        widened(estimate.covariance, ((each.offset, each.spread) for each in estimate.fit)),
        estimate.soil_probability,
        all(estimate.identified),
        estimate.change_probability,
        bool(update.disagreements),
    )


def estimates_of(model: LoadedModel, observations: list[Observation]) -> Iterator[Belief]:
    """Yield the belief after each observation."""
    estimator = Estimator(model, CoreConfig())
    for observation in observations:
        yield belief_of(estimator.update(observation))


def judge(
    drives: PatchDrives,
    index: int,
    beliefs: Iterator[Belief],
    planner: Planner,
    config: AdviceConfig,
) -> PatchOutcome:
    """Judge one drive with a new planner; ``beliefs`` are the estimator's, one an observation."""
    sample = drives.sample
    inside = (sample.contact[index] >= drives.patch[0]) & (sample.contact[index] < drives.patch[1])
    met, stuck = _first(inside[:, 0]), _first(sample.stuck[index])
    outcome = PatchOutcome(
        drives.effects[index],
        met,
        stuck - STUCK_TIME,
        math.inf,
        math.inf,
        Reason.NONE,
        math.nan,
        0,
        holds=True,
    )
    for step, (observation, belief) in enumerate(
        zip(drives.observations[index], beliefs, strict=False)
    ):
        time = (step + 1) * TIME_STEP
        if time > stuck or bool((sample.contact[index, step] >= drives.patch[1]).all()):
            break
        planner.observe(observation)
        planner.believe(belief)
        advice = planner.advise(observation.stamp_ns) if step % PERIOD == PERIOD - 1 else None
        if advice is not None and advice.stop:
            return replace(
                outcome,
                stop_s=time,
                rest_s=time + advice.rim_speed / config.deceleration,
                reason=advice.reason,
                slip=float(sample.slip[index, step].mean()),
                axles=int(inside[step].sum()),
                holds=bool(drives.capability[index] > torch.tan(sample.pitch[index, step])),
            )
    return outcome


def _first(happened: Tensor) -> float:
    """Return the time [s] of the first True in [time]; infinite where there is none."""
    steps = torch.nonzero(happened)
    return float(steps[0, 0] + 1) * TIME_STEP if steps.numel() else math.inf


def study(
    model: LoadedModel, soil: str, count: int, config: AdviceConfig, seed: int
) -> Iterator[PatchOutcome]:
    """Yield the outcomes of ``count`` drives on patches of one soil, in batches."""
    table = TractionTable(model.rover, solve_statics(model.rover, model.metadata.soils))
    generator = torch.Generator().manual_seed(seed)
    for first in range(0, count, BATCH):
        drives = draw_drives(model.rover, soil, min(BATCH, count - first), generator)
        for index, observations in enumerate(drives.observations):
            planner = Planner(table, model.metadata.prior_mean, model.metadata.prior_sd, config)
            yield judge(drives, index, estimates_of(model, observations), planner, config)
