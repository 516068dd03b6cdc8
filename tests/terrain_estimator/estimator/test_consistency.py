# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The test of the last seconds' fit: honest ones pass, inflated ones do not, changes are let be."""

import math
from collections.abc import Iterable

import numpy as np
import pytest
from scipy.stats import chi2, norm

from terrain_estimator.estimator.consistency import (
    DELAY,
    DOUBTFUL,
    FALSE_ALARM,
    FEWEST,
    LARGEST,
    WINDOWS,
    Consistency,
    SecondFit,
    limit,
    memory_limit,
    normal_limit,
)
from terrain_estimator.estimator.crossing import CHANGING, LONGEST, REST, Crossing, wheelbases
from terrain_estimator.estimator.recent_seconds import LAGS
from terrain_estimator.model.row_names import row_names
from terrain_estimator.observation import Floats
from terrain_estimator.update import Disagreement
from terramechanics.presets import load_rover
from tests.samples import sampled

DEGREES = 7
ROWS = row_names(3)
NO_ROWS = np.full(len(ROWS), np.nan)
WAY = 0.125
"""[wheelbases] Travel in a second; the last axle crosses eight seconds after the first."""


def fit_of(misfit: float) -> SecondFit:
    """Return a second whose rows are not told."""
    return SecondFit(misfit, DEGREES, NO_ROWS, NO_ROWS)


def with_rows(white: Floats) -> SecondFit:
    """Return a second with these whitened innovations [R], the rows uncorrelated."""
    return SecondFit(float((white**2).sum()), len(white), white, white)


def after(misfits: list[float], changed: float = 0.0) -> Consistency:
    """Return the test after seconds with these misfits."""
    consistency = Consistency(ROWS)
    for misfit in misfits:
        consistency.add(fit_of(misfit), changed, WAY)
    return consistency


def after_rows(whites: Floats) -> Consistency:
    """Return the test after seconds with these innovations [n, R]."""
    consistency = Consistency(ROWS)
    for white in whites:
        consistency.add(with_rows(white), 0.0, WAY)
    return consistency


def disagreements(consistency: Consistency) -> tuple[Disagreement, ...]:
    """Return what withholds the estimate."""
    return consistency.judge()[0]


def doubt(consistency: Consistency) -> str:
    """Return why nothing is called identified."""
    return consistency.judge()[1]


def first_alarm(seconds: Iterable[SecondFit]) -> int:
    """Return the number of seconds at the first disagreement, 0 where there is none."""
    consistency = Consistency(ROWS)
    for number, each in enumerate(seconds, start=1):
        consistency.add(each, 0.0, WAY)
        if disagreements(consistency):
            return number
    return 0


def test_the_limit_is_the_quantile_of_chi_square() -> None:
    assert limit(1e-6, 70) == pytest.approx(chi2.isf(1e-6, 70))


def test_hours_of_honest_seconds_pass() -> None:
    """Ten hours where all are sampled; with at most twelve tests of 1e-6 a second.

    The seed is fixed; neighbouring windows share most seconds, so the true number is far smaller
    than the 43 % that this allows.
    """
    draws = np.random.default_rng(7).standard_normal((sampled(6_000, 36_000), len(ROWS)))
    assert first_alarm(with_rows(each) for each in draws) == 0


@pytest.mark.parametrize(("factor", "latest"), [(3.0, 15), (2.0, 30), (1.5, 70), (1.25, 320)])
def test_worse_fits_are_found_the_sooner_the_worse_they_are(factor: float, latest: int) -> None:
    """Of 40 drives at least 36 are found in time: 78 % of all at a confidence of 95 %."""
    rng = np.random.default_rng(8)
    found = [
        first_alarm(fit_of(each) for each in (factor * rng.chisquare(DEGREES, latest)).tolist())
        for _ in range(40)
    ]
    assert sum(0 < number <= latest for number in found) >= 36


def test_the_sum_over_a_window_decides() -> None:
    just = limit(FALSE_ALARM, 10 * DEGREES) / 10.0
    enough = WINDOWS[0] + DELAY
    assert not disagreements(after([just * 0.999] * enough))
    assert not disagreements(after([just * 1.001] * (enough - 1)))
    (found,) = disagreements(after([just * 1.001] * enough))
    assert found.finding.startswith("the model does not fit this rover or ground: the last 10 sec")
    assert "miss it by 1 times what noise explains" in found.finding
    assert "find_missing_effect" in found.advice


