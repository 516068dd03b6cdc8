# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of a block that moved the soil constants are evaluated anew, and stay finite."""

import math

import pytest
import torch
from torch import Tensor

from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.model.hypotheses import FARTHEST
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packing import view_of, with_sinkage_and_sd
from terramechanics.presets import load_soil

LOADED = load_model("paper_rover")
MODEL = restore(LOADED)
CONSTANTS = MODEL.layout.constants
DRIVES = 60
SEED = 91_500_007
"""Chosen before the figures were known."""


def moved_by(constant: float = 0.0, cohesion: float = 0.0, friction: float = 0.0) -> Tensor:
    """Return where rows are evaluated [2 + M] after these moves from the prior's middle."""
    strength = torch.tensor([2.75 + cohesion, 0.6 + friction], dtype=torch.float64)
    return torch.cat([strength, torch.full((CONSTANTS,), constant, dtype=torch.float64)])


def measured(drives: int) -> Tensor:
    """Return packed observations [drives, 20, P] on loose sand, constants up to 5 % wrong."""
    generator = torch.Generator().manual_seed(SEED)
    soil = load_soil("loose_sand")
    return draw_tasks(LOADED.rover, soil, "S1", 2.0, drives, generator).measured


@pytest.mark.parametrize(
    ("constant", "anew"), [(0.29, False), (0.31, True), (-0.31, True), (0.0, False)]
)
def test_a_block_that_moves_a_constant_by_a_third_of_its_deviation_needs_other_rows(
    constant: float, *, anew: bool
) -> None:
    packed = measured(1)[0, :10]
    found = MODEL.physics.has_moved(packed, moved_by(), moved_by(constant, 1.0, 0.3))
    assert bool(found) == anew


@pytest.mark.parametrize(("cohesion", "friction"), [(0.051, 0.0), (0.0, -0.011)])
def test_a_move_of_c_or_tan_phi_needs_other_rows_only_where_a_sinkage_is_missing(
    cohesion: float, friction: float
) -> None:
    packed = measured(1)[0, :10]
    depth = view_of(packed, LOADED.rover.axles).sinkage.clone()
    depth[3, 1] = math.nan
    lacking = with_sinkage_and_sd(packed, depth, depth)
    before, after = moved_by(), moved_by(cohesion=cohesion, friction=friction)
    assert not bool(MODEL.physics.has_moved(packed, before, after))
    assert bool(MODEL.physics.has_moved(lacking, before, after))


def test_the_load_of_the_second_second_is_predicted_without_a_bias() -> None:
    """60 drives: the mean of as many unit normals is within 0.43 in 99.9 % of samples.

    With the rows of the first second as they were at the prior's constants it is about -1: the load
    is convex in the exponent n.
    """
    states = []
    with torch.inference_mode():
        for drive in measured(DRIVES):
            state = MODEL.initial()
            for observation in drive:
                state = MODEL.update(state, observation)
            states.append(state)
    load = LOADED.rows.index("load")
    misses = torch.stack([state["white_misses"][load] for state in states])
    assert bool(misses.isfinite().all())
    assert abs(float(misses.mean())) < 0.43
    places = torch.stack([state["expansion"] for state in states])
    constants = places[:, :, 2 : 2 + CONSTANTS].abs()
    assert float(constants.max()) <= FARTHEST  # also on the soils that are not the true one
    assert all(bool(value.isfinite().all()) for state in states for value in state_numbers(state))


def state_numbers(state: dict[str, Tensor]) -> list[Tensor]:
    """Return the parts of a state that are numbers of the posterior."""
    return [state[name] for name in ("mean", "precision", "weight", "strength_covariance")]
