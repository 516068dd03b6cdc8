# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The pull on a slope is that with which the simulation climbs it."""

import math

import pytest
import torch

from terramechanics.contact.sinkage import WheelGround, equilibrium_sinkage
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Ramp
from terramechanics.vehicle.climbing import climb

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")


def of(slope: float, slip: float) -> tuple[float, float]:
    one = torch.ones(1, dtype=torch.float64)
    result = climb(
        ROVER, SOIL.constants().unsqueeze(0), SOIL.strength().unsqueeze(0), slope * one, slip * one
    )
    return float(result.pull), float(result.sinkage)


@pytest.mark.parametrize("grade", [-0.05, 0.0, 0.08])
def test_at_the_slip_of_a_steady_climb_the_pull_holds_the_weight(grade: float) -> None:
    generator = torch.Generator().manual_seed(1)
    drive = simulate(ROVER, Ground.constant(SOIL), "S3", 40.0, generator, 1, Ramp(grade, start=0.2))
    sample = drive.sample
    pull, sinkage = of(grade, float(sample.slip[0, -1, 0]))
    assert float(sample.pitch[0, -1]) == pytest.approx(grade)
    assert pull == pytest.approx(ROVER.weight * math.sin(grade), abs=0.002 * ROVER.weight)
    assert sinkage == pytest.approx(float(sample.sinkage[0, -1].mean()), rel=0.01)


def test_without_a_slope_the_sinkage_is_near_that_of_one_wheel_under_its_share() -> None:
    wheel = WheelGround.of(ROVER, SOIL.constants(), SOIL.strength(), 12)
    load = torch.tensor(ROVER.weight / len(ROVER.wheels), dtype=torch.float64)
    alone = equilibrium_sinkage(wheel, torch.tensor(0.2, dtype=torch.float64), load)
    assert of(0.0, 0.2)[1] == pytest.approx(float(alone), rel=0.05)


def test_up_and_down_are_alike() -> None:
    assert of(0.2, 0.3) == pytest.approx(of(-0.2, 0.3), rel=1e-6)
