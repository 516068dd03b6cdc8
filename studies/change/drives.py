# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives onto other ground: when the estimator detects the change, and when it has recovered.

Every drive goes through the whole estimator, gates included. Time counts from the moment at which
the first axle crosses; an alarm before it is a false one. A second estimator starts afresh once the
last axle has crossed. Its error is the least that the data of the new ground allow.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.learning.tasks import BENCHMARK, random_ground
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Estimate
from terramechanics.presets import load_soil
from terramechanics.simulation.sample import TIME_STEP, Drive
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.vehicle.rover import Rover

HORIZON_S = 45
"""[s] Estimates are judged every second up to this time after the first axle's crossing.

A gradual change adds its own duration.
"""
ALARM = 0.9
"""[1] A change is detected where its probability is above this.

Half is reached in the first seconds of a drive, before the ground is known: three times in 4.4
hours of the paper's rover on loose sand, of which none went beyond 0.9 (seed 777).
"""
_BEFORE_S = 25.0  # on the first ground, at mean speed
_SLOW = 0.75  # of the lowest cruise speed: slip takes the rest
_SPREAD = 0.05  # each soil constant is wrong by up to this share
_LEAST_AFTER_S = 20.0  # on the new ground with all axles, for a drive to count


@dataclass(frozen=True, slots=True)
class Change:
    """Change from one soil to another; on the same soil c and phi move by half their range."""

    rover: str
    before: str
    after: str
    gradual_s: float = 0.0  # time in which one axle passes from one to the other at mean speed
    forgetting_s: float = 0.0  # the estimator's parameter forgetting_time

    @property
    def horizon_s(self) -> int:
        """Seconds after the first axle's crossing in which estimates are judged."""
        return HORIZON_S + math.ceil(self.gradual_s)


@dataclass(frozen=True, slots=True)
class FalseAlarms:
    """False words on constant ground, or before a change."""

    rover: str
    soil: str
    hours: float
    alarms: int  # rises of the change's probability
    disagreements: int  # times that the status became DISAGREES


class Rises:
    """The observations at which a condition began to hold."""

    def __init__(self) -> None:
        """Begin where it does not hold."""
        self.places: list[int] = []
        self._held = False

    def add(self, place: int, *, now: bool) -> None:
        """Take whether it holds at the next observation, ``place``."""
        if now and not self._held:
            self.places.append(place)
        self._held = now


class Followed(NamedTuple):
    """N drives of one change, every second T from the crossing on; NaN where a drive has ended."""

    delay_s: NDArray[np.float64]  # [N] infinite where no alarm rose from the crossing on
    crossing_s: NDArray[np.float64]  # [N] until the last axle has crossed
    error: NDArray[np.float64]  # [N, T, 2] relative
    covered: NDArray[np.float64]  # [N, T, 2] 1 or 0
    fresh: NDArray[
        np.float64
    ]  # [N, T, 2] error of the fresh estimator, before its start of the prior
    early_s: NDArray[np.float64]  # [N] time before the crossing
    early_alarms: NDArray[np.float64]  # [N] alarms in it
    early_disagreements: NDArray[np.float64]  # [N] times that the status became DISAGREES in it


def changed_ground(rover: Rover, change: Change, batch: int, generator: torch.Generator) -> Ground:
    """Return ground with random strength and constants on both sides."""
    low, high = rover.cruise_speed
    before, after = load_soil(change.before), load_soil(change.after)
    first = random_ground(before, batch, generator, _SPREAD).patches[0]
    second = random_ground(after, batch, generator, _SPREAD).patches[0]
    strength = second.strength
    if change.before == change.after:
        strength = _shifted(first.strength)
    speed = 0.5 * (low + high)
    patch = Patch(
        second.constants if change.before != change.after else first.constants,
        strength,
        start=_BEFORE_S * speed,
        transition=change.gradual_s * speed,
        name=after.name,
    )
    return Ground([first, patch])


def _shifted(strength: torch.Tensor) -> torch.Tensor:
    """Move c and phi [batch, 2] by half of their ranges, up or down, within these."""
    low, high = torch.tensor([*BENCHMARK.cohesion, *BENCHMARK.angle], dtype=torch.float64).T
    values, half = torch.stack([strength[:, 0], torch.atan(strength[:, 1])], 1), 0.5 * (high - low)
    moved = torch.where(values - low < half, values + half, values - half)
    return torch.stack([moved[:, 0], torch.tan(moved[:, 1])], 1)


def drive_over(rover: Rover, change: Change, batch: int, generator: torch.Generator) -> Drive:
    """Simulate drives long enough for the slowest rover to be judged up to the horizon."""
    ground = changed_ground(rover, change, batch, generator)
    patch, slow = ground.patches[1], _SLOW * rover.cruise_speed[0]
    length = patch.start + patch.transition + max(rover.axle_x) - min(rover.axle_x)
    duration = max(length / slow + _LEAST_AFTER_S, patch.start / slow + change.horizon_s)
    return simulate(rover, ground, "S1", duration, generator, batch)


def follow_change(
    change: Change, model: LoadedModel, config: CoreConfig, drives: int, seed: int
) -> Followed:
    """Simulate drives and follow each with two estimators.

    Drives that get stuck, or end soon after the crossing, are drawn anew. There may be fewer than
    ``drives``.
    """
    rover, generator = model.rover, torch.Generator().manual_seed(seed)
    found: list[Followed] = []
    for _ in range(8):
        drive = drive_over(rover, change, drives, generator)
        measurement = measure_drive(rover, drive.sample, Noise(), generator)
        for index in range(drives):
            place = places_of(drive, index, change)
            if place is not None and len(found) < drives:
                observations = observations_of(measurement, index)
                found.append(
                    _follow(
                        model, config, observations, _truth(drive, index), place, change.horizon_s
                    )
                )
        if len(found) == drives:
            break
    return pool(found, change)


