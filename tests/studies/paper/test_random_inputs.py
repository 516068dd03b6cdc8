# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training tasks with slips and sinkages drawn at random."""

import math

import pytest
import torch

from studies.paper.random_inputs import (
    DEPTHS,
    FASTEST_START,
    GROUNDS,
    SLIPS,
    mean_and_error,
    random_motion,
)
from terramechanics.contact.stresses import wheel_forces_linear_stress
from terramechanics.presets import load_rover, load_soil

ROVER, SOIL = load_rover("paper_rover"), load_soil("loose_sand")
TASKS, STEPS = 400, 20


def test_slip_and_sinkage_fill_their_ranges_and_tell_nothing_about_the_ground() -> None:
    """The correlation of 400 pairs is above 0.21 by chance in one of 40 000 runs."""
    generator = torch.Generator().manual_seed(8)
    strength = GROUNDS.strength(torch.rand(TASKS, 2, generator=generator, dtype=torch.float64))
    motion = random_motion(ROVER, SOIL, strength, 0.1 * STEPS, generator)
    assert motion.slip.shape == motion.sinkage.shape == (TASKS, STEPS, 3)
    for axle, (low, high) in enumerate(SLIPS):
        drawn = motion.slip[..., axle]
        assert low <= float(drawn.min()) < low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) < float(drawn.max()) <= high
    assert DEPTHS[0] <= float(motion.sinkage.min()) < float(motion.sinkage.max()) <= DEPTHS[1]
    together = torch.cat([motion.slip[:, 0], motion.sinkage[:, 0], strength], 1)
    correlation = torch.corrcoef(together.T)
    assert float(correlation[:6, 6:].abs().max()) < 0.21
    assert float(motion.velocity[:, 0].max()) <= FASTEST_START


def test_the_velocity_changes_by_the_traction_of_the_closed_form() -> None:
    generator = torch.Generator().manual_seed(9)
    strength = torch.tensor([[1000.0, math.tan(0.5)]], dtype=torch.float64)
    motion = random_motion(ROVER, SOIL, strength, 0.1 * STEPS, generator)
    affine = wheel_forces_linear_stress(
        motion.slip, motion.sinkage, SOIL.constants(), ROVER.wheel_radius, ROVER.wheel_width
    )
    theta = torch.tensor([1000.0, math.tan(0.5), 1.0], dtype=torch.float64)
    traction = (affine[..., 1, :] @ theta).sum(-1)
    change = motion.velocity.diff(dim=1)
    assert torch.allclose(change, 0.1 / ROVER.mass * traction, rtol=1e-12)


def test_mean_and_standard_error_over_seeds() -> None:
    assert mean_and_error([1.0, 2.0, 3.0, 6.0]) == pytest.approx((3.0, math.sqrt(14.0 / 12.0)))
    assert mean_and_error([4.0]) == (4.0, 0.0)
