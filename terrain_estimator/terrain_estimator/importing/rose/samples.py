# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of the estimator's inputs from a trial, ten a second, and what was found on the way."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.importing.rose.motion import (
    FEWEST,
    LONGEST,
    STEP,
    Attitudes,
    Motion,
    attitudes,
    motion_at,
    window_of,
)
from terrain_estimator.importing.rose.schema import RoseOptions, axis, wheel_order
from terrain_estimator.importing.rose.trial import Trial
from terrain_estimator.importing.samples import NOTHING, CsvError, MeasuredValue, TableSample
from terrain_estimator.messaging.slip_source import slips_of
from terrain_estimator.observation import Floats
from terramechanics.vehicle.rover import Rover

_SMALLEST_SD = 1e-5
"""[m], [rad] Deviation of a pose that misses its line by nothing."""
_TURN_MEAN = 5
"""Windows over which the yaw rate is averaged to tell a turn."""
_TRUSTED = 1.5
"""[1] Times the stated deviation up to which lines may miss."""

Readings: TypeAlias = tuple[Floats, Floats, Floats]
"""Rates [4] [rad/s], the number of their readings [4], and raw currents [4]."""


@dataclass(slots=True)
class Found:
    """Samples of a trial, and what a user should know of them."""

    samples: list[TableSample] = field(default_factory=list)
    times: list[float] = field(default_factory=list)  # [s] of the samples since the trial's start
    motions: list[Motion] = field(default_factory=list)  # of all windows, those of turns too
    rates: list[Floats] = field(default_factory=list)  # [4] [rad/s] of the windows
    turning_s: float = 0.0
    without_pose_s: float = 0.0
    held_s: float = 0.0
    window: float = 0.0
    position_sd: float = 0.0
    angle_sd: float = 0.0
    notes: list[str] = field(default_factory=list)


class _Windows:
    """Means of readings in the windows about the samples' times."""

    def __init__(self, trial: Trial, options: RoseOptions, window: float) -> None:
        self._trial, self.options, self.window = trial, options, window
        rates = trial.wheels.rate * np.array(options.wheel_signs)
        self.rate, self.current = rates, trial.wheels.current * np.array(options.wheel_signs)
        whole = np.isfinite(rates).any(1)
        times = trial.wheels.time[whole]
        period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        self._length = max(window, 1.5 * period)

    def wheels(self, centre: float) -> Readings:
        """Return the mean readings about a time [s]."""
        at = _within(self._trial.wheels.time, centre, self._length)
        rate, current = self.rate[at], self.current[at]
        # a value that is held between readings is one reading
        changes = (np.diff(rate, axis=0) != 0.0) & np.isfinite(rate[1:])
        return _mean(rate), 1.0 + changes.sum(0), _mean(current)

    def acceleration(self, centre: float) -> MeasuredValue:
        """Return the specific force along body x."""
        if not self.options.acceleration_axis:
            return NOTHING
        at = _within(self._trial.imu.time, centre, self.window)
        values = self._trial.imu.vector[at] @ axis(self.options.acceleration_axis)
        values = values[np.isfinite(values)]
        if not len(values):
            return NOTHING
        sd = self.options.acceleration_sd / math.sqrt(len(values))
        return MeasuredValue(float(values.mean()), sd)


def find(trial: Trial, rover: Rover, options: RoseOptions) -> Found:
    """Return the samples of a trial.

    Raises:
        CsvError: the poses are too few, or contradict the wheels or the stated axes.
    """
    poses = trial.poses
    if len(poses.time) < FEWEST:
        raise CsvError(f"{trial.source}: {len(poses.time)} poses: no velocity follows from them")
    found = Found(window=window_of(poses, options))
    if found.window > LONGEST:
        raise CsvError(
            f"{trial.source}: poses come so seldom that a line through six takes"
            f" {found.window:.3g} s, more than {LONGEST:g} s: give the raw recording, or --window"
        )
    axes, windows = attitudes(poses, options), _Windows(trial, options, found.window)
    _check_up(trial, axes, options)
    kept = list(_moving(found, trial, axes, windows, rover.wheel_radius))
    if not kept:
        raise CsvError(
            f"{trial.source}: no {found.window:.3g} s have {FEWEST} different poses throughout:"
            " give a longer --window, or the raw recording"
        )
    found.motions = [motion for _, motion, _ in kept]
    found.rates = [wheels[0] for _, _, wheels in kept]
    _deviations(found, options)
    turning = _turning(np.array([centre for centre, _, _ in kept]), found.motions, options)
    found.turning_s = STEP * float(turning.sum())
    for (centre, motion, wheels), turns in zip(kept, turning.tolist(), strict=True):
        if options.straight_only and turns:
            continue
        found.times.append(centre)
        found.samples.append(_sample(trial, rover, options, found, centre, motion, wheels, windows))
    if not found.samples:
        raise CsvError(
            f"{trial.source}: the rover turns faster than {options.turn_rate:g} rad/s all the time:"
            " nothing is left of it without --straight-only"
        )
    return found


