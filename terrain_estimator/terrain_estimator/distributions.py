# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The normal and the chi-square distribution, for nodes that do not load scipy.

scipy.special takes 25 MB and 0.2 s of a node, its optimiser as much again. The tests compare every
function with scipy's.
"""

import functools
import math
from collections.abc import Callable
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike

from terrain_estimator.observation import Floats

_STANDARD = NormalDist()
_HALF_LOG = 0.5 * math.log(2.0 * math.pi)
_SERIES = -30.0
"""[1] Below it the tail is a series (Abramowitz and Stegun 1964, 26.2.12), of so many terms."""
_TERMS = 8
_ITERATIONS = 50  # where Newton's method has long converged
_CLOSE = 1e-14


def normal_cdf(x: ArrayLike) -> Floats:
    """Return the probability that a standard normal variable is below ``x``, any shape."""
    return _each(normal_cdf_at, x)


def normal_cdf_at(x: float) -> float:
    """Return the same of one number."""
    return 0.5 * math.erfc(-x * math.sqrt(0.5))


def log_normal_cdf(x: ArrayLike) -> Floats:
    """Return the log of :func:`normal_cdf`, also where that is too small for a double."""
    return _each(log_normal_cdf_at, x)


def normal_quantile(probability: ArrayLike) -> Floats:
    """Return what a standard normal variable is below with ``probability``, any shape."""
    return _each(_quantile, probability)


def normal_quantile_of_log(log_probability: ArrayLike) -> Floats:
    """Return what a standard normal variable is below with a probability of which this is the log.

    Any shape; NaN above zero.
    """
    return _each(normal_quantile_of_log_at, log_probability)


def chi_square_limit(degrees: int, probability: float) -> float:
    """Return what a chi-square variable of so many ``degrees`` exceeds with ``probability`` [1].

    Infinite for a probability of 0, and 0 without degrees of freedom. Exact to 1e-12 up to a
    probability of 0.99: what nearly all variables exceed is not asked for.
    """
    if probability <= 0.0:
        return math.inf
    if probability >= 1.0 or degrees == 0:
        return 0.0
    wanted = math.log(probability)
    # Wilson and Hilferty 1931
    third = 2.0 / (9.0 * degrees)
    root = 1.0 - third - float(normal_quantile(probability)) * math.sqrt(third)
    value = degrees * max(root, 1e-2) ** 3
    for _ in range(_ITERATIONS):
        log_exceeded = _log_exceeded(degrees, value)
        # in the log of the value, which cannot become negative
        slope = value * math.exp(_log_density(degrees, value) - log_exceeded)
        step = (log_exceeded - wanted) / slope
        value *= math.exp(max(-1.0, min(step, 1.0)))
        if abs(step) < _CLOSE:
            break
    return value


def _each(function: Callable[[float], float], x: ArrayLike) -> Floats:
    values = np.asarray(x, dtype=np.float64)
    found = [math.nan if math.isnan(each) else function(each) for each in values.ravel().tolist()]
    return np.array(found).reshape(values.shape)


def log_normal_cdf_at(x: float) -> float:
    """Return the log of :func:`normal_cdf` of one number."""
    if x > 0.0:
        return math.log1p(-0.5 * math.erfc(x * math.sqrt(0.5)))
    if x > _SERIES:
        return math.log(0.5 * math.erfc(-x * math.sqrt(0.5)))
    if x == -math.inf:
        return x
    term, total = 1.0, 1.0
    for odd in range(1, 2 * _TERMS, 2):
        term *= -odd / (x * x)
        total += term
    return -0.5 * x * x - math.log(-x) - _HALF_LOG + math.log(total)


def _quantile(probability: float) -> float:
    if 0.0 < probability < 1.0:
        return _STANDARD.inv_cdf(probability)
    return {0.0: -math.inf, 1.0: math.inf}.get(probability, math.nan)


def normal_quantile_of_log_at(log_probability: float) -> float:
    """Return :func:`normal_quantile_of_log` of one number."""
    if log_probability >= 0.0:
        return math.inf if log_probability == 0.0 else math.nan
    if log_probability > -1.0:
        return -_quantile(-math.expm1(log_probability))
    if log_probability > -600.0:
        return _quantile(math.exp(log_probability))
    if log_probability == -math.inf:
        return log_probability
    x = -math.sqrt(-2.0 * log_probability)
    for _ in range(_ITERATIONS):
        log_below = log_normal_cdf_at(x)
        step = (log_below - log_probability) * math.exp(log_below + 0.5 * x * x + _HALF_LOG)
        x -= step
        if abs(step) < -_CLOSE * x:
            break
    return x


@functools.lru_cache(maxsize=8)
def _powers(degrees: int) -> tuple[Floats, Floats]:
    """Return the powers j of half the value in the sum of ``_log_exceeded``, and log j!."""
    powers = np.arange(0.5 * (degrees % 2), 0.5 * degrees)
    return powers, np.array([math.lgamma(each + 1.0) for each in powers.tolist()])


def _log_exceeded(degrees: int, value: float) -> float:
    """Return the log of the probability that a chi-square variable exceeds ``value`` > 0.

    The sum is finite for whole degrees of freedom (Abramowitz and Stegun 1964, 26.4.4 and 26.4.5).
    """
    half = 0.5 * value
    powers, log_factorial = _powers(degrees)
    # the others are below 1e-30 of the largest, at the power ``half`` or the last one
    first = max(0, int(min(half, 0.5 * degrees) - 12.0 * math.sqrt(half) - 60.0))
    logs = powers[first:] * math.log(half) - half - log_factorial[first:]
    if degrees % 2:
        odd = math.log(2.0) + log_normal_cdf_at(-math.sqrt(value))
        logs = np.append(logs, odd)
    highest = float(logs.max())
    return min(highest + math.log(float(np.exp(logs - highest).sum())), 0.0)


def _log_density(degrees: int, value: float) -> float:
    half, shape = 0.5 * value, 0.5 * degrees
    return (shape - 1.0) * math.log(half) - half - math.lgamma(shape) - math.log(2.0)
