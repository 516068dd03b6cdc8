# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Ground that changes under the rover: how soon the estimator says so, and how soon it knows the new ground.

Every drive goes through the whole estimator, gates included. Time counts from the place where the first axle meets the
new ground. A second estimator starts afresh once the last axle has reached it: what it knows is what the data of the new ground allow.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import binom, chi2

from terrain_estimator.config import CoreConfig
from terrain_estimator.estimator import Estimator
from terrain_estimator.learning.accuracy import CONFIDENCE, share_of
from terrain_estimator.learning.observations import observations_of
from terrain_estimator.learning.tasks import BENCHMARK, random_ground
from terrain_estimator.model_file import LoadedModel
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Estimate
from terramechanics.ground import Ground, Patch
from terramechanics.rover import Rover
from terramechanics.sample import Drive
from terramechanics.sensors import Noise, measure_drive
from terramechanics.simulation import TIME_STEP, simulate
from terramechanics.soil import load_soil

HORIZON_S = 45
"""[s] Estimates are judged every second up to this time after the first axle's crossing."""
ALARM = 0.5
"""[1] A change is told where its probability is above this."""
WORSE = 1.3
"""[1] Re-converged: the median error is at most this multiple of that of the estimator that started afresh."""
NOMINAL = 0.95
_BEFORE_S = 25.0  # on the first ground, at mean speed
_SLOW = 0.75  # of the lowest cruise speed: slip takes the rest
_SPREAD = 0.05  # each soil constant is wrong by up to this share
_LEAST_AFTER_S = 20.0  # on the new ground with all axles, for a drive to count


@dataclass(frozen=True, slots=True)
class Change:
    """From one soil to another; on the same soil c and phi move by half their range."""

    rover: str
    before: str
    after: str
    gradual_s: float = 0.0  # time in which one axle passes from one to the other at mean speed


@dataclass(frozen=True, slots=True)
class Quantile:
    """A quantile with its distribution-free confidence limits."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class ChangeScore:
    """What the drives of one change gave; times in s from the first axle's crossing, infinite where it never happened."""

    change: Change
    model: str
    drives: int
    crossing_s: float  # median time until the last axle is on the new ground
    found: float  # share of drives that told it within HORIZON_S
    delay_median_s: Quantile
    delay_p90_s: Quantile
    reconverged_s: tuple[float, float]  # c and tan phi: from here on as good as afresh, and covered as the nominal rate allows
    error_15_s: tuple[float, float]  # median relative error after 15 s
    fresh_15_s: tuple[float, float]  # the same of the fresh estimator
    coverage_15_s: tuple[float, float]  # of the 95 % interval after 15 s
    coverage_40_s: tuple[float, float]


@dataclass(frozen=True, slots=True)
class FalseAlarms:
    """Alarms on ground that does not change."""

    rover: str
    soil: str
    model: str
    hours: float
    alarms: int


