# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The test of consistency on series with known answers."""

import numpy as np
import pytest

from studies.consistency.power import judge
from studies.consistency.windows import (
    QUIET,
    WINDOWS,
    Floats,
    alarms,
    calibrated,
    delays,
    score,
    sums,
    surprise,
    threshold_for,
)

ROWS = 8


def white(drives: int, blocks: int, seed: int) -> Floats:
    return np.random.default_rng(seed).standard_normal((drives, blocks, ROWS))


def test_a_window_sums_its_blocks_and_is_unknown_before_it_is_whole() -> None:
    values = white(2, 30, 0)
    values[1, 12:] = np.nan
    whole, squares = sums(values, 10)
    assert np.isnan(whole[:, :9]).all()
    assert np.allclose(whole[0, 9], values[0, :10].sum(0) / 10**0.5)
    assert np.allclose(squares[0, 29, :-1], (values[0, 20:] ** 2).sum(0))
    assert np.allclose(squares[0, 29, -1], (values[0, 20:] ** 2).sum())
    assert np.isfinite(whole[1, 9:12]).all()
    assert np.isnan(whole[1, 12:]).all()


def test_white_series_are_calibrated_as_theory_says() -> None:
    known = calibrated(white(200, 200, 1), 10)
    assert known.deviation == pytest.approx(np.ones(ROWS), abs=0.05)
    assert known.scale == pytest.approx(np.ones(ROWS + 1), abs=0.15)
    assert known.degrees == pytest.approx(np.array([10.0] * ROWS + [80.0]), rel=0.15)
    found = surprise(white(200, 200, 2), known)
    share = (found[:, 9:] > 2.0).mean()  # -log10 of a probability of 1 %
    assert share == pytest.approx(0.01, rel=0.3)


def test_the_threshold_holds_on_other_series_and_an_offset_is_found_soon() -> None:
    halves = [[{"white": white(100, 180, seed)}] for seed in (3, 4)]
    found = judge(*halves)
    assert found.chosen.alarms <= 0.5 * found.chosen.hours
    assert found.judged.limits[0] < 1.0
    offset = white(50, 60, 5)
    offset[..., 3] += 1.5
    values, which = score(offset, list(found.calibrations))
    delay = delays(values, found.threshold)
    assert np.median(delay) <= WINDOWS[0] + 15
    first = which[0, int(delay[0]) - 1]
    assert first % (2 * ROWS + 1) == 3


def test_an_alarm_counts_once_until_it_was_quiet() -> None:
    scores = np.zeros((2, 60))
    scores[0, [5, 6, 6 + QUIET]] = 9.0  # a gap shorter than QUIET
    scores[1, [5, 30]] = 9.0
    assert alarms(scores, 3.0).tolist() == [1, 2]
    assert delays(scores, 3.0).tolist() == [6.0, 6.0]
    assert threshold_for(scores, 1.0, 0.0) == pytest.approx(9.0, abs=1e-6)
