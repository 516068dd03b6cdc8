# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The published forecast is the model's, widened or replaced by what it lately missed."""

import math
from collections.abc import Iterator

import numpy as np
import pytest

from terrain_estimator.estimator.forecasting import (
    FEWEST,
    LARGEST_DISTANCE,
    WORSE,
    Forecast,
    Forecasting,
    Hindsight,
)
from terrain_estimator.estimator.persistence import MEMORY
from terrain_estimator.intervals import HALF_WIDTH_95

STEP_S, STEP_NS = 0.1, 100_000_000
DEVIATION = 0.01  # [m/s] of a measured velocity
VARIANCE = 0.02**2  # [m^2/s^2] of the model's forecasts, without the noise
NOISE = DEVIATION**2


def driven(velocities: list[float], missed: list[float]) -> Iterator[tuple[Forecast, float, float]]:
    """Yield the published forecast of each velocity but the first, its innovation and variance.

    The model's forecasts miss by ``missed``.
    """
    forecasting = Forecasting()
    forecasting.observed(0, velocities[0], DEVIATION, STEP_S)
    for k, error in enumerate(missed, 1):
        model = Forecast(velocities[k] - error, VARIANCE, NOISE)
        published = forecasting.publish(model, disagrees=False)
        assert published is not None
        innovation, variance = forecasting.observed(k * STEP_NS, velocities[k], DEVIATION, STEP_S)
        yield published, innovation, variance


def test_a_forecast_that_does_not_miss_is_the_models() -> None:
    for published, innovation, variance in driven([0.1, 0.2] * 20, [0.001] * 39):
        assert (published.variance, published.noise) == (VARIANCE, NOISE)
        assert innovation == pytest.approx(0.001)
        assert variance == pytest.approx(VARIANCE + NOISE)


def test_honest_forecasts_of_a_rover_that_changes_its_speed_keep_their_coverage() -> None:
    """20000 forecasts: 95 % within 0.6 % is four standard errors; widening adds at most that."""
    generator = np.random.default_rng(5)
    velocities = generator.normal(0.0, 0.2, 20_001).tolist()
    missed = generator.normal(0.0, math.sqrt(VARIANCE + NOISE), 20_000).tolist()
    inside = [
        abs(innovation) < HALF_WIDTH_95 * math.sqrt(variance)
        for _, innovation, variance in driven(velocities, missed)
    ]
    assert 0.944 < np.mean(inside) < 0.962


def test_a_forecast_that_misses_more_than_the_velocity_changes_gives_way_to_it() -> None:
    velocities = [0.2 + 0.01 * (-1) ** k for k in range(12)]  # changes by 0.02
    found = [published for published, *_ in driven(velocities, [0.2] * 11)]
    assert all(each.noise == NOISE for each in found[:FEWEST])
    for k, each in enumerate(found[FEWEST:], FEWEST):
        assert each.velocity == velocities[k]
        assert each.variance == pytest.approx(0.02**2)
        assert each.noise == 0.0


def test_a_worse_forecast_is_replaced_from_the_named_ratio_on() -> None:
    change = 0.02
    for ratio, replaced in ((0.99 * WORSE, False), (1.01 * WORSE, True)):
        hindsight = Hindsight()
        for _ in range(20):
            hindsight = hindsight.after(change * math.sqrt(ratio), 1.0, change)
        assert (hindsight.corrected(Forecast(0.5, 1.0, NOISE), 0.2).velocity == 0.2) is replaced


def test_a_model_that_is_right_again_comes_back_in_ten_seconds() -> None:
    velocities = [0.2 * (k % 2) for k in range(200)]
    missed = [0.6] * 20 + [0.01] * 179
    published = [each for each, *_ in driven(velocities, missed)]
    assert published[20].noise == 0.0
    assert published[120].noise == NOISE
    # what was missed fades, and with it the widening
    assert published[198].variance < published[120].variance


def test_missed_forecasts_widen_the_next_by_their_mean_square() -> None:
    """The velocity changes by so much that it is no better."""
    *_, (last, _, _) = driven([0.0, 1.0] * 100, [3.0 * math.sqrt(VARIANCE + NOISE)] * 199)
    total = (last.variance + last.noise) / (VARIANCE + NOISE)
    weight = (1.0 - (1.0 - MEMORY) ** 198) / MEMORY
    assert total == pytest.approx((9.0 * weight + 10.0) / (weight + 10.0))


def test_a_forecast_that_no_variance_explains_stays_finite() -> None:
    hindsight = Hindsight()
    for _ in range(1000):
        hindsight = hindsight.after(100.0, 1e-300, 200.0)
    assert hindsight.distance <= LARGEST_DISTANCE / MEMORY
    assert math.isfinite(hindsight.corrected(Forecast(0.0, 1.0, NOISE), 0.0).variance)


def test_one_miss_counts_as_no_more_than_a_thousand_deviations() -> None:
    assert Hindsight().after(1e4, 1.0, 0.0).distance == 1e6
    assert Hindsight().after(1e3, 1.0, 0.0).distance == 1e6
    assert Hindsight().after(9e2, 1.0, 0.0).distance == pytest.approx(8.1e5)


def test_nothing_is_judged_across_a_gap_or_without_a_forecast() -> None:
    forecasting = Forecasting()
    forecasting.observed(0, 0.1, DEVIATION, STEP_S)
    forecasting.publish(Forecast(0.5, VARIANCE, NOISE), disagrees=False)
    assert math.isnan(forecasting.observed(5 * STEP_NS, 0.1, DEVIATION, STEP_S)[0])
    forecasting.forget()
    assert math.isnan(forecasting.observed(6 * STEP_NS, 0.1, DEVIATION, STEP_S)[0])
    assert forecasting.hindsight == Hindsight()
    assert forecasting.publish(None, disagrees=False) is None