def pool(parts: Sequence[Followed], change: Change) -> Followed:
    """Return all drives of these parts."""
    none = Followed(
        *(np.empty((0, *shape)) for shape in [(), (), *[(change.horizon_s + 1, 2)] * 3, (), (), ()])
    )
    return Followed(*(np.concatenate(values) for values in zip(none, *parts, strict=True)))


def places_of(drive: Drive, index: int, change: Change) -> tuple[int, int, int] | None:
    """Return the observations of the first axle's crossing, the last axle's, and the end.

    None where the drive does not count.
    """
    speed, contact = 0.5 * sum(drive.rover.cruise_speed), drive.sample.contact[index]
    first = int((contact.amax(1) < _BEFORE_S * speed).sum())
    last = int((contact.amin(1) < (_BEFORE_S + change.gradual_s) * speed).sum())
    end = int((~drive.sample.stuck[index]).sum())
    return (first, last, end) if last + _LEAST_AFTER_S / TIME_STEP < end else None


def _truth(drive: Drive, index: int) -> NDArray[np.float64]:
    """Return c and tan phi [T, 2], the mean over the axles."""
    truth: NDArray[np.float64] = drive.sample.strength[index].mean(1).numpy()
    return truth


def _follow(
    model: LoadedModel,
    config: CoreConfig,
    observations: Sequence[Observation],
    truth: NDArray[np.float64],
    place: tuple[int, int, int],
    horizon_s: int,
) -> Followed:
    first, last, end = place
    per_second = round(1.0 / TIME_STEP)
    known, fresh = Estimator(model, config), Estimator(model, config)
    prior = fresh.reject(0, Outcome.DUPLICATE, "").estimate
    error, covered, afresh = (np.full((1, horizon_s + 1, 2), np.nan) for _ in range(3))
    risen, broken = Rises(), Rises()
    for k, observation in enumerate(observations[: min(end, first + horizon_s * per_second + 1)]):
        update = known.update(observation)
        estimate = update.estimate
        newest = fresh.update(observation).estimate if k >= last else prior
        risen.add(k, now=estimate.change_probability > ALARM)
        broken.add(k, now=bool(update.disagreements))
        second, part = divmod(k - first, per_second)
        if k >= first and part == 0:
            error[0, second], afresh[0, second] = (_error(x, truth[k]) for x in (estimate, newest))
            covered[0, second] = (estimate.lower_95 <= truth[k]) & (truth[k] <= estimate.upper_95)
    delay = min(((k - first) * TIME_STEP for k in risen.places if k >= first), default=math.inf)
    early, disagreed = (sum(k < first for k in each.places) for each in (risen, broken))
    crossing, before, alarms, disagreements = (
        np.array([x], dtype=np.float64)
        for x in ((last - first) * TIME_STEP, first * TIME_STEP, early, disagreed)
    )
    return Followed(
        np.array([delay]), crossing, error, covered, afresh, before, alarms, disagreements
    )


def _error(estimate: Estimate, truth: NDArray[np.float64]) -> NDArray[np.float64]:
    relative: NDArray[np.float64] = np.abs(estimate.mean - truth) / truth
    return relative


def study_constant(
    model: LoadedModel, soil: str, config: CoreConfig, hours: float, seed: int
) -> FalseAlarms:
    """Count false words on constant ground; each soil constant is wrong by up to 5 %."""
    generator, rover = torch.Generator().manual_seed(seed), model.rover
    seconds, alarms, disagreements, batch = (
        0.0,
        0,
        0,
        min(40, math.ceil(3600.0 * hours / _CONSTANT_S)),
    )
    while seconds < 3600.0 * hours:
        drive = simulate(
            rover,
            random_ground(load_soil(soil), batch, generator, _SPREAD),
            "S1",
            _CONSTANT_S,
            generator,
            batch,
        )
        measurement = measure_drive(rover, drive.sample, Noise(), generator)
        for index in range(batch):
            end = int((~drive.sample.stuck[index]).sum())
            estimator, risen, broken = Estimator(model, config), Rises(), Rises()
            for k, observation in enumerate(observations_of(measurement, index)[:end]):
                update = estimator.update(observation)
                risen.add(k, now=update.estimate.change_probability > ALARM)
                broken.add(k, now=bool(update.disagreements))
            seconds += end * TIME_STEP
            alarms += len(risen.places)
            disagreements += len(broken.places)
    return FalseAlarms(rover.name, soil, seconds / 3600.0, alarms, disagreements)


_CONSTANT_S = 100.0  # duration of a drive on constant ground


def judge_change(change: Change, drives: int, seed: int) -> Followed:
    """Follow some drives of one change with the rover's model."""
    config = CoreConfig(forgetting_time=change.forgetting_s)
    return follow_change(change, load(change.rover, AUTO).model, config, drives, seed)


def judge_constant(rover: str, soil: str, hours: float, seed: int) -> FalseAlarms:
    """Count false words on constant ground with the rover's model."""
    return study_constant(load(rover, AUTO).model, soil, CoreConfig(), hours, seed)
