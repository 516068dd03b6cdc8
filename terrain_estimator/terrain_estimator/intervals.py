# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Credible intervals of quantities that cannot be below zero."""

import functools
import math

import numpy as np
from numpy.typing import ArrayLike

from terrain_estimator.distributions import (
    log_normal_cdf_at,
    normal_quantile,
    normal_quantile_of_log_at,
)
from terrain_estimator.observation import Floats

OUTSIDE_68 = 0.32
"""[1] Share of the mass outside the band of 68 % on pages."""
HALF_WIDTH_95 = 1.959963984540054
"""[standard deviations] Half width of the 95 % interval of a Gaussian."""


def credible_interval(mean: ArrayLike, sd: ArrayLike, outside: float) -> tuple[Floats, Floats]:
    """Return bounds that leave out the share ``outside`` of a Gaussian's mass, never below zero.

    The bounds have the shape of ``mean`` and ``sd``. With little mass above zero, the upper bound
    leaves out that share of what lies there. Logarithms are used, since far below zero that mass
    underflows.
    """
    mean, sd = np.broadcast_arrays(np.asarray(mean, np.float64), np.asarray(sd, np.float64))
    pairs = zip(mean.ravel().tolist(), sd.ravel().tolist(), strict=True)
    ends = np.reshape([credible_bounds(*each, outside) for each in pairs], (*mean.shape, 2))
    return ends[..., 0], ends[..., 1]


def credible_bounds(mean: float, sd: float, outside: float) -> tuple[float, float]:
    """Return the same of one quantity; NaN where nothing is known."""
    half_width, log_outside = _constants(outside)
    lower = max(mean - half_width * sd, 0.0)
    log_above = log_normal_cdf_at(mean / sd if sd else mean * math.inf)
    cut = mean - sd * normal_quantile_of_log_at(log_outside + log_above)
    return lower, cut if math.isnan(cut) else max(mean + half_width * sd, cut, lower)


@functools.lru_cache
def _constants(outside: float) -> tuple[float, float]:
    """Return half the width of a Gaussian's interval, in deviations, and the log of the share."""
    return float(normal_quantile(1.0 - 0.5 * outside)), float(np.log(outside))
