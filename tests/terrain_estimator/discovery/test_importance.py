# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Weighted draws against densities whose quantiles are known."""

import numpy as np
import pytest
from scipy.stats import norm, truncnorm

from terrain_estimator.discovery.single_wheel.importance import draws
from terrain_estimator.observation import Floats

ENDS = (0.025, 0.5, 0.975)
ENOUGH = 2000.0


def test_a_correlated_gaussian_cut_by_the_box_has_its_quantiles() -> None:
    """The first coordinate is cut a deviation below its mean, the others are free."""
    mean, count = np.array([1.0, 2.0, -3.0, 0.5]), 4
    covariance = 0.6 * np.ones((count, count)) + 0.4 * np.eye(count)
    precision = np.linalg.inv(covariance)

    def density(values: Floats) -> Floats:
        apart = values - mean
        return np.asarray(-0.5 * np.einsum("vi,ij,vj->v", apart, precision, apart))

    low, high = np.array([0.0, -20.0, -20.0, -20.0]), np.full(count, 20.0)
    found = draws(density, np.full(count, 3.0), low, high, ENOUGH, seed=0)
    assert found.effective >= ENOUGH
    assert found.weights.sum() == pytest.approx(1.0)
    expected = truncnorm(-1.0, np.inf, loc=1.0).ppf(ENDS)
    assert found.quantiles(found.values[:, 0], ENDS) == pytest.approx(expected, abs=0.08)


def test_a_bent_density_has_its_quantiles() -> None:
    """A banana: the second coordinate follows the square of the first, which is normal."""

    def density(values: Floats) -> Floats:
        return np.asarray(
            -0.5 * (values[:, 0] ** 2 + ((values[:, 1] - values[:, 0] ** 2) / 0.5) ** 2)
        )

    low, high = np.array([-10.0, -10.0]), np.array([10.0, 40.0])
    found = draws(density, np.array([2.0, 2.0]), low, high, 5.0 * ENOUGH, seed=1)
    assert found.quantiles(found.values[:, 0], ENDS) == pytest.approx(norm.ppf(ENDS), abs=0.1)


def test_draws_follow_the_seed_alone() -> None:
    def density(values: Floats) -> Floats:
        return np.asarray(-0.5 * (values**2).sum(1))

    ends = np.full(2, -5.0), np.full(2, 5.0)
    one, same, other = (draws(density, np.zeros(2), *ends, 100.0, seed) for seed in (3, 3, 4))
    assert np.array_equal(one.values, same.values)
    assert not np.array_equal(one.values, other.values)
