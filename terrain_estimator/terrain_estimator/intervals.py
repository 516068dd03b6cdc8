# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Credible intervals of quantities that cannot be below zero."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtri, ndtri_exp

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
    mean, sd = np.asarray(mean), np.asarray(sd)
    half_width = ndtri(1.0 - 0.5 * outside)
    lower = np.maximum(mean - half_width * sd, 0.0)
    cut = mean - sd * ndtri_exp(np.log(outside) + log_ndtr(mean / sd))
    return lower, np.maximum.reduce([mean + half_width * sd, cut, lower])
