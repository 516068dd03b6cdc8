# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Credible intervals of what cannot be below zero."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtri, ndtri_exp

from terrain_estimator.observation import Floats

OUTSIDE_68 = 0.32
"""[1] Share of the mass outside of the band of 68 % that pages show."""
HALF_WIDTH_95 = 1.959963984540054
"""[standard deviations] half width of the 95 % interval of a Gaussian."""


def credible_interval(mean: ArrayLike, sd: ArrayLike, outside: float) -> tuple[Floats, Floats]:
    """Bounds that leave the share ``outside`` of a Gaussian's mass out, never below zero; of the shape of ``mean`` and ``sd``.

    With little mass above zero, the upper bound leaves that share of what lies there; by
    logarithms, since far below zero that mass is no number any more.
    """
    mean, sd = np.asarray(mean), np.asarray(sd)
    half_width = ndtri(1.0 - 0.5 * outside)
    lower = np.maximum(mean - half_width * sd, 0.0)
    cut = mean - sd * ndtri_exp(np.log(outside) + log_ndtr(mean / sd))
    return lower, np.maximum.reduce([mean + half_width * sd, cut, lower])
