# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Test whether a quantity that was sampled over a long run grows.

Of the samples after a warm-up (the first fifth) the medians of 25 equally long blocks are taken, so
that noise that lasts shorter than a block does not pass for a trend. It grows where Mann and
Kendall's test finds a trend at 0.1 %, and Theil and Sen's slope over the whole run amounts to more
than a stated share of the level. Without the second a single page of memory would be a leak;
without the first a single jump would.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Values: TypeAlias = Sequence[float] | NDArray[Any]
WARM_UP = 0.2
"""[1] Share of the run, from its start, that is left out."""
BLOCKS = 25
SIGNIFICANCE = 1e-3
"""[1] Probability of a false alarm by the first half of the test on noise without a trend."""


@dataclass(frozen=True, slots=True)
class Trend:
    """One quantity over a run."""

    what: str
    level: float  # median
    growth: float  # [1] over the run, a share of the level
    allowed: float  # [1]
    p_value: float
    grows: bool

    def record(self) -> dict[str, object]:
        """Return the trend for a JSON file."""
        return asdict(self)


def trend(
    what: str, times: Values, values: Values, allowed: float, *, both_ways: bool = False
) -> Trend:
    """Test ``values`` at increasing ``times``; with ``both_ways`` a fall counts as growth too.

    Raises:
        ValueError: there are fewer than two samples a block.
    """
    time, value = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    late = time >= time[0] + WARM_UP * (time[-1] - time[0])
    if np.count_nonzero(late) < 2 * BLOCKS:
        raise ValueError(
            f"{what}: {np.count_nonzero(late)} samples after the warm-up, the test needs"
            f" {2 * BLOCKS}: run longer"
        )
    middles, medians = (
        np.array([np.median(part) for part in np.array_split(each[late], BLOCKS)])
        for each in (time, value)
    )
    level = float(np.median(medians))
    slope = stats.theilslopes(medians, middles).slope * (middles[-1] - middles[0])
    growth = float(slope / level) if level else float(np.sign(slope)) * np.inf if slope else 0.0
    alternative: Literal["two-sided", "greater"] = "two-sided" if both_ways else "greater"
    constant = float(np.ptp(medians)) == 0.0  # no ranks, no test
    p_value = (
        1.0
        if constant
        else float(stats.kendalltau(middles, medians, alternative=alternative).pvalue)
    )
    size = abs(growth) if both_ways else growth
    return Trend(
        what, level, growth, allowed, p_value, bool(p_value < SIGNIFICANCE and size > allowed)
    )


def counted(what: str, times: Values, counts: Values) -> Trend:
    """Test a counter that must not change after the warm-up; the level is its last value."""
    time, count = np.asarray(times, dtype=float), np.asarray(counts, dtype=float)
    late = count[time >= time[0] + WARM_UP * (time[-1] - time[0])]
    grown = float(late[-1] - late[0])
    return Trend(what, float(late[-1]), grown, 0.0, 0.0 if grown else 1.0, grown > 0.0)
