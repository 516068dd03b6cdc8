# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Velocity, yaw rate and pitch from poses: lines through the poses of a window.

The slope of a line through n positions of deviation s at times t has the deviation
s / sqrt(SUM (t - mean t)^2). Poses 1, 3, 5, ... of a window give the velocity of the slip, poses
2, 4, 6, ... that of the odometry, so that the errors of both are independent, as the estimator
takes them. Where windows overlap, the deviation grows by sqrt(window / step): samples then are not
independent, and a mean of many still has the deviation that follows from theirs.
"""

import math
from dataclasses import dataclass

import numpy as np

from terrain_estimator.importing.rose.schema import RoseOptions, axis
from terrain_estimator.importing.rose.trial import Poses
from terrain_estimator.observation import Floats

STEP = 0.1
"""[s] Time from sample to sample: that of the estimator's observations."""
FEWEST = 4
"""Poses in a window, two for each half."""
USUAL = 6
"""Poses in a window, where the user gives none."""
LONGEST = 1.0
"""[s] Longest window; poses that come more seldom say little of the velocity."""


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of the pose's origin in a window; no number of the deviations has the noise yet."""

    velocity: tuple[float, float]  # [m/s] along body x, of the slip's and the odometry's poses
    per_metre: tuple[float, float]  # [1/s] their deviation for each metre of a position's
    lateral: float  # [m/s] along body y
    yaw_rate: float  # [rad/s] about body z
    per_radian: float  # [1/s] deviation of these two for each metre or radian of a pose's
    pitch: float  # [rad] nose up
    roll: float  # [rad] of body y above the horizon, left side up
    travel: Floats  # [3] [m/s] in the frame of the pose
    misses: tuple[float, float]  # [m^2], [rad^2] sum of squares by which the lines miss
    freedom: int  # degrees of freedom of the second; three times as many of the first


@dataclass(frozen=True, slots=True, eq=False)
class Attitudes:
    """Axes of the body in the world [n, 3], and those of the pose's frame [n, 3, 3]."""

    forward: Floats
    left: Floats
    up: Floats
    frame: Floats
    above: Floats  # [3] the world's up


def attitudes(poses: Poses, options: RoseOptions) -> Attitudes:
    """Return the body's axes for each pose."""
    x, y, z, w = (poses.orientation / np.linalg.norm(poses.orientation, axis=1, keepdims=True)).T
    frame = np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], -1),
            np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], -1),
            np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], -1),
        ],
        axis=1,
    )
    forward, up = (axis(name) for name in options.body_axes)
    above = axis(options.world_up)
    return Attitudes(frame @ forward, frame @ np.cross(up, forward), frame @ up, frame, above)


def window_of(poses: Poses, options: RoseOptions) -> float:
    """Return the length of a window [s]: the user's, or that of six poses, at least a step."""
    if options.window is not None:
        return options.window
    times = poses.time[poses.fresh]
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    return max(STEP, USUAL * period)


def motion_at(
    centre: float,
    window: float,
    poses: Poses,
    axes: Attitudes,
    kept: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> Motion | None:
    """Return the motion in the window about a time [s]; None where too few poses cover it.

    Only poses that are ``kept`` count.
    """
    low, high = np.searchsorted(poses.time, [centre - 0.5 * window, centre + 0.5 * window])
    at = np.flatnonzero(kept[low:high]) + low
    if len(at) < FEWEST:
        return None
    time = poses.time[at] - centre
    edges = np.concatenate([[-0.5 * window], time, [0.5 * window]])
    if np.diff(edges).max() > 0.5 * window * (1.0 + 1e-9):
        return None
    forward = _unit(axes.forward[at].mean(0))
    left = _unit(axes.left[at].mean(0))
    halves = [_slope(time[half::2], poses.position[at[half::2]]) for half in (0, 1)]
    angle = np.arctan2(axes.forward[at] @ left, axes.forward[at] @ forward)
    travel, spread, miss = _slope(time, poses.position[at])
    yaw_rate, _, yaw_miss = _slope(time, angle[:, None])
    return Motion(
        velocity=(float(halves[0][0] @ forward), float(halves[1][0] @ forward)),
        per_metre=(1.0 / halves[0][1], 1.0 / halves[1][1]),
        lateral=float(travel @ left),
        yaw_rate=float(yaw_rate[0]),
        per_radian=1.0 / spread,
        pitch=math.asin(max(-1.0, min(1.0, float(forward @ axes.above)))),
        roll=math.asin(max(-1.0, min(1.0, float(left @ axes.above)))),
        travel=axes.frame[at].mean(0).T @ travel,
        misses=(miss, yaw_miss),
        freedom=len(at) - 2,
    )


def _unit(vector: Floats) -> Floats:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else vector


def _slope(time: Floats, values: Floats) -> tuple[Floats, float, float]:
    """Return slopes of lines [k], the root of the times' sum of squares, and that of the misses."""
    moved, centred = time - time.mean(), values - values.mean(0)
    squares = float(moved @ moved)
    slope = moved @ centred / squares
    missed = centred - moved[:, None] * slope
    return slope, math.sqrt(squares), float((missed**2).sum())
