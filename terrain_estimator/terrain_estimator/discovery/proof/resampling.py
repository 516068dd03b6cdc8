# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Intervals of statistics of correlated series: the moving-block bootstrap (Kuensch 1989)."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
SAMPLES = 2000
"""Resamplings: seeds move an end of a 95 % interval by about a twentieth of its width."""
CONFIDENCE = 0.95


def replicates(lengths: Sequence[int], block: int) -> int:
    """Return the number of blocks of ``block`` neighbours in series of these lengths."""
    return sum(max(round(length / block), 1) for length in lengths)


def resampled(lengths: Sequence[int], block: int, generator: np.random.Generator) -> Rows:
    """Return row numbers [SAMPLES, n] of series, each replaced by blocks of its own neighbours."""
    rows, first = [], 0
    for length in lengths:
        size = min(block, length)
        count = -(-length // size)
        starts = generator.integers(0, length - size + 1, (SAMPLES, count))
        drawn = (starts[..., None] + np.arange(size)).reshape(SAMPLES, -1)[:, :length]
        rows.append(first + drawn)
        first += length
    return np.concatenate(rows, axis=1)


def interval(statistic: Callable[[Rows], Floats], rows: Rows) -> tuple[float, float] | None:
    """Return the 95 % interval (percentiles) of ``statistic``.

    It takes row numbers [SAMPLES, n] to [SAMPLES].

    None where the statistic is not defined (NaN) in so many resamplings that an end of the interval
    is one of them.
    """
    values = np.nan_to_num(statistic(rows), nan=-np.inf)
    low, high = np.quantile(
        values, [(1.0 - CONFIDENCE) / 2.0, (1.0 + CONFIDENCE) / 2.0], method="nearest"
    )
    return (float(low), float(high)) if np.isfinite(low) else None
