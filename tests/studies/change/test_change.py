# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Grounds and figures of the study of changes."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.stats import binom, poisson

from studies.change import drives as change
from studies.change.drives import Change, changed_ground
from studies.change.scores import rate_limits, score_change
from studies.change.table import ChangeRun, page
from studies.quantiles import quantile_of
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.model.model_file import load_model
from terramechanics.presets import load_rover

NONE = np.zeros(2)


def test_another_strength_is_half_a_range_away_and_inside_it() -> None:
    ground = changed_ground(
        load_rover("mars_rover"),
        Change("mars_rover", "loose_sand", "loose_sand"),
        200,
        torch.Generator().manual_seed(1),
    )
    before, after = (patch.strength for patch in ground.patches)
    torch.testing.assert_close(
        (after - before)[:, 0].abs(), torch.full((200,), 2250.0, dtype=torch.float64)
    )
    turned = torch.rad2deg(torch.atan(after[:, 1]) - torch.atan(before[:, 1])).abs()
    torch.testing.assert_close(turned, torch.full((200,), 15.0, dtype=torch.float64))
    assert ((after[:, 0] >= 500.0) & (after[:, 0] <= 5000.0)).all()
    assert torch.equal(ground.patches[0].constants, ground.patches[1].constants)


def test_a_gradual_change_takes_its_time_at_mean_speed() -> None:
    rover = load_rover("mars_rover")
    ground = changed_ground(
        rover,
        Change("mars_rover", "loose_sand", "loose_sand", 20.0),
        1,
        torch.Generator().manual_seed(1),
    )
    assert ground.patches[1].transition == pytest.approx(20.0 * 0.5 * sum(rover.cruise_speed))


@pytest.mark.parametrize(
    ("above", "delay", "early"),
    [
        ({*range(32, 40)}, 1.2, 0),
        ({*range(15, 40)}, math.inf, 1),  # already above: not detected
        ({5, 7, 8, *range(15, 25), 41, 50}, 2.1, 3),
    ],
)
def test_an_alarm_has_to_rise_after_the_crossing(
    above: set[int], delay: float, early: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first axle crosses at observation 20; alarms that rise before are false ones."""

    class Alarming:
        def __init__(self, *_: object) -> None:
            self.count = -1

        def update(self, _: object) -> SimpleNamespace:
            self.count += 1
            return self.reject(self.count)

        def reject(self, count: int, *_: object) -> SimpleNamespace:
            alarm = 1.0 if count in above else 0.0
            return SimpleNamespace(
                estimate=SimpleNamespace(
                    change_probability=alarm, mean=NONE, lower_95=NONE, upper_95=NONE
                ),
                disagreements=("misfit",) * (count in above),
            )

    monkeypatch.setattr(change, "Estimator", Alarming)
    observations: list[Any] = [None] * 60
    followed = change._follow(
        load_model("mars_rover"), CoreConfig(), observations, np.ones((60, 2)), (20, 30, 55), 45
    )
    assert followed.delay_s == pytest.approx([delay])
    assert followed.early_alarms == [early]
    assert followed.early_disagreements == [early]
    assert followed.early_s == pytest.approx([2.0])
    assert np.isfinite(followed.error[0, :, 0]).sum() == 4  # seconds 0 to 3, until the drive ends


def test_a_second_in_which_nobody_drives_is_not_a_good_one() -> None:
    """Ten exact drives end after 30 s, or recover 4 s after the first axle's crossing."""
    kind = Change("mars_rover", "loose_sand", "compact_sand")
    delay, crossing = np.full(10, 0.5), np.full(10, 9.0)
    error, covered = np.zeros((10, kind.horizon_s + 1, 2)), np.ones((10, kind.horizon_s + 1, 2))
    error[:, :4] = 1.0
    fresh = np.full_like(error, 0.1)
    whole = change.Followed(
        delay,
        crossing,
        error,
        covered,
        fresh,
        np.full(10, 1800.0),
        np.array([3.0, *[0.0] * 9]),
        np.eye(10)[0],
    )
    score = score_change(kind, whole)
    assert score.drives == (10, 10, 10)
    assert score.recovered_s == (0.0, 0.0)
    assert score_change(kind, whole._replace(crossing_s=np.full(10, 1.5))).recovered_s == (2.0, 2.0)
    assert score.before == change.FalseAlarms("mars_rover", "loose_sand", 5.0, 3, 1)
    assert score.covered[0].value == 1.0
    ended = error.copy()
    ended[:, 31:] = math.nan
    short = score_change(kind, whole._replace(error=ended))
    assert short.drives == (10, 10, 0)
    assert short.recovered_s == (math.inf, math.inf)
    assert math.isnan(short.coverage_40_s[0])
    assert "| 10 / 10 / 0 |" in page(ChangeRun("2026-01-01", 10, 0.0, 3, ["mars"], [short], []))
    assert "| never | **no** |" in page(ChangeRun("2026-01-01", 10, 0.0, 3, ["mars"], [short], []))


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
