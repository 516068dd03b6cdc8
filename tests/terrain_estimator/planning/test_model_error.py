# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the model may be wrong by moves every margin to the same side."""

import math

import numpy as np
import pytest

from terrain_estimator.planning.belief import Samples, draw
from terrain_estimator.planning.margins import margins, stall_probability, unknown_margins
from terrain_estimator.planning.table import highest_ratio, slip_for, steepest
from tests.terrain_estimator.planning.support import FIRM, ROVER, SOFT, table

LIMIT, SLOPE = 0.6, 0.1


def one_ground(spare: float) -> Samples:
    """A ground known exactly on which the model pulls ``spare`` deviations more than it says."""
    return Samples((np.array([FIRM]),), (np.ones(1),), (np.array([spare]),))


@pytest.mark.parametrize("slope", [-0.1, 0.0, SLOPE])
def test_a_rover_that_pulls_more_than_the_model_slips_less_and_climbs_more(slope: float) -> None:
    better, exact, worse = (
        margins(table(), one_ground(spare), slope, LIMIT, 0.04) for spare in (1.5, 0.0, -1.5)
    )
    across = ROVER.weight * math.cos(slope)
    assert better.available.median - exact.available.median == pytest.approx(0.06 * across)
    assert exact.available.median - worse.available.median == pytest.approx(0.06 * across)
    assert better.slope_limit.median > exact.slope_limit.median > worse.slope_limit.median
    assert better.slip.median < exact.slip.median < worse.slip.median
    assert better.sinkage.median < worse.sinkage.median
    assert better.needed == exact.needed == worse.needed == across * math.tan(slope)


def test_a_shift_of_the_pull_is_a_shift_of_what_is_asked_of_it() -> None:
    """On ground known exactly each margin equals that of the plain table for the shifted need."""
    found = margins(table(), one_ground(2.0), SLOPE, LIMIT, 0.03)
    pulls = table().at(0, np.array([FIRM]), SLOPE)
    slip, sinkage = slip_for(pulls, np.array([math.tan(SLOPE) - 0.06]))
    assert found.slip.median == pytest.approx(slip[0], abs=1e-12)
    assert found.sinkage.median == pytest.approx(sinkage[0], abs=1e-12)
    limit = found.slope_limit.median
    there = highest_ratio(table().at(0, np.array([FIRM]), limit), LIMIT)[0]
    assert math.tan(limit) == pytest.approx(there + 0.06, abs=1e-3)


@pytest.mark.parametrize("spare", [-3.0, -0.2, 0.2, 3.0])
def test_a_stall_is_certain_or_impossible_on_ground_that_is_known(spare: float) -> None:
    highest = highest_ratio(table().at(0, np.array([FIRM]), SLOPE), LIMIT)[0]
    deviation = float(highest - math.tan(SLOPE))
    stalls = float(spare < -1.0)
    assert margins(
        table(), one_ground(spare), SLOPE, LIMIT, deviation
    ).stall_probability == pytest.approx(stalls)
    assert stall_probability(table(), one_ground(spare), SLOPE, LIMIT, deviation) == pytest.approx(
        stalls
    )


def test_each_soil_keeps_its_weight() -> None:
    """Firm and soft ground as two beliefs about a soil: the stall probability is the soft share."""
    firm, soft = (draw(np.array(s), np.zeros((2, 2)), (1.0,)) for s in (FIRM, SOFT))
    both = firm.or_else(soft, 0.3)
    assert margins(table(), both, 0.05, LIMIT, 0.0).stall_probability == pytest.approx(0.3)
    assert stall_probability(table(), both, 0.05, LIMIT, 0.0) == pytest.approx(0.3)


def test_the_steepest_slope_lies_within_45_degrees() -> None:
    wide = np.array([100.0, -100.0])
    slopes = steepest(table(), 0, np.array([FIRM, FIRM]), LIMIT, wide)
    np.testing.assert_allclose(slopes, [math.pi / 4.0, -math.pi / 4.0])


def test_nothing_known_leaves_the_need_alone() -> None:
    nothing = unknown_margins(12.0)
    assert nothing.needed == 12.0
    for value in (nothing.stall_probability, nothing.slip.median, nothing.available.lower):
        assert math.isnan(value)
