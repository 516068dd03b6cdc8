# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The summary of a posterior by its definitions: moments of mixtures, scipy's Gaussians."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.summary import (
    IDENTIFIED_VARIANCE,
    MOST_CORRELATED,
    Beliefs,
    changing,
    definite,
    inflated,
    summarise,
)
from terrain_estimator.intervals import HALF_WIDTH_95, credible_interval
from terrain_estimator.model.metadata import MODELS, read_metadata

METADATA = read_metadata(MODELS / "mars_rover.json")
BELIEFS = Beliefs(np.array([2750.0, 0.6]), np.array([1300.0, 0.22]), ("a", "b"), (0.5, 0.5))
MEAN, COVARIANCE = np.array([900.0, 0.4]), np.array([[250.0**2, -6.0], [-6.0, 0.05**2]])


def test_without_site_knowledge_the_beliefs_are_the_models_and_every_soil_is_as_likely() -> None:
    beliefs = Beliefs.of(METADATA, CoreConfig())
    assert tuple(beliefs.prior_mean) == METADATA.prior_mean
    assert tuple(beliefs.prior_sd) == METADATA.prior_sd
    assert beliefs.soils == tuple(soil.name for soil in METADATA.soils)
    assert beliefs.prior_soils == pytest.approx([1.0 / len(METADATA.soils)] * len(METADATA.soils))


def test_site_knowledge_of_one_parameter_leaves_the_others_to_the_model() -> None:
    cohesion = Beliefs.of(
        METADATA, CoreConfig(prior_cohesion_mean_pa=1234.0, prior_cohesion_sd_pa=56.0)
    )
    assert tuple(cohesion.prior_mean) == (1234.0, METADATA.prior_mean[1])
    assert tuple(cohesion.prior_sd) == (56.0, METADATA.prior_sd[1])
    friction = Beliefs.of(METADATA, CoreConfig(prior_tan_phi_mean=0.7, prior_tan_phi_sd=0.1))
    assert tuple(friction.prior_mean) == (METADATA.prior_mean[0], 0.7)
    assert tuple(friction.prior_sd) == (METADATA.prior_sd[0], 0.1)


def test_a_soil_that_is_known_is_certain_and_an_unknown_one_is_refused_by_name() -> None:
    name = METADATA.soils[1].name
    beliefs = Beliefs.of(METADATA, CoreConfig(prior_soil=name))
    assert beliefs.prior_soils == tuple(float(soil.name == name) for soil in METADATA.soils)
    with pytest.raises(ConfigError, match=r"prior\.soil: 'mud' is unknown"):
        Beliefs.of(METADATA, CoreConfig(prior_soil="mud"))


@pytest.mark.parametrize("doubt", [0.0, 0.1, 0.5, 1.0])
def test_doubt_mixes_the_posterior_with_the_prior(doubt: float) -> None:
    """Mean and covariance of the mixture by its first and second moments."""
    mean, covariance = inflated(MEAN, COVARIANCE, BELIEFS, doubt)
    parts = (
        (1.0 - doubt, MEAN, COVARIANCE),
        (doubt, BELIEFS.prior_mean, np.diag(BELIEFS.prior_sd**2)),
    )
    first = sum(weight * m for weight, m, _ in parts)
    second = sum(weight * (c + np.outer(m, m)) for weight, m, c in parts)
    np.testing.assert_allclose(mean, first, rtol=1e-12)
    expected = second - np.outer(first, first)
    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("unknown", [0.0, 0.3, 1.0])
def test_ground_that_may_go_on_changing_is_as_uncertain_as_the_prior_about_the_mean(
    unknown: float,
) -> None:
    """By E[(x - mean)(x - mean)'] of the prior, of which a share of the deviation is added."""
    found = changing(MEAN, COVARIANCE, BELIEFS, unknown)
    draws = np.random.default_rng(3).normal(BELIEFS.prior_mean, BELIEFS.prior_sd, (400_000, 2))
    expected = COVARIANCE + unknown**2 * np.mean([np.outer(x, x) for x in draws - MEAN], 0)
    scale = np.sqrt(np.diag(expected))
    # 400000 draws: a deviation of 0.002 of the scale
    np.testing.assert_allclose(
        found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.012
    )


