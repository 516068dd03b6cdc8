# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The test of the last seconds' fit: honest ones pass, inflated ones do not, changes are let be."""

import numpy as np
import pytest
from scipy.stats import chi2

from terrain_estimator.estimator.consistency import (
    CHANGING,
    CROSSING,
    DELAY,
    DOUBTFUL,
    FALSE_ALARM,
    LARGEST,
    REST,
    WINDOWS,
    Consistency,
    SecondFit,
    limit,
)
from tests.samples import sampled

DEGREES = 7


def after(misfits: list[float], changed: float = 0.0) -> Consistency:
    """Return the test after seconds with these misfits."""
    consistency = Consistency()
    for misfit in misfits:
        consistency.add(SecondFit(misfit, DEGREES), changed)
    return consistency


def first_alarm(misfits: list[float]) -> int:
    """Return the number of seconds at the first disagreement, 0 where there is none."""
    consistency = Consistency()
    for number, misfit in enumerate(misfits, start=1):
        consistency.add(SecondFit(misfit, DEGREES), 0.0)
        if consistency.disagreements():
            return number
    return 0


def test_the_limit_is_the_quantile_of_chi_square() -> None:
    assert limit(1e-6, 70) == pytest.approx(chi2.isf(1e-6, 70))


def test_ten_hours_of_honest_seconds_pass() -> None:
    """One run fails by chance with a probability of at most 4 x 36 000 x 1e-6 = 14 %.

    The seed is fixed; neighbouring windows share most seconds, so the true number is far smaller.
    """
    draws = np.random.default_rng(7).chisquare(DEGREES, 36_000)
    assert first_alarm(draws.tolist()) == 0


@pytest.mark.parametrize(("factor", "latest"), [(3.0, 15), (2.0, 30), (1.5, 70), (1.25, 320)])
def test_worse_fits_are_found_the_sooner_the_worse_they_are(factor: float, latest: int) -> None:
    """Of 40 drives at least 36 are found in time: 78 % of all at a confidence of 95 %."""
    rng = np.random.default_rng(8)
    found = [first_alarm((factor * rng.chisquare(DEGREES, latest)).tolist()) for _ in range(40)]
    assert sum(0 < number <= latest for number in found) >= 36


def test_the_sum_over_a_window_decides() -> None:
    just = limit(FALSE_ALARM, 10 * DEGREES) / 10.0
    enough = WINDOWS[0] + DELAY
    assert not after([just * 0.999] * enough).disagreements()
    assert not after([just * 1.001] * (enough - 1)).disagreements()
    (found,) = after([just * 1.001] * enough).disagreements()
    assert found.finding.startswith("the model does not fit this rover or ground: the last 10 sec")
    assert f"by {just * 1.001 / DEGREES:.3g} times" in found.finding
    assert "find_missing_effect" in found.advice


def test_nothing_is_confirmed_before_enough_seconds_are_judged() -> None:
    enough = WINDOWS[0] + DELAY
    assert "judged from 15 seconds of driving" in Consistency().doubt()
    assert after([6.0] * (enough - 1)).doubt() == Consistency().doubt()
    assert after([6.0] * enough).doubt() == ""


def test_a_sum_that_honest_seconds_seldom_reach_leaves_the_estimate_unconfirmed() -> None:
    just, enough = limit(DOUBTFUL, 10 * DEGREES) / 10.0, WINDOWS[0] + DELAY
    assert after([just * 0.999] * enough).doubt() == ""
    doubted = after([just * 1.001] * enough)
    assert "the last 10 seconds of driving miss it by" in doubted.doubt()
    assert f"where noise explains {just / DEGREES:.3g}" in doubted.doubt()
    assert not doubted.disagreements()


def test_a_small_misfit_is_found_in_the_longest_window() -> None:
    """1.1 times the stated variance: with 2100 degrees of freedom 3.2 standard deviations."""
    assert "the last 300 seconds" in after([1.1 * DEGREES] * (300 + DELAY)).doubt()


