# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rows in constant memory, and events that last."""

import pytest

from terrain_estimator.dashboard.history import ChartHistory
from terrain_estimator.dashboard.journal import KEPT, Journal


def rows(history: ChartHistory) -> list[tuple[float | None, ...]]:
    return list(history.since(0))


def test_the_recent_history_keeps_the_newest_rows_and_gives_each_viewer_what_it_lacks() -> None:
    history = ChartHistory(period_s=0.2, capacity=5, whole=False)
    for k in range(100):
        history.add((0.1 * k, float(k)))
    assert [row[1] for row in rows(history)] == [
        89.0,
        91.0,
        93.0,
        95.0,
        97.0,
    ]  # two samples a row, the last of them; the newest row is open
    seen = history.end
    history.add((10.0, 100.0))
    assert [row[1] for row in history.since(seen)] == [99.0]
    assert history.generation == 0


def test_a_row_of_a_whole_drive_is_the_mean_of_its_period_where_noise_would_hide_the_course() -> (
    None
):
    history = ChartHistory(period_s=0.4, capacity=10, whole=True, mean=frozenset({1}))
    for k in range(320):
        history.add((0.1 * k, None if k % 4 == 3 else 1.0 + k % 4))
    kept = rows(history)
    assert len(kept) <= 10
    assert [row[1] for row in kept] == [2.0] * len(
        kept
    )  # of 1, 2, 3 and a value that was not known
    once = ChartHistory(period_s=4.0, capacity=10, whole=True, mean=frozenset({1}))
    for k in range(80):
        once.add((0.1 * k, float(k)))
    assert [row[1] for row in rows(once)] == [19.5]
    for k in range(8):
        once.add((8.0 + 0.5 * k, 1.7e308 * (-1) ** k))
    once.add((12.0, 0.0))
    assert rows(once)[-1][1] == pytest.approx(0.0, abs=1e300), (
        "no infinite number, which JSON has not"
    )


def test_the_history_of_a_whole_drive_becomes_coarser_and_loses_no_peak() -> None:
    history = ChartHistory(period_s=0.1, capacity=50, whole=True, worst=frozenset({2}))
    for k in range(20_000):
        peak = 0.9 if k == 7777 else None if k < 100 else 0.0
        history.add((0.1 * k, float(k), peak))
    kept = rows(history)
    assert 25 <= len(kept) <= 50
    first, last = (float(row[1] or 0.0) for row in (kept[0], kept[-1]))
    assert 0.0 < first < 0.05 * 20_000 < 0.95 * 20_000 < last, "the whole drive"
    assert [row[2] for row in kept].count(0.9) == 1
    assert kept[0][2] == 0.0  # what was not known gives way to what was
    assert history.generation > 0, "viewers that have the finer rows are told to take all anew"


def test_a_gap_is_no_row() -> None:
    history = ChartHistory(period_s=1.0, capacity=50, whole=False)
    for time_s in (0.0, 0.9, 1.1, 500.0, 500.9, 501.0):
        history.add((time_s,))
    assert rows(history) == [(0.9,), (1.1,), (500.9,)]


def test_the_journal_holds_what_lasts_at_the_time_when_it_began_and_forgets_the_oldest() -> None:
    journal = Journal()
    for k in range(100):  # there and back at 10 Hz
        journal.see("health", "WARN" if k % 2 else "", 0.1 * k, "warn", "trouble")
    assert list(journal.since(0)) == []
    for k in range(100, 120):
        journal.see("health", "WARN", 0.1 * k, "warn", "trouble")
    [event] = journal.since(0)
    assert (event.text, event.level, round(event.time_s, 3)) == ("trouble", "warn", 9.9)
    for k in range(3 * KEPT):
        journal.write(float(k), "ok", str(k))
    assert [each.text for each in journal.since(0)] == [str(k) for k in range(2 * KEPT, 3 * KEPT)]
    assert [each.text for each in journal.since(journal.end - 1)] == [str(3 * KEPT - 1)]
