# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The sums over the last seconds that come one by one are those of all at once."""

import math

import numpy as np
import pytest

from terrain_estimator.estimator.recent_seconds import RecentSeconds
from terrain_estimator.observation import Floats

ROWS, MOST, WINDOWS = 4, 12, (1, 3, 10, 12)


def seconds(count: int) -> Floats:
    """Return seconds [n, 2 + 2 R], some without a row."""
    generator = np.random.default_rng(4)
    drawn = generator.standard_normal((count, 2 + 2 * ROWS))
    drawn[:, 1] = ROWS
    drawn[::7, -1] = math.nan
    return drawn


def expected(last: Floats) -> list[float]:
    """Return the sums over seconds [n, 2 + 2 R], as their definition has them."""
    white = last[:, 2 + ROWS :]
    there = np.isfinite(white)
    zeroed = np.where(there, white, 0.0)
    number = there.sum(0)
    product = compared = 0.0
    for later in range(len(last)):
        for earlier in range(max(0, later - 3), later):
            product += float(zeroed[later] @ zeroed[earlier])
            compared += float((there[later] & there[earlier]).sum())
    square = float((zeroed.sum(0) ** 2 / np.maximum(number, 1)).sum())
    size = [float(last[:, 0].sum()), float(last[:, 1].sum())]
    return [*size, square, float((number > 0).sum()), product, compared]


@pytest.mark.parametrize("before", [0, 1, 5, MOST])
def test_seconds_that_come_one_by_one_add_up_to_what_they_would_at_once(before: int) -> None:
    drive = seconds(5 * MOST)
    recent = RecentSeconds(drive[:before], MOST)
    for now in range(before, len(drive)):
        recent.append(drive[now])
        kept = drive[max(0, now + 1 - MOST) : now + 1]
        np.testing.assert_array_equal(recent.seconds, kept)
        windows = [window for window in WINDOWS if window <= len(kept)]
        for window, told in zip(windows, recent.told(windows), strict=True):
            np.testing.assert_allclose([*told], expected(kept[-window:]), rtol=1e-12, atol=1e-12)
