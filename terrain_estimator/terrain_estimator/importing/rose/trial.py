# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A trial as it was measured: poses, wheels and imu, each with its own times."""

import math
from dataclasses import dataclass

import numpy as np

from terrain_estimator.observation import Floats

LARGEST = 2_000_000
"""Rows or messages of a trial: more than five hours at 100 Hz."""
FARTHEST = 1e6
"""[m] of a position, and the largest of any other value in its unit."""
_NORM = 0.01  # by which a quaternion may differ from length 1


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Poses that were measured; times are seconds since the trial's start, and increase."""

    time: Floats  # [n] [s]
    position: Floats  # [n, 3] [m]
    orientation: Floats  # [n, 4] unit quaternions x, y, z, w

    @property
    def fresh(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether a pose differs from the one before: a held one measures nothing new."""
        both = np.hstack([self.position, self.orientation])
        return np.concatenate(
            [np.ones(min(len(both), 1), bool), (np.diff(both, axis=0) != 0).any(1)]
        )


@dataclass(frozen=True, slots=True, eq=False)
class Wheels:
    """Readings of the dataset's four wheels; NaN where there is none."""

    time: Floats  # [m] [s]
    rate: Floats  # [m, 4] [rad/s]
    current: Floats  # [m, 4] raw


@dataclass(frozen=True, slots=True, eq=False)
class Accelerations:
    """Readings of the imu."""

    time: Floats  # [k] [s]
    vector: Floats  # [k, 3] [m/s^2]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One trial."""

    source: str  # its file
    start_ns: int
    poses: Poses
    wheels: Wheels
    imu: Accelerations
    notes: tuple[str, ...] = ()


def quaternion_doubt(attitude: list[float]) -> str:
    """Say why four numbers are no attitude; empty where they are one, all 0 or not measured."""
    norm = math.hypot(*attitude)
    if norm == 0.0 or math.isnan(norm) or abs(norm - 1.0) <= _NORM:
        return ""
    return f"has length {norm:.4g} instead of 1"
