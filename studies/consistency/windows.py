# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The test: sums and squares of whitened innovations over windows of blocks, row by row.

Each number of a block is white and of unit variance where physics and noise are right. A window of
L blocks has for each row the sum over sqrt(L), which an offset moves, and the sum of squares (the
normalised innovation squared, NIS: Bar-Shalom, Li and Kirubarajan 2001, section 5.4), which noise
that is larger than stated moves; besides the NIS of all rows. Each becomes the negative decadic
logarithm of its probability where all is right, so that one threshold serves all. That probability
is calibrated on honest drives: the sum's deviation, and scale and degrees of freedom of the squares
(Satterthwaite 1946).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

Floats = NDArray[np.float64]
WINDOWS = (10, 40)
"""[blocks] Lengths of the windows: what is large is seen early, what is small later."""
QUIET = 10
"""[blocks] An alarm is over after so many below the threshold; the next is another one."""
_LEAST = 1e-300


@dataclass(frozen=True, slots=True)
class Calibration:
    """Honest distributions of the statistics of one window, Q rows and all of them together."""

    length: int
    deviation: Floats  # [Q] of the sums
    scale: Floats  # [Q + 1] of the squares: they are scale times chi-square
    degrees: Floats  # [Q + 1]


def sums(innovations: Floats, length: int) -> tuple[Floats, Floats]:
    """Return sums over sqrt(L) [N, B, Q] and squares [N, B, Q + 1] of the window that ends there.

    ``innovations`` [N, B, Q] are NaN where there is no block, as sums without a whole window are.
    The last of the squares is that of all rows.
    """
    whole = np.full(innovations.shape, np.nan)
    squares = np.full((*innovations.shape[:2], innovations.shape[2] + 1), np.nan)
    if innovations.shape[1] >= length:
        view = np.lib.stride_tricks.sliding_window_view(innovations, length, axis=1)
        whole[:, length - 1 :] = view.sum(-1) / np.sqrt(length)
        squares[:, length - 1 :, :-1] = (view**2).sum(-1)
        squares[:, :, -1] = squares[:, :, :-1].sum(-1)
    return whole, squares


def calibrated(innovations: Floats, length: int) -> Calibration:
    """Return the distributions of honest drives [N, B, Q]."""
    whole, squares = sums(innovations, length)
    mean, variance = np.nanmean(squares, (0, 1)), np.nanvar(squares, (0, 1))
    deviation = np.sqrt(np.nanmean(whole**2, (0, 1)))
    return Calibration(length, deviation, variance / (2.0 * mean), 2.0 * mean**2 / variance)


def surprise(innovations: Floats, known: Calibration) -> Floats:
    """Return -log10 of the probability of each statistic, [N, B, 2 Q + 1]: sums, then squares."""
    whole, squares = sums(innovations, known.length)
    of_sums = 2.0 * norm.sf(np.abs(whole) / known.deviation)
    of_squares = chi2.sf(squares / known.scale, known.degrees)
    return -np.log10(np.maximum(np.concatenate([of_sums, of_squares], -1), _LEAST))


def score(innovations: Floats, known: list[Calibration]) -> tuple[Floats, NDArray[np.int64]]:
    """Return the largest surprise of every block [N, B], 0 without a window, and its statistic.

    The statistics [N, B] are counted through the windows, 2 Q + 1 each.
    """
    every = np.concatenate([surprise(innovations, each) for each in known], -1)
    every = np.nan_to_num(every, nan=0.0)
    return every.max(-1), every.argmax(-1)


def alarms(scores: Floats, threshold: float) -> NDArray[np.int64]:
    """Return the alarms that begin in each drive [N], of scores [N, B]."""
    above = scores > threshold
    begun = np.zeros(len(scores), dtype=np.int64)
    quiet = np.full(len(scores), QUIET)
    for now in above.T:
        begun += now & (quiet >= QUIET)
        quiet = np.where(now, 0, quiet + 1)
    return begun


def threshold_for(scores: Floats, hours: float, rate: float) -> float:
    """Return the least threshold at which honest drives of ``hours`` have ``rate`` alarms [1/h]."""
    most, low, high = rate * hours, 0.0, float(scores.max()) + 1.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if alarms(scores, middle).sum() <= most else (middle, high)
    return high


def delays(scores: Floats, threshold: float) -> Floats:
    """Return the blocks up to the first alarm of each drive [N], infinite without one."""
    above = scores > threshold
    return np.where(above.any(1), above.argmax(1) + 1.0, np.inf)
