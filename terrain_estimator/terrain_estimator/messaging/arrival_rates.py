# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rate and jitter of a topic from the arrival times of its messages."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Timing:
    """Rate and jitter of one topic's arrivals."""

    messages: int
    rate_hz: float  # one over the median interval; NaN with fewer than two messages
    jitter_ms_p99: float  # 99th percentile of the distance of an interval from the median one


def timing(arrivals_ns: Sequence[int], time_factor: float = 1.0) -> Timing:
    """Return the timing of increasing arrivals [ns].

    ``time_factor`` converts the rate to simulated time.
    """
    if len(arrivals_ns) < 2:
        return Timing(len(arrivals_ns), float("nan"), float("nan"))
    intervals_s = np.diff(np.asarray(arrivals_ns, dtype=np.int64)).astype(np.float64) * 1e-9
    median_s = float(np.median(intervals_s))
    jitter_s = float(np.percentile(np.abs(intervals_s - median_s), 99))
    return Timing(
        len(arrivals_ns),
        1.0 / (median_s * time_factor) if median_s > 0.0 else float("nan"),
        jitter_s * 1e3,
    )
