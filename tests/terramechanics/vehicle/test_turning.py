# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The pull in a turn is that with which the simulated rover turns, on the level and on slopes."""

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from terrain_estimator.planning.statics import TURNS
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.spatial import BodySimulation, Plane
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.climbing import climb
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.turning import NO_PULL, turn
from terramechanics.vehicle.wheel_places import box_inertia
from tests.rovers import FOUR_WHEELS, SIX_WHEELS

SOIL = load_soil("loose_sand")
OUTER = 0.02
"""[m/s] Rim speed of the outer wheels: so slow that the turn's inertia is nothing."""
GROUNDS = [(800.0, 0.6), (2000.0, 0.75), (5000.0, 1.0)]
"""c [Pa] and tan phi."""
PAIRED = dataclasses.replace(
    FOUR_WHEELS,
    name="paired",
    wheels=(
        *FOUR_WHEELS.wheels,
        *(dataclasses.replace(wheel, name=f"{wheel.name}_inside") for wheel in FOUR_WHEELS.wheels),
    ),
)
"""Two wheels a side of every axle."""


def skid_steer(name: str = "four_wheel_rover", track: float = 0.8) -> Chassis:
    rover = load_rover(name)
    return Chassis.of(rover, track, box_inertia(rover, track))


def doubles(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def pulls(
    chassis: Chassis, ground: tuple[float, float], slips: Tensor, shares: tuple[float, ...]
) -> Tensor:
    """Return pulls over the weight [shares, slips] on the level."""
    count = len(slips)
    constants = SOIL.constants().expand(count, 6)
    strength = doubles(*ground).expand(count, 2)
    found = turn(chassis, constants, strength, torch.zeros_like(slips), slips, shares)
    return found.pull / chassis.weight


@pytest.mark.parametrize("ground", GROUNDS, ids=str)
@pytest.mark.parametrize(("name", "track"), [("four_wheel_rover", 0.8), ("mars_rover", 2.4)])
def test_straight_on_it_is_the_pull_of_a_climb(
    name: str, track: float, ground: tuple[float, float]
) -> None:
    rover, slips = load_rover(name), doubles(-0.1, 0.0, 0.1, 0.3, 0.6)
    slope, count = torch.full_like(slips, 0.2), len(slips)
    given = SOIL.constants().expand(count, 6), doubles(*ground).expand(count, 2), slope, slips
    straight = turn(skid_steer(name, track), *given, [0.0])
    expected = climb(rover, *given)
    torch.testing.assert_close(straight.pull[0], expected.pull, rtol=0.0, atol=2e-3 * rover.weight)
    torch.testing.assert_close(straight.sinkage[0], expected.sinkage, rtol=5e-3, atol=0.0)


@pytest.mark.parametrize("grade", [-0.05, 0.0, 0.02])
@pytest.mark.parametrize("inner", [0.9, 0.6, 0.3, -0.3, -0.7])
@pytest.mark.parametrize("ground", GROUNDS, ids=str)
def test_at_the_slip_and_turn_of_a_steady_drive_the_pull_holds_the_weight(
    ground: tuple[float, float], inner: float, grade: float
) -> None:
    """45 drives of a simulator that takes commands of the wheels and finds how the rover moves."""
    assert_the_pull_holds_the_weight(skid_steer(), ground, inner, grade)


@pytest.mark.parametrize("inner", [0.6, -0.3])
@pytest.mark.parametrize("rover", [SIX_WHEELS, PAIRED], ids=lambda rover: rover.name)
def test_it_does_of_more_axles_and_of_several_wheels_a_side(rover: Rover, inner: float) -> None:
    chassis = Chassis.of(rover, 0.8, box_inertia(rover, 0.8))
    assert_the_pull_holds_the_weight(chassis, GROUNDS[1], inner, 0.02)


def assert_the_pull_holds_the_weight(
    chassis: Chassis, ground: tuple[float, float], inner: float, grade: float
) -> None:
    drive = BodySimulation(
        chassis,
        SOIL.constants().unsqueeze(0),
        doubles(*ground).unsqueeze(0),
        Plane(grade),
        slowest=1e-3 * OUTER,
    )
    left = doubles(*(1.0 if y > 0.0 else 0.0 for y in chassis.wheel_y))
    rim = OUTER * (left * inner + (1.0 - left)).unsqueeze(0)
    half = max(chassis.wheel_y)
    guess = OUTER * doubles(0.4 * (1.0 + inner), 0.0, 0.3 * (1.0 - inner) / half).unsqueeze(0)
    found = drive.settle(rim, torch.zeros_like(rim), guess)
    assert bool(found.solved.all())
    ahead, _, yaw_rate = found.velocity[0].tolist()
    turning = abs(yaw_rate) * half
    assert yaw_rate > 0.0
    assert ahead >= 0.0
    slip = 1.0 - (ahead + turning) / OUTER
    share, slope = turning / (ahead + turning), math.atan(grade)
    result = turn(
        chassis,
        SOIL.constants().unsqueeze(0),
        doubles(*ground).unsqueeze(0),
        doubles(slope),
        doubles(slip),
        [share],
        points=12,
    )
    held = chassis.weight * math.sin(slope)
    assert float(result.pull) == pytest.approx(held, abs=2e-3 * chassis.weight)
    assert float(result.sinkage) == pytest.approx(float(found.depth.mean()), rel=0.01)


@pytest.mark.parametrize("ground", GROUNDS, ids=str)
def test_about_the_inner_wheels_less_pull_is_left_the_tighter_the_turn(
    ground: tuple[float, float],
) -> None:
    shares = (0.0, 0.1, 0.2, 0.3, 0.4)
    found = pulls(skid_steer(), ground, doubles(0.1, 0.3, 0.6), shares)
    assert bool((found > NO_PULL).all())
    assert bool((found[1:] < found[:-1]).all())


@pytest.mark.parametrize("ground", GROUNDS, ids=str)
@pytest.mark.parametrize(("name", "track"), [("four_wheel_rover", 0.8), ("mars_rover", 2.4)])
def test_tables_have_no_holes_where_the_ground_holds_the_turn(
    name: str, track: float, ground: tuple[float, float]
) -> None:
    """From straight on, from the spot or from the next slip every turn of the table is found."""
    found = pulls(skid_steer(name, track), ground, doubles(0.3, 0.4, 0.6, 0.9), TURNS)
    assert bool((found[:, 1:] > NO_PULL).all())


def test_about_the_inner_wheels_the_pull_is_that_of_the_simulator() -> None:
    """Inner hubs that stand drag or drive: the pull is steep there, and the solver once failed."""
    chassis = skid_steer("mars_rover", 2.4)
    constants, strength = SOIL.constants().unsqueeze(0), doubles(3000.0, 0.75).unsqueeze(0)
    drive = BodySimulation(chassis, constants, strength, slowest=1e-3 * OUTER)
    left = doubles(*(1.0 if y > 0.0 else 0.0 for y in chassis.wheel_y))
    rim = OUTER * (1.0 - left - 0.04 * left).unsqueeze(0)
    half = max(chassis.wheel_y)
    found = drive.settle(rim, 0.0 * rim, OUTER * doubles(0.3, 0.0, 0.3 / half).unsqueeze(0))
    assert bool(found.solved.all())
    ahead, _, yaw_rate = found.velocity[0].tolist()
    share = yaw_rate * half / (ahead + yaw_rate * half)
    assert share == pytest.approx(0.5, abs=0.01)
    slips = doubles(0.3, 1.0 - (ahead + yaw_rate * half) / OUTER, 0.6)
    result = turn(
        chassis, constants.expand(3, 6), strength.expand(3, 2), 0.0 * slips, slips, [0.45, share]
    )
    assert float(result.pull[-1, 1]) == pytest.approx(0.0, abs=2e-3 * chassis.weight)


def test_soft_ground_does_not_hold_a_turn_on_the_spot() -> None:
    """Nor does the simulated rover turn there as its wheels do."""
    ground = (300.0, 0.3)
    found = pulls(skid_steer(), ground, doubles(0.1, 0.3, 0.6), TURNS)
    assert bool((found[-1] == NO_PULL).all())
    chassis = skid_steer()
    drive = BodySimulation(
        chassis, SOIL.constants().unsqueeze(0), doubles(*ground).unsqueeze(0), slowest=1e-3 * OUTER
    )
    side = doubles(*(-1.0 if y > 0.0 else 1.0 for y in chassis.wheel_y))
    rim = (OUTER * side).unsqueeze(0)
    settled = drive.settle(rim, torch.zeros_like(rim), torch.zeros(1, 3, dtype=torch.float64))
    assert bool(settled.solved.all())
    slip = 1.0 - float(settled.velocity[0, 2]) * max(chassis.wheel_y) / OUTER
    assert slip > 0.6
