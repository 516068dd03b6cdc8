# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rules for single numbers of a message, shared by the conversion of one set and of many.

A function that takes :data:`Number` is plain arithmetic: it takes the values of one message as
floats, or those of n messages as arrays [n], with the same bits.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.estimator.wheel_faults import NOISE_BOUND
from terrain_estimator.observation import Floats

UNIT_QUATERNION_TOLERANCE = 0.1  # a norm further from 1 is no orientation (all zeros: "not set")
NOT_MEASURED = -1.0
"""First entry of a covariance of sensor_msgs/Imu whose quantity the sensor does not measure."""

Number = TypeVar("Number", float, Floats)


@dataclass(frozen=True, slots=True)
class Bounds:
    """Closed range of the values that a wheel can have, without noise."""

    low: float
    high: float


ANY = Bounds(-math.inf, math.inf)


def is_possible(value: Number, deviation: Number, bounds: Bounds) -> bool | NDArray[np.bool_]:
    """Return whether a value is in its range, or as near as noise explains."""
    noise = NOISE_BOUND * deviation
    return (bounds.low - noise <= value) & (value <= bounds.high + noise)


def mean(values: Sequence[Number]) -> Number:
    """Return the mean of wheels, at least one; the order of the sum fixes every bit."""
    return total(values) / len(values)


def total(values: Sequence[Number]) -> Number:
    """Return the sum, from the first value on; Python's own sum depends on its version."""
    result = values[0] + 0.0  # no zero is negative
    for value in values[1:]:
        result = result + value
    return result


def usable(
    group: tuple[int, ...], values: list[float], deviations: list[float], bounds: Bounds
) -> list[int]:
    """Return the positions of an axle's wheels that enter the mean.

    They are finite, and possible where any is. A value is impossible where noise does not explain
    it; an average would hide it. Where no wheel is left, all are returned, so that the screening
    reports the reason.
    """
    possible = [
        at
        for at in group
        if math.isfinite(values[at]) and is_possible(values[at], deviations[at], bounds)
    ]
    return possible or [at for at in group if math.isfinite(values[at])] or list(group)


def mean_deviation(deviations: Sequence[float]) -> float:
    """Return the standard deviation of the mean of independent values.

    A bad deviation is passed on, so that the screening refuses it.
    """
    if min(deviations) <= 0.0:
        return min(deviations)
    return math.hypot(*deviations) / len(deviations)


def finite_mean(values: list[float]) -> float:
    """Return the mean of the finite values; NaN where there are none."""
    finite = [value for value in values if math.isfinite(value)]
    return mean(finite) if finite else math.nan


def pitch_of(x: float, y: float, z: float, w: float) -> float:
    """Return the pitch [rad], positive nose up, of an orientation quaternion.

    The quaternion is in REP-103 axes: x forward, y left, z up.

    REP-103's rotation about y is positive nose DOWN, hence the sign. An invalid quaternion (all
    zeros) gives NaN.
    """
    norm = x * x + y * y + z * z + w * w
    if not abs(norm - 1.0) < UNIT_QUATERNION_TOLERANCE:
        return math.nan
    sine = 2.0 * (w * y - z * x) / norm
    return -math.asin(max(-1.0, min(1.0, sine)))


def roll_of(x: float, y: float, z: float, w: float) -> float:
    """Return how far body y points above the horizon [rad], left side up, of a quaternion.

    An invalid quaternion gives NaN.
    """
    norm = x * x + y * y + z * z + w * w
    if not abs(norm - 1.0) < UNIT_QUATERNION_TOLERANCE:
        return math.nan
    sine = 2.0 * (w * x + y * z) / norm
    return math.asin(max(-1.0, min(1.0, sine)))


def optional_of(value: float, variance: float, default: float) -> tuple[float, float]:
    """Return a value and its deviation, both NaN where it was not measured or is no number.

    A negative variance says "not measured".
    """
    deviation = deviation_of(variance, default)
    if math.isfinite(value) and math.isfinite(deviation):
        return float(value), deviation
    return math.nan, math.nan


def deviation_of(variance: float, default: float) -> float:
    """Return the standard deviation of a ROS covariance entry.

    0 means unknown and gives the default; a negative entry gives NaN.
    """
    value = float(variance)
    if value == 0.0:
        return default
    return math.sqrt(value) if value > 0.0 else math.nan


def acceleration_of(x: float, variance: float, default: float) -> tuple[float, float]:
    """Return specific force along body x [m/s^2] and its deviation; NaN where not measured."""
    if variance == NOT_MEASURED:
        return math.nan, math.nan
    deviation = deviation_of(variance, default)
    if deviation == 0.0:
        return math.nan, math.nan
    return float(x), deviation
