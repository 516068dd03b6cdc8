# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Margins follow from the statics, and carry the uncertainty of c and tan phi through."""

import math

import numpy as np
import pytest
import torch

from terrain_estimator.planning.belief import draw, quantiles
from terrain_estimator.planning.margins import Margins, margins, stall_probability
from terrain_estimator.planning.statics import SLIPS
from terrain_estimator.planning.table import slip_for, steepest
from terramechanics.vehicle.climbing import climb
from tests.terrain_estimator.planning.support import FIRM, ROVER, SOFT, SOIL, belief, table

LIMIT = 0.6


def of(
    strength: tuple[float, float],
    sd: tuple[float, float] = (200.0, 0.03),
    slope: float = 0.0,
    deviation: float = 0.0,
) -> Margins:
    known = belief(strength, sd)
    return margins(table(), draw(known.mean, known.covariance, (1.0,)), slope, LIMIT, deviation)


@pytest.mark.parametrize("strength", [FIRM, SOFT, (800.0, 0.5)])
@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_a_look_up_is_near_the_statics(strength: tuple[float, float], slope: float) -> None:
    looked_up = table().at(0, np.array([strength]), slope)
    slips = torch.tensor(SLIPS, dtype=torch.float64)
    constants, ground = (
        SOIL.constants().expand(len(SLIPS), 6),
        torch.tensor([strength], dtype=torch.float64).expand(len(SLIPS), 2),
    )
    exact = climb(ROVER, constants, ground, torch.full_like(slips, slope), slips)
    np.testing.assert_allclose(
        looked_up.ratio[0], exact.pull / (ROVER.weight * math.cos(slope)), atol=0.006
    )
    np.testing.assert_allclose(looked_up.sinkage[0], exact.sinkage, rtol=0.05)


def test_where_the_ground_is_known_exactly_there_is_one_answer() -> None:
    exact = of(FIRM, sd=(0.0, 0.0), slope=0.1)
    assert exact.available.lower == pytest.approx(exact.available.upper)
    assert exact.needed == pytest.approx(ROVER.weight * math.sin(0.1))
    pulls = table().at(0, np.array([FIRM]), 0.1)
    assert slip_for(pulls, np.array([math.tan(0.1)]))[0] == pytest.approx(exact.slip.median)
    on_limit = of(FIRM, sd=(0.0, 0.0), slope=exact.slope_limit.median)
    assert on_limit.available.median == pytest.approx(on_limit.needed, rel=1e-3)
    assert on_limit.slip.median == pytest.approx(LIMIT, abs=0.01)


def test_more_doubt_widens_every_range_and_lowers_the_slope_that_is_safe() -> None:
    sure, unsure = of(FIRM, (100.0, 0.01), 0.1), of(FIRM, (600.0, 0.08), 0.1)
    for name in ("available", "slope_limit", "slip", "sinkage"):
        narrow, wide = getattr(sure, name), getattr(unsure, name)
        assert narrow.lower < narrow.median < narrow.upper
        assert wide.upper - wide.lower > 2.0 * (narrow.upper - narrow.lower)
    assert unsure.slope_limit.lower < sure.slope_limit.lower


def test_the_steepest_slope_holds_with_the_confidence_that_it_claims() -> None:
    known = belief(FIRM, (500.0, 0.06))
    safe = of(FIRM, (500.0, 0.06)).slope_limit.lower
    grounds = np.random.default_rng(1).multivariate_normal(known.mean, known.covariance, 4000)
    holds = steepest(table(), 0, grounds, LIMIT, np.zeros(4000)) >= safe
    assert (
        0.93 < holds.mean() < 0.97
    )  # 4000 draws: a share of 0.95 is found within 0.014 in 99.99 % of the cases


def test_ground_that_does_not_hold_the_rover_is_told_from_ground_that_does() -> None:
    firm, soft = of(FIRM, slope=0.05), of(SOFT)
    assert firm.stall_probability < 0.01
    assert soft.stall_probability > 0.99
    assert soft.slope_limit.upper < 0.0
    assert soft.slip.median == 1.0


def test_the_probability_alone_is_that_of_the_margins() -> None:
    known = belief((1200.0, 0.5), (400.0, 0.08))
    samples = draw(known.mean, known.covariance, (1.0,))
    whole = margins(table(), samples, 0.05, LIMIT, 0.02).stall_probability
    assert 0.05 < whole < 0.95
    assert stall_probability(table(), samples, 0.05, LIMIT, 0.02) == pytest.approx(whole)


def test_what_the_model_may_be_wrong_by_counts() -> None:
    assert (
        of(FIRM, (1.0, 0.001), deviation=0.05).available.lower
        < of(FIRM, (1.0, 0.001)).available.lower - 0.05 * ROVER.weight
    )


def test_a_quantile_follows_the_weights() -> None:
    values, weight = np.arange(100.0), np.where(np.arange(100) < 50, 0.0, 1.0)
    assert quantiles(values, weight, (0.5,))[0] == pytest.approx(74.5, abs=0.6)


def test_grounds_of_a_soil_that_is_ruled_out_do_not_make_the_others_vanish() -> None:
    samples = draw(np.array(FIRM), np.diag([200.0**2, 0.03**2]), (1.0, 0.0))
    likelihood = np.linspace(-1.0, 0.0, samples.weight[0].size)
    found = samples.reweighted((likelihood - 1000.0, likelihood))
    assert found.weight[0].sum() == pytest.approx(1.0)
    assert found.weight[1].sum() == 0.0