def test_nothing_is_confirmed_before_enough_seconds_are_judged() -> None:
    enough = WINDOWS[0] + DELAY
    assert "judged from 15 seconds of driving" in doubt(Consistency(ROWS))
    assert doubt(after([6.0] * (enough - 1))) == doubt(Consistency(ROWS))
    assert doubt(after([6.0] * enough)) == ""


def test_a_sum_that_honest_seconds_seldom_reach_leaves_the_estimate_unconfirmed() -> None:
    just, enough = limit(DOUBTFUL, 10 * DEGREES) / 10.0, WINDOWS[0] + DELAY
    assert doubt(after([just * 0.999] * enough)) == ""
    doubted = after([just * 1.001] * enough)
    assert "the last 10 seconds of driving miss it by 1 times what noise" in doubt(doubted)
    assert not disagreements(doubted)


def test_a_small_misfit_is_found_in_the_longest_window() -> None:
    """1.1 times the stated variance: with 2100 degrees of freedom 3.2 standard deviations."""
    assert "the last 300 seconds" in doubt(after([1.1 * DEGREES] * (300 + DELAY)))


def test_honest_seconds_are_seldom_doubted() -> None:
    """Ten tests of half a percent each in every second; neighbours share most of theirs."""
    consistency, doubted, number = Consistency(ROWS), 0, sampled(6_000, 36_000)
    for white in np.random.default_rng(10).standard_normal((number, len(ROWS))):
        consistency.add(with_rows(white), 0.0, WAY)
        doubted += bool(doubt(consistency))
    assert DOUBTFUL < doubted / number < 16 * DOUBTFUL


@pytest.mark.parametrize("row", range(len(ROWS)))
def test_an_offset_of_one_row_is_found_and_the_row_named(row: int) -> None:
    """Six tenths of a deviation: a square of 0.36 beside the 8 of a second, unseen in its size."""
    rng = np.random.default_rng(20 + row)
    offset = 0.6 * (np.arange(len(ROWS)) == row)
    whites = rng.standard_normal((max(WINDOWS) + DELAY, len(ROWS))) + offset
    (found,) = disagreements(after_rows(whites))
    assert "miss it to one side, by" in found.finding
    assert found.finding.endswith(f"most in row {ROWS[row]}")
    (sized,) = disagreements(after_rows(3.0 * whites))
    assert "the last 10 seconds of driving miss it by" in sized.finding


@pytest.mark.parametrize("row", range(len(ROWS)))
def test_a_slow_wave_in_one_row_is_found_and_the_row_named(row: int) -> None:
    """Its mean is zero, and its mean square less than the noise's."""
    rng = np.random.default_rng(40 + row)
    wave = 1.4 * np.sin(np.arange(305) / 2.5)
    whites = rng.standard_normal((305, len(ROWS)))
    whites[:, row] += wave
    found = disagreements(after_rows(whites))
    assert found[0].finding.endswith(f"most in row {ROWS[row]}")


def test_a_wave_in_every_row_is_found_by_its_memory_alone() -> None:
    """A quarter of the stated variance in size, and a mean of zero."""
    wave = np.sqrt(0.5) * np.sin(2.0 * np.pi * np.arange(245) / 20.0)
    whites = np.tile(wave[:, np.newaxis], (1, len(ROWS)))
    (found,) = disagreements(after_rows(whites))
    assert "alike one after another, by" in found.finding


def test_the_advice_begins_with_the_signals_of_the_row() -> None:
    for row, name in enumerate(ROWS):
        offset = 2.0 * (np.arange(len(ROWS)) == row)
        (found,) = disagreements(after_rows(np.tile(offset, (60, 1))))
        signal = {"load": "sinkage", "torque_1": "torque", "acceleration": "IMU"}.get(name, "")
        assert found.advice.startswith("look at ")
        assert signal in found.advice.partition(" first; ")[0]


def test_the_fit_of_each_row_is_its_mean_and_deviation_over_the_last_minute() -> None:
    rng = np.random.default_rng(70)
    whites = np.concatenate([np.full((40, len(ROWS)), 3.0), rng.standard_normal((65, len(ROWS)))])
    whites[:, 2] = 0.5 + 1.1 * whites[:, 2]
    whites[:-12, 3] = np.nan
    whites[:, 4] = np.nan
    found = after_rows(whites).fits()
    judged = whites[-65:-DELAY]
    assert [each.row for each in found] == [row for k, row in enumerate(ROWS) if k not in (3, 4)]
    for each in found:
        own = judged[:, ROWS.index(each.row)]
        assert each.offset == pytest.approx(own.mean())
        assert each.spread == pytest.approx(own.std())
    assert after_rows(whites[-14:]).fits() == ()


