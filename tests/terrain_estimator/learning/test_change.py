# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of ground that changes: its grounds, its figures and its page, on few drives."""

import math

import numpy as np
import pytest
import torch
from scipy.stats import binom, poisson

from terrain_estimator.cli.change_table import Run, page
from terrain_estimator.config import CoreConfig
from terrain_estimator.learning.change import Change, changed_ground, quantile_of, rate_limits, study_change, study_constant
from terrain_estimator.model_file import LoadedModel, load_model
from terramechanics.rover import load_rover


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model("mars_rover")


def test_another_strength_is_half_a_range_away_and_inside_it() -> None:
    ground = changed_ground(
        load_rover("mars_rover"), Change("mars_rover", "loose_sand", "loose_sand"), 200, torch.Generator().manual_seed(1)
    )
    before, after = (patch.strength for patch in ground.patches)
    torch.testing.assert_close((after - before)[:, 0].abs(), torch.full((200,), 2250.0, dtype=torch.float64))
    turned = torch.rad2deg(torch.atan(after[:, 1]) - torch.atan(before[:, 1])).abs()
    torch.testing.assert_close(turned, torch.full((200,), 15.0, dtype=torch.float64))
    assert ((after[:, 0] >= 500.0) & (after[:, 0] <= 5000.0)).all()
    assert torch.equal(ground.patches[0].constants, ground.patches[1].constants)


def test_a_gradual_change_takes_its_time_at_mean_speed() -> None:
    rover = load_rover("mars_rover")
    ground = changed_ground(rover, Change("mars_rover", "loose_sand", "loose_sand", 20.0), 1, torch.Generator().manual_seed(1))
    assert ground.patches[1].transition == pytest.approx(20.0 * 0.5 * sum(rover.cruise_speed))


def test_two_sharp_changes_are_told_and_known_and_the_page_says_so(model: LoadedModel) -> None:
    """Two drives onto compact sand: each is told within 3 s; 90 % of drives take less than 1 s. One short drive without a change."""
    score = study_change(Change("mars_rover", "loose_sand", "compact_sand"), model, CoreConfig(), 2, seed=3)
    assert score.drives == 2
    assert score.found == 1.0
    assert score.delay_p90_s.value <= 3.0
    assert score.crossing_s > 3.0
    assert np.isfinite(score.error_15_s).all()
    constant = study_constant(model, "loose_sand", CoreConfig(), 0.02, seed=4)
    assert constant.hours >= 0.02
    text = page(Run("2026-01-01", 2, 3, 0.0, [score], [constant]))
    for words in ("loose to compact", "told, median, mars_rover", "false alarms an hour, mars_rover"):
        assert words in text


def test_the_limits_of_a_quantile_are_order_statistics() -> None:
    """Of 100 values the 36th and the 64th enclose the median with at least 99 %."""
    quantile = quantile_of(np.arange(1.0, 101.0), 0.5)
    assert quantile.value == 50.0
    low, high = int(quantile.low), int(quantile.high)
    assert binom.cdf(high - 1, 100, 0.5) - binom.cdf(low - 1, 100, 0.5) >= 0.99
    assert quantile_of(np.array([1.0, math.inf]), 0.9).value == math.inf


def test_the_limits_of_a_rate_are_those_of_poisson() -> None:
    low, high = rate_limits(3, 2.0)
    assert poisson.sf(2, 2.0 * low) == pytest.approx(0.005, rel=1e-6)
    assert poisson.cdf(3, 2.0 * high) == pytest.approx(0.005, rel=1e-6)
    assert rate_limits(0, 1.0)[0] == 0.0
