# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Deadlines stay on their grid, however late a step is."""

import time

import pytest

from rover_sim_node.pacing import Pace


def test_deadlines_are_whole_periods_after_the_start() -> None:
    before = time.monotonic()
    pace = Pace(10.0)
    first = pace.remaining_s()
    for _ in range(1000):
        pace.advance()
    spent = time.monotonic() - before
    assert 10.0 - spent <= first <= 10.0
    assert pace.remaining_s() == pytest.approx(10_010.0, abs=spent + 1e-3)
    assert pace.done == 1000


def test_what_is_late_has_a_negative_time_left_and_is_caught_up_with() -> None:
    pace = Pace(1e-9)
    assert pace.remaining_s() < 0.0
    late = pace.remaining_s()
    pace.advance()
    assert pace.remaining_s() <= late + 2e-9