@given(
    cohesion=st.floats(1e-3, 1e8),
    friction=st.floats(1e-9, 1.0),
    correlation=st.floats(-1.5, 1.5),
)
def test_a_published_covariance_is_definite_and_keeps_its_variances(
    cohesion: float, friction: float, correlation: float
) -> None:
    shared = correlation * math.sqrt(cohesion * friction)
    found = definite(np.array([[cohesion, shared], [shared, friction]]))
    assert found[0, 0] == cohesion
    assert found[1, 1] == friction
    assert found[0, 1] == found[1, 0]
    kept = found[0, 1] / math.sqrt(cohesion) / math.sqrt(friction)
    assert kept == pytest.approx(max(-MOST_CORRELATED, min(correlation, MOST_CORRELATED)))
    np.linalg.cholesky(found)


def test_unequal_halves_of_a_covariance_are_averaged() -> None:
    found = definite(np.array([[4.0, 1.0], [2.0, 9.0]]))
    assert found.tolist() == [[4.0, 1.5], [1.5, 9.0]]


def test_the_record_holds_interval_mass_and_soils_of_the_posterior() -> None:
    found = summarise(MEAN, COVARIANCE, BELIEFS, (0.25, 0.75))
    sd = np.sqrt(np.diag(COVARIANCE))
    low, high = MEAN - HALF_WIDTH_95 * sd, MEAN + HALF_WIDTH_95 * sd
    np.testing.assert_allclose(found.lower_95, low, rtol=1e-9)
    np.testing.assert_allclose(found.upper_95, high, rtol=1e-5)
    below = float(np.sum(stats.norm.cdf(0.0, MEAN, sd)))
    assert found.mass_below_zero == pytest.approx(below, rel=1e-9)
    assert (found.soils, found.soil_probability) == (("a", "b"), (0.25, 0.75))
    assert (found.change_probability, found.observations_used, found.time_used_s) == (0, 0, 0.0)
    assert found.effects == ()


def test_no_more_than_all_of_the_mass_is_below_zero() -> None:
    found = summarise(np.array([-1e4, -5.0]), COVARIANCE, BELIEFS, (1.0, 0.0))
    assert found.mass_below_zero == 1.0


@pytest.mark.parametrize(("share", "known"), [(0.999, True), (1.001, False)])
def test_each_parameter_is_identified_at_its_own_share_of_the_prior_variance(
    share: float,
    known: bool,  # noqa: FBT001 # a case
) -> None:
    variance = BELIEFS.prior_sd**2 * IDENTIFIED_VARIANCE
    for index in range(2):
        given_variance = 0.5 * variance
        given_variance[index] = share * variance[index]
        found = summarise(MEAN, np.diag(given_variance), BELIEFS, (1.0, 0.0)).identified
        assert found[index] == known
        assert found[1 - index]


@pytest.mark.parametrize("outside", [0.05, 0.32])
def test_a_credible_interval_leaves_its_share_out_wherever_the_mean_is(outside: float) -> None:
    """Far above zero that of the Gaussian; below, at least the rest of what lies above zero."""
    for mean in (8.0, 3.0, 1.0, 0.0, -2.0, -10.0):
        lower, upper = (float(end) for end in credible_interval(mean, 1.0, outside))
        assert 0.0 <= lower <= upper
        cut = stats.truncnorm(-mean, math.inf, loc=mean)
        assert cut.cdf(upper) - cut.cdf(lower) >= 1.0 - outside - 1e-6
    lower, upper = (float(end) for end in credible_interval(8.0, 1.0, outside))
    assert stats.norm.cdf(upper, 8.0) - stats.norm.cdf(lower, 8.0) == pytest.approx(1.0 - outside)
