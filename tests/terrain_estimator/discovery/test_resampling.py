# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Intervals by moving blocks on series whose truth is known."""

import numpy as np
import pytest
from scipy.stats import binomtest

from terrain_estimator.discovery.proof.resampling import (
    Floats,
    Rows,
    interval,
    replicates,
    resampled,
)

SERIES = 200
LENGTHS = [60, 60]


def errors(generator: np.random.Generator) -> Floats:
    """Return series of unit variance in which neighbours share noise."""
    white = [generator.standard_normal(length + 2) for length in LENGTHS]
    return np.concatenate([(each[2:] + each[1:-1] + each[:-2]) / np.sqrt(3.0) for each in white])


def covered(block: int, generator: np.random.Generator) -> int:
    """Return how often the interval holds the true difference of root mean squares, 3 - 1."""
    hits = 0
    for _ in range(SERIES):
        before, after = 3.0 * errors(generator), errors(generator)

        def improvement(rows: Rows, before: Floats = before, after: Floats = after) -> Floats:
            return np.sqrt((before[rows] ** 2).mean(1)) - np.sqrt((after[rows] ** 2).mean(1))

        ends = interval(improvement, resampled(LENGTHS, block, generator))
        assert ends is not None
        hits += ends[0] <= 2.0 <= ends[1]
    return hits


def test_intervals_of_moving_blocks_hold_the_truth_where_those_of_single_seconds_do_not() -> None:
    generator = np.random.default_rng(5)
    blocks, singles = covered(5, generator), covered(1, generator)
    # Of 24 blocks a 95 % interval holds the truth in 91 %; its 99 % limits over SERIES pairs have
    # to agree with 87 to 95 %.
    limits = binomtest(blocks, SERIES).proportion_ci(0.99)
    assert limits.high > 0.87
    assert limits.low < 0.95
    assert binomtest(singles, SERIES).proportion_ci(0.99).high < 0.88


def test_blocks_stay_inside_of_their_series() -> None:
    rows = resampled([7, 4], 5, np.random.default_rng(1))
    assert rows.shape[1] == 11
    assert rows[:, :7].max() < 7
    assert rows[:, 7:].min() >= 7
    assert rows[:, 7:].max() < 11
    assert set(np.diff(rows[:, :5], axis=1).flatten()) == {1}


@pytest.mark.parametrize(("lengths", "pieces"), [([60, 60], 24), ([60], 12), ([3], 1)])
def test_replicates_are_counted_in_blocks(lengths: list[int], pieces: int) -> None:
    assert replicates(lengths, 5) == pieces


def test_a_statistic_that_is_often_undefined_has_no_interval() -> None:
    rows = resampled([20], 5, np.random.default_rng(2))
    assert interval(lambda rows: np.where(rows[:, 0] < 2, np.nan, 1.0), rows) is None