@pytest.mark.parametrize(("seconds", "rows"), [(20, 2), (20, 8), (60, 8)])
def test_white_seconds_exceed_the_limit_of_the_memory_as_often_as_stated(
    seconds: int, rows: int
) -> None:
    """40 000 windows, 200 expected beyond; within 3.3 standard deviations (99.9 %)."""
    rng, beyond, number = np.random.default_rng(80 + rows), 0, 40_000
    most = memory_limit(DOUBTFUL, seconds, float(rows))
    for _ in range(20):
        white = rng.standard_normal((number // 20, seconds, rows))
        products = sum((white[:, lag:] * white[:, :-lag]).sum((1, 2)) for lag in range(1, LAGS + 1))
        count = rows * sum(seconds - lag for lag in range(1, LAGS + 1))
        beyond += int((products > most * math.sqrt(count)).sum())
    expected = DOUBTFUL * number
    assert abs(beyond - expected) < 3.3 * math.sqrt(expected)


def test_the_limit_of_the_memory_of_many_seconds_is_the_normal_one() -> None:
    assert memory_limit(DOUBTFUL, 300, 1000.0) == pytest.approx(2.5758, rel=5e-3)
    assert memory_limit(FALSE_ALARM, 20, 8.0) > 6.0, "skewed"
    assert memory_limit(FALSE_ALARM, 20, 0.0) == math.inf


def test_side_and_memory_wait_for_twenty_judged_seconds() -> None:
    offset = np.full(len(ROWS), 1.0)
    assert doubt(after_rows(np.tile(offset, (FEWEST + DELAY - 1, 1)))) == ""
    assert "to one side" in doubt(after_rows(np.tile(offset, (FEWEST + DELAY, 1))))


def test_rows_that_are_missing_now_and_then_are_left_out() -> None:
    """A deviation of 1 whatever share of the seconds has the row: no more doubt than with all."""
    rng, doubted = np.random.default_rng(60), 0
    for _ in range(40):
        whites = rng.standard_normal((70, len(ROWS)))
        whites[rng.random(whites.shape) < 0.4] = np.nan
        consistency = Consistency(ROWS)
        for white in whites:
            present = np.isfinite(white)
            size = float(np.nansum(white**2))
            consistency.add(SecondFit(size, int(present.sum()), white, white), 0.0, WAY)
        doubted += bool(doubt(consistency))
    assert doubted <= 6  # of 40; 6 % are expected, 6 or fewer with a probability of 98 %


def test_after_a_change_of_the_ground_the_fit_has_to_be_confirmed_anew() -> None:
    consistency = after([6.0] * 100)
    assert not doubt(consistency)
    consistency.add(fit_of(30.0), CHANGING + 0.1, WAY)
    waited = 0
    while doubt(consistency):
        consistency.add(fit_of(6.0), 0.0, WAY)
        waited += 1
    assert waited == 7 + WINDOWS[0] + DELAY, "after the last axle crossed"


def test_one_second_however_wrong_is_no_disagreement() -> None:
    fine = [DEGREES - 1.0] * 30
    assert not disagreements(after([*fine, 1e9, *fine]))
    assert limit(LARGEST, DEGREES) < 1e2


def test_seconds_before_a_change_of_the_ground_are_forgotten() -> None:
    wrong = after([30.0] * 30)
    assert disagreements(wrong)
    wrong.add(fit_of(30.0), CHANGING + 0.1, WAY)
    assert not disagreements(wrong)
    for _ in range(100):
        wrong.add(fit_of(6.0), CHANGING - 0.1, WAY)
        assert not disagreements(wrong)


def test_a_change_within_the_delay_comes_before_a_disagreement() -> None:
    consistency = after([6.0] * 100)
    for _ in range(DELAY):
        consistency.add(fit_of(1e3), 0.0, WAY)
        assert not disagreements(consistency)
    consistency.add(fit_of(1e3), 1.0, WAY)
    for _ in range(100):
        consistency.add(fit_of(6.0), 0.0, WAY)
        assert not disagreements(consistency)


def test_seconds_count_again_when_the_last_axle_has_crossed() -> None:
    """The change is accepted for a second, then the axles stand on two grounds, then all fits."""
    consistency = after([6.0] * 100)
    consistency.add(fit_of(1e3), 1.0, WAY)
    for _ in range(7):
        consistency.add(fit_of(1e3), 0.0, WAY)
    for _ in range(100):
        consistency.add(fit_of(6.0), 0.0, WAY)
        assert not disagreements(consistency)


def test_a_misfit_that_goes_on_behind_the_border_disagrees() -> None:
    consistency, first = after([6.0] * 100), 0
    consistency.add(fit_of(1e3), 1.0, WAY)
    for second in range(2, 60):
        consistency.add(fit_of(1e3), 0.0, WAY)
        if disagreements(consistency) and not first:
            first = second
    assert first == 8 + DELAY + WINDOWS[0]


def test_the_last_axle_may_show_the_change_again() -> None:
    """It forgets the seconds of the second wheelbase, too; then none does."""
    crossing = Crossing()
    explained = [crossing.explains(float(second in {0, 11, 17}), WAY) for second in range(40)]
    assert [second for second, each in enumerate(explained) if each] == [*range(8), 11]


def test_a_rover_that_travels_no_way_is_across_after_half_a_minute() -> None:
    crossing = Crossing()
    assert [crossing.explains(1.0, 0.0) for _ in range(REST)] == [
        second < LONGEST for second in range(REST)
    ]


def test_the_way_is_that_of_the_wheelbase_forwards_or_backwards() -> None:
    rover = load_rover("mars_rover")
    wheelbase = max(rover.axle_x) - min(rover.axle_x)
    assert wheelbases(rover, -0.5 * wheelbase, math.nan, 1.0) == pytest.approx(0.5)


def test_a_rover_that_turns_on_the_spot_moves_its_first_axle() -> None:
    """By half a wheelbase for every radian."""
    assert wheelbases(load_rover("mars_rover"), 0.0, -0.2, 5.0) == pytest.approx(0.5)


def test_ground_that_changed_is_known_after_three_wheelbases_without_a_sign() -> None:
    """Nothing is until the last axle has crossed; each sign starts that anew."""
    crossing = Crossing()
    assert crossing.unknown == 0.0
    found = []
    for second in range(40):
        crossing.go(float(second in {0, 10}), 0.2)
        found.append(crossing.unknown)
    assert found[:6] == [1.0] * 6
    assert found[9] == pytest.approx(0.6)
    assert found[10:16] == [1.0] * 6
    assert found[20] == pytest.approx(0.5)
    assert found[25:] == pytest.approx([0.0] * 15)


@pytest.mark.parametrize("period", [8, 12, 20, 30])
def test_a_ground_that_changes_all_the_time_is_a_wrong_model(period: int) -> None:
    consistency, found = Consistency(ROWS), 0
    for second in range(120):
        consistency.add(fit_of(20.0), float(second % period < 4), WAY)
        found += bool(disagreements(consistency))
    assert found > 30


def test_a_change_that_never_ends_explains_two_wheelbases() -> None:
    """Then five seconds wait, so that ten judged ones need 31 in all."""
    consistency, first = after([6.0] * 100), 0
    for second in range(1, 60):
        consistency.add(fit_of(1e3), 1.0, WAY)
        if disagreements(consistency) and not first:
            first = second
    assert first == 16 + 5 + 10


def test_a_change_that_is_as_probable_as_not_explains_nothing() -> None:
    consistency = after([30.0] * 30)
    consistency.add(fit_of(30.0), CHANGING, WAY)
    assert disagreements(consistency)


def test_one_change_in_a_while_is_none() -> None:
    consistency = Consistency(ROWS)
    for second in range(1, 400):
        crossing = second % (REST + 5) < 8
        consistency.add(fit_of(40.0 if crossing else 6.0), float(crossing), WAY)
        assert not disagreements(consistency)


def test_what_is_kept_is_bounded_and_enough_to_go_on() -> None:
    drawn = np.random.default_rng(9).standard_normal((400, len(ROWS)))
    whole = after_rows(drawn)
    assert (len(whole.judged), len(whole.pending), whole.crossing.since_change) == (
        300,
        DELAY,
        REST,
    )
    part = after_rows(drawn[:350])
    on = Consistency(ROWS, part.judged, part.pending, part.crossing)
    for white in drawn[350:]:
        on.add(with_rows(white), 0.0, WAY)
    assert on.judge() == whole.judge()
    for name, kept in on.arrays().items():
        np.testing.assert_array_equal(kept, whole.arrays()[name])


@pytest.mark.parametrize("probability", [FALSE_ALARM, DOUBTFUL])
def test_the_quick_comparison_never_lets_a_failure_pass(probability: float) -> None:
    normal = normal_limit(probability)
    assert normal == pytest.approx(norm.isf(probability))
    for degrees in (1, 2, 3, 5, 8, 13, 50, 200, 1000, 3900):
        assert degrees + math.sqrt(2.0 * degrees) * normal < limit(probability, degrees)
    for seconds in (20, 60, 137, 300):
        for rows in (0.1, 1.0, 5.3, 13.0, 100.0):
            assert normal < memory_limit(probability, seconds, rows)