def _moving(
    found: Found, trial: Trial, axes: Attitudes, windows: _Windows, radius: float
) -> Iterator[tuple[float, Motion, Readings]]:
    """Yield centre [s], motion and wheels of each window that has its poses; count the others."""
    poses, window = trial.poses, windows.window
    fresh, every = poses.fresh, np.ones(len(poses.time), dtype=np.bool_)
    last = max(poses.time[-1], trial.wheels.time[-1] if len(trial.wheels.time) else 0.0)
    steps = np.unique(np.floor((poses.time + 1e-9) / STEP))  # a gap of years takes no time
    found.without_pose_s = STEP * (math.floor((last + 1e-9) / STEP) + 1 - len(steps))
    for step in steps.tolist():
        centre = (step + 0.5) * STEP
        wheels = windows.wheels(centre)
        motion = motion_at(centre, window, poses, axes, fresh)
        if motion is None and (still := motion_at(centre, window, poses, axes, every)):
            # where the rover stands, equal poses are its measurement; else they are held ones
            stands = np.abs(wheels[0]) * radius < windows.options.standstill
            motion = still if stands.all() else None
            found.held_s += STEP * (motion is None)
        elif motion is None:
            found.without_pose_s += STEP
        if motion is not None:
            yield centre, motion, wheels


def _sample(
    trial: Trial,
    rover: Rover,
    options: RoseOptions,
    found: Found,
    centre: float,
    motion: Motion,
    wheels: Readings,
    windows: _Windows,
) -> TableSample:
    order = wheel_order(rover)
    overlap = math.sqrt(max(1.0, found.window / STEP))
    yaw_sd = overlap * found.angle_sd * motion.per_radian
    shift = motion.yaw_rate * options.pose_left
    speeds = [each + shift for each in motion.velocity]
    sds = [
        math.hypot(overlap * found.position_sd * each, yaw_sd * options.pose_left)
        for each in motion.per_metre
    ]
    half = 0.0 if options.track_width is None else 0.5 * options.track_width
    sides = np.array([half if wheel.side == "left" else -half for wheel in rover.wheels])
    rates, counts, currents = (each[order] for each in wheels)
    slips = slips_of(
        rover,
        rates,
        speeds[0] - motion.yaw_rate * sides,
        np.hypot(sds[0], yaw_sd * sides),
        SlipSourceConfig(
            standstill_speed=options.standstill,
            radius_sd=options.radius_sd,
            rate_sd=options.rate_sd / math.sqrt(float(counts.min())),
        ),
    )
    measured = map(MeasuredValue, slips.slip.tolist(), slips.sd.tolist())
    even = MeasuredValue(0.0, options.contact_angle_sd) if options.contact_angle_sd else NOTHING
    gain = math.nan if options.torque_gain is None else options.torque_gain
    return TableSample(
        stamp_ns=trial.start_ns + round(centre * 1e9),
        slip=[NOTHING if math.isnan(each.value) else each for each in measured],
        sinkage=[NOTHING] * len(order),
        contact_angle=[even] * len(order),
        wheel_rate=rates.tolist(),
        torque=(gain * currents).tolist(),
        velocity=MeasuredValue(speeds[1], sds[1]),
        pitch=MeasuredValue(motion.pitch, options.pitch_sd),
        acceleration=windows.acceleration(centre),
        bogie_angle=math.nan,
        roll=motion.roll,
        lateral_velocity=MeasuredValue(
            motion.lateral - motion.yaw_rate * options.pose_ahead,
            math.hypot(
                overlap * found.position_sd * motion.per_radian, yaw_sd * options.pose_ahead
            ),
        ),
        yaw_rate=MeasuredValue(motion.yaw_rate, yaw_sd),
    )


def _deviations(found: Found, options: RoseOptions) -> None:
    """Set the deviations of a pose: the stated one of a position, or by what the lines miss."""
    freedom = max(1, sum(motion.freedom for motion in found.motions))
    missed, turned = (
        math.sqrt(sum(motion.misses[which] for motion in found.motions) / (times * freedom))
        for which, times in ((0, 3), (1, 1))
    )
    found.angle_sd = max(turned, _SMALLEST_SD)
    found.position_sd = options.position_sd or max(missed, _SMALLEST_SD)
    if options.position_sd and missed > _TRUSTED * options.position_sd:
        found.notes.append(
            f"the positions miss their lines by {1e3 * missed:.3g} mm, more than --position-sd"
            f" {1e3 * options.position_sd:.3g} mm: give a larger one, or a shorter --window"
        )


def _turning(
    times: Floats, motions: list[Motion], options: RoseOptions
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return for each window whether the rover turns: by the mean yaw rate of half a second."""
    yaw = np.array([motion.yaw_rate for motion in motions])
    total = np.concatenate([[0.0], np.cumsum(yaw)])
    reach = (_TURN_MEAN / 2 + 1e-6) * STEP
    low = np.searchsorted(times, times - reach)
    high = np.searchsorted(times, times + reach)
    return np.asarray(np.abs((total[high] - total[low]) / (high - low)) > options.turn_rate)


def _check_up(trial: Trial, axes: Attitudes, options: RoseOptions) -> None:
    """Refuse an up axis that lies: a rover does not drive on a wall or on its roof."""
    if float(np.median(axes.up @ axes.above)) > math.cos(math.radians(60.0)):
        return
    forward, up = options.body_axes
    raise CsvError(
        f"{trial.source}: by --body-axes {forward},{up} and --world-up {options.world_up} the rover"
        " does not stand upright: give the axes of your motion capture"
    )


def _within(times: Floats, centre: float, length: float) -> slice:
    low, high = np.searchsorted(times, [centre - 0.5 * length, centre + 0.5 * length])
    return slice(int(low), int(high))


def _mean(values: Floats) -> Floats:
    """Return the means of columns without NaN; NaN of a column that has nothing else."""
    known = np.isfinite(values)
    count = known.sum(0)
    total = np.where(known, values, 0.0).sum(0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