def rate_limits(count: int, hours: float) -> tuple[float, float]:
    """Limits of a rate per hour with CONFIDENCE (Poisson)."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(chi2.ppf(tail, 2 * count)) / 2.0 if count else 0.0
    return low / hours, float(chi2.isf(tail, 2 * count + 2)) / 2.0 / hours


@dataclass(frozen=True, slots=True)
class Series:
    """One drive, every second from the crossing on; NaN where it has ended."""

    delay_s: float
    error: NDArray[np.float64]  # [T, 2] relative
    covered: NDArray[np.float64]  # [T, 2] 1 or 0
    fresh: NDArray[np.float64]  # [T, 2] relative error of the fresh estimator, of its prior before it started
    crossing_s: float


def changed_ground(rover: Rover, change: Change, batch: int, generator: torch.Generator) -> Ground:
    """Random strength and constants on both sides."""
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
    """c and phi [batch, 2] moved by half of their ranges, to where there is room."""
    low, high = torch.tensor([*BENCHMARK.cohesion, *BENCHMARK.angle], dtype=torch.float64).T
    values, half = torch.stack([strength[:, 0], torch.atan(strength[:, 1])], 1), 0.5 * (high - low)
    moved = torch.where(values - low < half, values + half, values - half)
    return torch.stack([moved[:, 0], torch.tan(moved[:, 1])], 1)


def drive_over(rover: Rover, change: Change, batch: int, generator: torch.Generator) -> Drive:
    """Drives long enough for the slowest rover to know the new ground."""
    ground = changed_ground(rover, change, batch, generator)
    patch = ground.patches[1]
    length = patch.start + patch.transition + max(rover.axle_x) - min(rover.axle_x)
    return simulate(rover, ground, "S1", length / (_SLOW * rover.cruise_speed[0]) + _LEAST_AFTER_S, generator, batch)


def study_change(change: Change, model: LoadedModel, config: CoreConfig, drives: int, seed: int) -> ChangeScore:
    """Simulate and judge; drives that get stuck, or end before they know the new ground, are drawn anew."""
    rover, generator = model.rover, torch.Generator().manual_seed(seed)
    series: list[Series] = []
    for _ in range(8):
        drive = drive_over(rover, change, drives, generator)
        measurement = measure_drive(rover, drive.sample, Noise(), generator)
        for index in range(drives):
            place = places_of(drive, index, change)
            if place is not None and len(series) < drives:
                series.append(_follow(model, config, observations_of(measurement, index), _truth(drive, index), place))
        if len(series) == drives:
            break
    return _score(change, model.metadata.model_id, series)


def places_of(drive: Drive, index: int, change: Change) -> tuple[int, int, int] | None:
    """Observations: first axle on the new ground, last axle behind the transition, end. None where the drive does not count."""
    speed, contact = 0.5 * sum(drive.rover.cruise_speed), drive.sample.contact[index]
    first = int((contact.amax(1) < _BEFORE_S * speed).sum())
    last = int((contact.amin(1) < (_BEFORE_S + change.gradual_s) * speed).sum())
    end = int((~drive.sample.stuck[index]).sum())
    return (first, last, end) if last + _LEAST_AFTER_S / TIME_STEP < end else None


def _truth(drive: Drive, index: int) -> NDArray[np.float64]:
    """c and tan phi [T, 2], mean over the axles."""
    truth: NDArray[np.float64] = drive.sample.strength[index].mean(1).numpy()
    return truth


def _follow(
    model: LoadedModel, config: CoreConfig, observations: Sequence[Observation], truth: NDArray[np.float64], place: tuple[int, int, int]
) -> Series:
    first, last, end = place
    per_second = round(1.0 / TIME_STEP)
    end = min(end, first + HORIZON_S * per_second + 1)
    known, fresh = Estimator(model, config), Estimator(model, config)
    prior = fresh.reject(0, Outcome.DUPLICATE, "").estimate
    error, covered, afresh = (np.full((HORIZON_S + 1, 2), np.nan) for _ in range(3))
    delay = math.inf
    for k, observation in enumerate(observations[:end]):
        estimate = known.update(observation).estimate
        newest = fresh.update(observation).estimate if k >= last else prior
        if k >= first and delay == math.inf and estimate.change_probability > ALARM:
            delay = (k - first) * TIME_STEP
        second, part = divmod(k - first, per_second)
        if k >= first and part == 0:
            error[second], afresh[second] = (_error(x, truth[k]) for x in (estimate, newest))
            covered[second] = (estimate.lower_95 <= truth[k]) & (truth[k] <= estimate.upper_95)
    return Series(delay, error, covered, afresh, (last - first) * TIME_STEP)


def _error(estimate: Estimate, truth: NDArray[np.float64]) -> NDArray[np.float64]:
    relative: NDArray[np.float64] = np.abs(estimate.mean - truth) / truth
    return relative


def _score(change: Change, model: str, series: Sequence[Series]) -> ChangeScore:
    error, covered, fresh = (np.stack([getattr(s, name) for s in series]) for name in ("error", "covered", "fresh"))
    delays = np.array([s.delay_s for s in series])
    return ChangeScore(
        change=change,
        model=model,
        drives=len(series),
        crossing_s=float(np.median([s.crossing_s for s in series])),
        found=float(np.mean(delays <= HORIZON_S)),
        delay_median_s=quantile_of(delays, 0.5),
        delay_p90_s=quantile_of(delays, 0.9),
        reconverged_s=_pair([_reconverged(error[..., k], covered[..., k], fresh[..., k]) for k in range(2)]),
        error_15_s=_pair(np.nanmedian(error[:, 15], 0)),
        fresh_15_s=_pair(np.nanmedian(fresh[:, 15], 0)),
        coverage_15_s=_pair(np.nanmean(covered[:, 15], 0)),
        coverage_40_s=_pair(np.nanmean(covered[:, 40], 0)),
    )


def _pair(values: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _reconverged(error: NDArray[np.float64], covered: NDArray[np.float64], fresh: NDArray[np.float64]) -> float:
    """First second from which on the median error is near the fresh one's and the coverage is not excluded by its limits."""
    good = [_good(error[:, second], covered[:, second], fresh[:, second]) for second in range(HORIZON_S + 1)]
    bad = [second for second, well in enumerate(good) if not well]
    return float(bad[-1] + 1) if not good[-1] or bad else 0.0


def _good(error: NDArray[np.float64], covered: NDArray[np.float64], fresh: NDArray[np.float64]) -> bool:
    there = ~np.isnan(error)
    if not there.any():
        return True
    share = share_of(torch.from_numpy(covered[there] > 0.0))
    return bool(np.median(error[there]) <= WORSE * np.median(fresh[there])) and share.high >= NOMINAL


def quantile_of(values: NDArray[np.float64], share: float) -> Quantile:
    """The quantile of a sample, with the order statistics between which the true one lies with CONFIDENCE."""
    ordered, count = np.sort(values), values.shape[0]
    low, high = (int(binom.ppf(0.5 + side * CONFIDENCE / 2.0, count, share)) for side in (-1.0, 1.0))
    last = count - 1
    place = min(max(math.ceil(share * count) - 1, 0), last)
    return Quantile(float(ordered[place]), float(ordered[min(max(low - 1, 0), last)]), float(ordered[min(high, last)]))


def study_constant(model: LoadedModel, soil: str, config: CoreConfig, hours: float, seed: int) -> FalseAlarms:
    """Count alarms (a probability that rises above ALARM) on ground that does not change; each soil constant is off by up to 5 %."""
    generator, rover = torch.Generator().manual_seed(seed), model.rover
    seconds, alarms, batch = 0.0, 0, min(40, math.ceil(3600.0 * hours / _CONSTANT_S))
    while seconds < 3600.0 * hours:
        drive = simulate(rover, random_ground(load_soil(soil), batch, generator, _SPREAD), "S1", _CONSTANT_S, generator, batch)
        measurement = measure_drive(rover, drive.sample, Noise(), generator)
        for index in range(batch):
            end = int((~drive.sample.stuck[index]).sum())
            estimator, above = Estimator(model, config), False
            for observation in observations_of(measurement, index)[:end]:
                told = estimator.update(observation).estimate.change_probability > ALARM
                alarms += told and not above
                above = told
            seconds += end * TIME_STEP
    return FalseAlarms(rover.name, soil, model.metadata.model_id, seconds / 3600.0, alarms)


_CONSTANT_S = 100.0  # duration of a drive on ground that does not change
