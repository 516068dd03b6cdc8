# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Intervals that end at zero, and what counts as identified."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from terrain_estimator.estimator.summary import Beliefs, inflated, summarise

BELIEFS = Beliefs(np.array([2750.0, 0.6]), np.array([1300.0, 0.22]), ("sand",), (1.0,))


def estimate_of(cohesion: float, deviation: float) -> tuple[float, float]:
    found = summarise(np.array([cohesion, 0.6]), np.diag([deviation**2, 0.01]), BELIEFS, (1.0,))
    return float(found.lower_95[0]), float(found.upper_95[0])


def test_far_from_zero_the_interval_is_that_of_the_gaussian() -> None:
    assert estimate_of(1000.0, 100.0) == pytest.approx((804.0, 1196.0), abs=0.1)


@pytest.mark.parametrize("cohesion", [100.0, 0.0, -300.0, -3000.0, -3600.0])
def test_an_interval_cut_at_zero_still_holds_95_percent_of_what_is_above(cohesion: float) -> None:
    lower, upper = estimate_of(cohesion, 100.0)
    assert lower == 0.0
    assert upper > 0.0
    physical = truncnorm(-cohesion / 100.0, np.inf, loc=cohesion, scale=100.0)
    assert physical.cdf(upper) >= 0.95 - 1e-6


@pytest.mark.parametrize("cohesion", [-4e3, -1e5, -1e12])
def test_far_below_zero_the_interval_is_short_but_in_order(cohesion: float) -> None:
    lower, upper = estimate_of(cohesion, 100.0)
    assert lower == 0.0
    assert 0.0 <= upper < 10.0


def test_a_parameter_is_identified_when_the_data_left_a_tenth_of_its_prior_variance() -> None:
    covariance = np.diag([(0.31 * 1300.0) ** 2, (0.33 * 0.22) ** 2])
    assert summarise(np.array([1000.0, 0.6]), covariance, BELIEFS, (1.0,)).identified == (
        True,
        False,
    )


def test_mass_below_zero_is_that_of_both_parameters() -> None:
    found = summarise(np.array([0.0, 0.6]), np.diag([1.0, 0.01]), BELIEFS, (1.0,))
    assert found.mass_below_zero == pytest.approx(0.5, abs=1e-6)


def test_two_sharp_hypotheses_still_give_a_definite_covariance() -> None:
    """They leave only the line between them, whose correlation is 1 up to rounding."""
    along = np.array([140.63, -2.8582e-3])
    _, found = inflated(BELIEFS.prior_mean, np.outer(along, along), BELIEFS, 0.0)
    np.linalg.cholesky(found)
    assert found[0, 1] == found[1, 0] == pytest.approx(along[0] * along[1])
    assert np.diagonal(found) == pytest.approx(along**2, rel=0.0)
    assert abs(found[0, 1]) < np.sqrt(found[0, 0]) * np.sqrt(found[1, 1])
