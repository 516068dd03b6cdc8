# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Times and durations in words."""

import pytest

from terrain_estimator.console.times import clock, duration


@pytest.mark.parametrize(
    ("stamp_s", "text"),
    [
        (0.0, "0:00.0"),
        (-0.04, "0:00.0"),
        (59.96, "0:59.9"),
        (61.3, "1:01.3"),
        (3601.0, "60:01.0"),
        (1_700_000_000.1, "22:13:20.1 UTC"),
    ],
)
def test_a_stamp_is_a_time_of_day_or_minutes_and_seconds(stamp_s: float, text: str) -> None:
    assert clock(stamp_s) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (-0.1, "0 s"),
        (59.4, "59 s"),
        (59.6, "1 min 0 s"),
        (3599.0, "59 min 59 s"),
        (7260.0, "2 h 1 min"),
        (2 * 86400.0 + 3600.0, "2 d 1 h"),
    ],
)
def test_a_duration_has_its_two_largest_units(seconds: float, text: str) -> None:
    assert duration(seconds) == text
