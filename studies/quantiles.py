# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Quantiles of a sample with limits that take no distribution."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from studies.accuracy.scores import CONFIDENCE
from studies.limited import Limited


def quantile_of(values: NDArray[np.float64], share: float) -> Limited:
    """Return the quantile of a sample, with order statistics as limits at CONFIDENCE."""
    ordered, count = np.sort(values), values.shape[0]
    low, high = (
        int(binom.ppf(0.5 + side * CONFIDENCE / 2.0, count, share)) for side in (-1.0, 1.0)
    )
    last = count - 1
    place = min(max(math.ceil(share * count) - 1, 0), last)
    return Limited(
        float(ordered[place]),
        float(ordered[min(max(low - 1, 0), last)]),
        float(ordered[min(high, last)]),
    )
