# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of drives onto other ground, with their confidence limits."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from studies.accuracy.scores import CONFIDENCE, share_of
from studies.change.drives import Change, FalseAlarms, Followed
from studies.limited import Limited
from studies.quantiles import quantile_of

WORSE = 1.3
"""[1] Recovered: the median error is at most this multiple of the fresh estimator's."""
NOMINAL = 0.95
AFTER_S = 30
"""[s] Time after the last axle's crossing in which the ground has to be known again."""
SETTLING_S = 15
"""[s] Time after the last axle's crossing that counts for the coverage during a change."""
_RESAMPLES = 400


@dataclass(frozen=True, slots=True)
class ChangeScore:
    """Figures of one change; times from the first axle's crossing, unless said otherwise.

    Infinite for never.
    """

    change: Change
    drives: tuple[int, int, int]  # that count; of them still driving after 15 s and after 40 s
    crossing_s: float  # median time until the last axle is on the new ground
    detected: float  # share of drives that detected it within the horizon
    delay_median_s: Limited
    delay_p90_s: Limited
    # c and tan phi: as good as afresh and covered at the nominal rate from here on, after the last
    # axle's crossing
    recovered_s: tuple[float, float]
    # share of the time in which the 95 % interval covers, until SETTLING_S after the last axle's
    covered: tuple[Limited, Limited]
    error_15_s: tuple[float, float]  # median relative error after 15 s
    fresh_15_s: tuple[float, float]  # the same of the fresh estimator
    coverage_15_s: tuple[float, float]  # of the 95 % interval after 15 s
    coverage_40_s: tuple[float, float]
    before: FalseAlarms  # alarms before the crossing


def rate_limits(count: int, hours: float) -> tuple[float, float]:
    """Return the limits of a rate per hour with CONFIDENCE (Poisson)."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(chi2.ppf(tail, 2 * count)) / 2.0 if count else 0.0
    return low / hours, float(chi2.isf(tail, 2 * count + 2)) / 2.0 / hours


def score_change(change: Change, followed: Followed) -> ChangeScore:
    """Return the figures of all drives of a change; there has to be at least one."""
    error, covered, fresh = followed.error, followed.covered, followed.fresh
    there = ~np.isnan(error[..., 0])
    crossing = float(np.median(followed.crossing_s))
    after = [_after_crossing(values, followed.crossing_s) for values in (error, covered, fresh)]
    recovered = [_recovered(*(values[..., k] for values in after)) for k in range(2)]
    during = [_covered_during(covered[..., k], followed.crossing_s) for k in range(2)]
    return ChangeScore(
        change=change,
        drives=(len(error), int(there[:, 15].sum()), int(there[:, 40].sum())),
        crossing_s=crossing,
        detected=float(np.mean(followed.delay_s <= change.horizon_s)),
        delay_median_s=quantile_of(followed.delay_s, 0.5),
        delay_p90_s=quantile_of(followed.delay_s, 0.9),
        recovered_s=(recovered[0], recovered[1]),
        covered=(during[0], during[1]),
        error_15_s=_over(error[there[:, 15], 15], np.median),
        fresh_15_s=_over(fresh[there[:, 15], 15], np.median),
        coverage_15_s=_over(covered[there[:, 15], 15], np.mean),
        coverage_40_s=_over(covered[there[:, 40], 40], np.mean),
        before=FalseAlarms(
            change.rover,
            change.before,
            float(followed.early_s.sum()) / 3600.0,
            int(followed.early_alarms.sum()),
            int(followed.early_disagreements.sum()),
        ),
    )


def _over(
    values: NDArray[np.float64], figure: Callable[..., NDArray[np.float64]]
) -> tuple[float, float]:
    """Return a figure of c and of tan phi over the remaining drives [n, 2], NaN for none."""
    return (
        (float(figure(values[:, 0])), float(figure(values[:, 1])))
        if len(values)
        else (math.nan, math.nan)
    )


def _after_crossing(
    values: NDArray[np.float64], crossing_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return values [N, T, 2] every second from the last axle's crossing on, NaN beyond the end."""
    moved = np.full((len(values), AFTER_S + 1, 2), np.nan)
    for own, drive, first in zip(moved, values, np.ceil(crossing_s).astype(int), strict=True):
        part = drive[first : first + AFTER_S + 1]
        own[: len(part)] = part
    return moved


def _covered_during(covered: NDArray[np.float64], crossing_s: NDArray[np.float64]) -> Limited:
    """Return the share of a change's time in which the interval covers, over drives [N, T]."""
    ends = np.ceil(crossing_s).astype(int) + SETTLING_S + 1
    shares = np.array([np.nanmean(drive[:end]) for drive, end in zip(covered, ends, strict=True)])
    half = norm.isf(0.5 * (1.0 - CONFIDENCE)) * shares.std() / math.sqrt(len(shares))
    mean = float(shares.mean())
    return Limited(mean, mean - half, mean + half)


def _recovered(
    error: NDArray[np.float64], covered: NDArray[np.float64], fresh: NDArray[np.float64]
) -> float:
    """Return the first second from which on every second is good; infinite where the last is not.

    A second is good where the limits of the median error's ratio to the fresh one's include WORSE,
    and those of the coverage the nominal one. A second without drives is not good.
    """
    good = [
        _good(error[:, second], covered[:, second], fresh[:, second])
        for second in range(error.shape[1])
    ]
    bad = [second for second, well in enumerate(good) if not well]
    if not good[-1]:
        return math.inf
    return float(bad[-1] + 1) if bad else 0.0


def _good(
    error: NDArray[np.float64], covered: NDArray[np.float64], fresh: NDArray[np.float64]
) -> bool:
    there = ~np.isnan(error)
    if not there.any():
        return False
    share = share_of(torch.from_numpy(covered[there] > 0.0))
    return _least_ratio(error[there], fresh[there]) <= WORSE and share.high >= NOMINAL


def _least_ratio(error: NDArray[np.float64], fresh: NDArray[np.float64]) -> float:
    """Return the lower limit of the ratio of two medians over the same drives, by resampling."""
    chosen = np.random.default_rng(0).integers(len(error), size=(_RESAMPLES, len(error)))
    least = 1e-9  # an exact estimate is as good as another
    ratios = (np.median(error[chosen], 1) + least) / (np.median(fresh[chosen], 1) + least)
    return float(np.quantile(ratios, 0.5 * (1.0 - CONFIDENCE)))
