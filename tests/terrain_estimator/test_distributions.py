# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The distributions of the nodes against scipy's."""

import math

import numpy as np
import pytest
from scipy import special

from terrain_estimator.distributions import (
    chi_square_limit,
    log_normal_cdf,
    normal_cdf,
    normal_quantile,
    normal_quantile_of_log,
)

VALUES = np.linspace(-60.0, 8.0, 2001)
LOGS = -np.logspace(-15.0, 5.0, 2001)


def test_the_normal_distribution_is_that_of_scipy() -> None:
    np.testing.assert_allclose(normal_cdf(VALUES), special.ndtr(VALUES), rtol=1e-13, atol=1e-300)
    np.testing.assert_allclose(
        log_normal_cdf(VALUES), special.log_ndtr(VALUES), rtol=1e-12, atol=1e-30
    )
    probability = special.ndtr(np.linspace(-37.0, 8.0, 2001))
    np.testing.assert_allclose(
        normal_quantile(probability), special.ndtri(probability), rtol=1e-13, atol=1e-15
    )
    np.testing.assert_allclose(
        normal_quantile_of_log(LOGS), special.ndtri_exp(LOGS), rtol=1e-12, atol=1e-12
    )


def test_the_ends_of_the_normal_distribution() -> None:
    ends = np.array([-np.inf, np.inf, np.nan])
    np.testing.assert_array_equal(normal_cdf(ends), [0.0, 1.0, np.nan])
    np.testing.assert_array_equal(log_normal_cdf(ends), [-np.inf, 0.0, np.nan])
    np.testing.assert_array_equal(
        normal_quantile([0.0, 1.0, 2.0, np.nan]), [-np.inf, np.inf, np.nan, np.nan]
    )
    np.testing.assert_array_equal(
        normal_quantile_of_log([-np.inf, 0.0, 1.0, np.nan]), [-np.inf, np.inf, np.nan, np.nan]
    )
    assert normal_cdf([[0.0, 0.0]]).shape == (1, 2)


@pytest.mark.parametrize("degrees", [*range(1, 40), 99, 100, 999, 3600, 3901])
def test_the_limit_of_a_chi_square_variable_is_that_of_scipy(degrees: int) -> None:
    for probability in (1e-12, 1e-6, 1e-5, 0.005, 0.01, 0.3, 0.9, 0.99):
        expected = float(special.chdtri(degrees, probability))
        assert chi_square_limit(degrees, probability) == pytest.approx(expected, rel=1e-11)
    assert chi_square_limit(degrees, 0.0) == math.inf
    assert chi_square_limit(degrees, 1.0) == chi_square_limit(0, 0.01) == 0.0