def test_honest_seconds_are_seldom_doubted() -> None:
    """Four tests of 2 % each in every second; neighbours share most of theirs."""
    consistency, doubted, number = Consistency(), 0, sampled(6_000, 36_000)
    for misfit in np.random.default_rng(10).chisquare(DEGREES, number):
        consistency.add(SecondFit(float(misfit), DEGREES), 0.0)
        doubted += bool(consistency.doubt())
    assert DOUBTFUL < doubted / number < 4 * DOUBTFUL


def test_after_a_change_of_the_ground_the_fit_has_to_be_confirmed_anew() -> None:
    consistency = after([6.0] * 100)
    assert not consistency.doubt()
    consistency.add(SecondFit(30.0, DEGREES), CHANGING + 0.1)
    waited = 0
    while consistency.doubt():
        consistency.add(SecondFit(6.0, DEGREES), 0.0)
        waited += 1
    assert waited == WINDOWS[0] + DELAY


def test_one_second_however_wrong_is_no_disagreement() -> None:
    fine = [DEGREES - 1.0] * 30
    assert not after([*fine, 1e9, *fine]).disagreements()
    assert limit(LARGEST, DEGREES) < 1e2


def test_seconds_before_a_change_of_the_ground_are_forgotten() -> None:
    wrong = after([30.0] * 30)
    assert wrong.disagreements()
    wrong.add(SecondFit(30.0, DEGREES), CHANGING + 0.1)
    assert not wrong.disagreements()
    for _ in range(100):
        wrong.add(SecondFit(6.0, DEGREES), CHANGING - 0.1)
        assert not wrong.disagreements()


def test_a_change_within_the_delay_comes_before_a_disagreement() -> None:
    consistency = after([6.0] * 100)
    for _ in range(DELAY):
        consistency.add(SecondFit(1e3, DEGREES), 0.0)
        assert not consistency.disagreements()
    consistency.add(SecondFit(1e3, DEGREES), 1.0)
    for _ in range(100):
        consistency.add(SecondFit(6.0, DEGREES), 0.0)
        assert not consistency.disagreements()


def test_a_change_explains_a_misfit_while_the_axles_cross_and_then_for_a_while_none_does() -> None:
    consistency = after([6.0] * 100)
    for _ in range(CROSSING):
        consistency.add(SecondFit(1e3, DEGREES), 1.0)
        assert not consistency.disagreements()
    for _ in range(WINDOWS[0] + DELAY):
        consistency.add(SecondFit(1e3, DEGREES), 1.0)
    assert consistency.disagreements()


@pytest.mark.parametrize("period", [8, 12, 20, 30])
def test_a_ground_that_changes_all_the_time_is_a_wrong_model(period: int) -> None:
    consistency, found = Consistency(), 0
    for second in range(120):
        consistency.add(SecondFit(20.0, DEGREES), float(second % period < 4))
        found += bool(consistency.disagreements())
    assert found > 30


def test_a_change_explains_fifteen_seconds_from_its_first_sign() -> None:
    """Then five wait, so that ten judged ones need thirty in all."""
    consistency, first = after([6.0] * 100), 0
    for second in range(1, 60):
        consistency.add(SecondFit(1e3, DEGREES), 1.0)
        if consistency.disagreements() and not first:
            first = second
    assert first == 15 + 5 + 10


def test_a_change_that_is_as_probable_as_not_explains_nothing() -> None:
    consistency = after([30.0] * 30)
    consistency.add(SecondFit(30.0, DEGREES), CHANGING)
    assert consistency.disagreements()


def test_one_change_in_a_while_is_none() -> None:
    consistency = Consistency()
    for second in range(1, 400):
        crossing = second % (REST + 5) < 8
        consistency.add(SecondFit(40.0 if crossing else 6.0, DEGREES), float(crossing))
        assert not consistency.disagreements()


def test_what_is_kept_is_bounded_and_enough_to_go_on() -> None:
    drawn = np.random.default_rng(9).chisquare(DEGREES, 400).tolist()
    whole = after(drawn)
    assert (len(whole.judged), len(whole.pending), whole.since_change) == (300, DELAY, REST)
    part = after(drawn[:350])
    on = Consistency(part.judged, part.pending, part.since_change)
    for misfit in drawn[350:]:
        on.add(SecondFit(misfit, DEGREES), 0.0)
    assert (on.judged, on.pending) == (whole.judged, whole.pending)
