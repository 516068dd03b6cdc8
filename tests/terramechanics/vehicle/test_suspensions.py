# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rovers whose loads balances alone do not determine: rigid ones, and bogies on fixed rockers."""

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from terramechanics.presets import load_soil
from terramechanics.simulation.simulation import simulate
from terramechanics.simulation.spatial import BodySample, BodySimulation, Plane
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.surface import Level, Surface, Waves, random_waves
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.climbing import climb
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.stance import Attitude, solve_stance
from terramechanics.vehicle.steering import skid_command
from tests.rovers import BY_WHEEL_ALONE, EIGHT_WHEELS, FIXED_ROCKERS, MARS, SIX_WHEELS

SOIL = load_soil("loose_sand")
SIX, EIGHT = (Chassis.of(each, 0.57, 10.0) for each in (SIX_WHEELS, EIGHT_WHEELS))
FIXED, BORNE = (Chassis.of(each, 1.0, 20.0) for each in (FIXED_ROCKERS, MARS))
EVERY = (SIX, EIGHT, FIXED)
GROUND: dict[str, tuple[Plane, Surface]] = {
    "flat": (Plane(), Level()),
    "slope": (Plane(0.1, 0.15), Level()),
    "bumps": (
        Plane(),
        random_waves(1, math.radians(6.0), torch.Generator().manual_seed(3), (0.8, 3.0)),
    ),
}
ACROSS = Waves(
    torch.tensor([[0.1]], dtype=torch.float64),
    torch.tensor([[[1.5, 2.5]]], dtype=torch.float64),
    torch.tensor([[0.4]], dtype=torch.float64),
)
"""A bump that runs aslant, which lifts left and right by different amounts."""


def driven(
    chassis: Chassis,
    ground: tuple[Plane, Surface],
    turn: float = 0.0,
    seconds: float = 4.0,
    step: float = 0.1,
) -> list[BodySample]:
    """Drive for some time with a commanded yaw rate ``turn`` [rad/s]."""
    simulation = BodySimulation(
        chassis, SOIL.constants()[None], SOIL.strength()[None], ground[0], time_step=step,
        surface=ground[1],
    )  # fmt: skip
    twist = torch.tensor([[0.15, 0.0, turn]], dtype=torch.float64)
    command = skid_command(chassis, twist)
    samples = [simulation.step(*command) for _ in range(round(seconds / step))]
    assert all(bool(each.solved.all()) for each in samples)
    return samples


def loads(samples: list[BodySample]) -> Tensor:
    """Return the normal forces [times, wheels] [N]."""
    return torch.cat([each.forces[..., 0] for each in samples])


@pytest.mark.parametrize("rover", BY_WHEEL_ALONE, ids=lambda each: each.name)
def test_the_planar_plant_refuses_them_and_says_what_to_make(rover: Rover) -> None:
    words = rf"{rover.name}: axle_x has {rover.axles} axles and joints 0: .* make a model by wheel"
    one = torch.ones(1, dtype=torch.float64)
    with pytest.raises(ConfigError, match=words):
        simulate(rover, Ground.constant(SOIL), "S1", 1.0, torch.Generator(), 1)
    with pytest.raises(ConfigError, match=words):
        climb(rover, SOIL.constants()[None], SOIL.strength()[None], 0.0 * one, 0.1 * one)


@pytest.mark.parametrize("chassis", EVERY, ids=lambda each: each.name)
@pytest.mark.parametrize("where", GROUND)
def test_forces_and_moments_of_the_wheels_balance_the_weight(chassis: Chassis, where: str) -> None:
    plane, surface = GROUND[where]
    for each in driven(chassis, (plane, surface), 0.2)[5::7]:
        flat = Attitude.flat(chassis, each.position)
        _, stance = solve_stance(chassis, surface, each.position, each.heading, flat)
        rows = torch.einsum(
            "bhwf,bwf->bh", chassis.balance_matrix(each.steering, stance), each.forces
        )[0, 3:]
        weight = -chassis.mass * float(each.gravity[0, 2])
        assert weight == pytest.approx(chassis.weight, rel=0.04)
        expected = [weight, *[0.0] * (len(rows) - 1)]
        assert rows.tolist() == pytest.approx(expected, abs=1e-7 * weight)


@pytest.mark.parametrize("chassis", EVERY, ids=lambda each: each.name)
def test_loads_have_no_jumps_where_wheels_go_over_bumps(chassis: Chassis) -> None:
    """Their largest change from step to step goes with the step."""
    largest = []
    for step in (0.1, 0.025):
        normal = loads(driven(chassis, GROUND["bumps"], step=step))
        settled = normal[round(0.5 / step) :]
        assert float(settled.amax() - settled.amin()) > 0.3 * float(settled.mean()), "bumps load"
        largest.append(float((settled[1:] - settled[:-1]).abs().max()))
    assert largest[1] < 0.35 * largest[0]


@pytest.mark.parametrize("chassis", EVERY, ids=lambda each: each.name)
def test_in_the_mirror_left_and_right_change_places(chassis: Chassis) -> None:
    waves = ACROSS
    mirrored = dataclasses.replace(waves, wave=waves.wave * torch.tensor([1.0, -1.0]))
    half = chassis.wheels // 2
    one = loads(driven(chassis, (Plane(0.05, 0.1), waves), 0.3))
    other = loads(driven(chassis, (Plane(0.05, -0.1), mirrored), -0.3))
    swapped = torch.cat([other[:, half:], other[:, :half]], 1)
    assert (one - other).abs().max() > 0.1 * one.mean()
    torch.testing.assert_close(one, swapped, rtol=0.0, atol=1e-7 * chassis.weight)


def test_wheels_of_a_rigid_body_sink_to_one_plane_on_flat_ground() -> None:
    """The stiffness of the ground alone shares the loads: the middle wheels bear as the others."""
    for chassis in (SIX, EIGHT):
        lean = dataclasses.replace(chassis, centre=(0.1, 0.0, 0.25))
        depth = driven(lean, GROUND["flat"])[-1].depth[0]
        modes = lean.modes()
        plane = modes @ torch.linalg.pinv(modes) @ depth
        torch.testing.assert_close(depth, plane, rtol=0.0, atol=1e-10)
        assert depth[0] > depth[1] > depth[2], "the front bears more"


def test_fixed_rockers_do_not_turn_against_each_other() -> None:
    angles, hubs = [], []
    for chassis in (FIXED, BORNE):
        start = torch.tensor([[0.3, 0.1]], dtype=torch.float64)
        heading = torch.zeros(1, dtype=torch.float64)
        flat = Attitude.flat(chassis, start)
        attitude, stance = solve_stance(chassis, ACROSS, start, heading, flat)
        left, right = stance.hub[0, 0], stance.hub[0, 3]  # of the front wheels, on the rockers
        hubs.append(float((left - right)[2].abs()))
        angles.append(attitude.joints[0, :2])
        assert float((attitude.joints[0, 0] - attitude.joints[0, 1]).abs()) > 0.01
    assert hubs[0] < 1e-15
    assert hubs[1] > 0.01
    assert (angles[0] - angles[1]).abs().max() > 1e-3


def test_without_a_differential_a_cross_bump_loads_the_wheels_otherwise() -> None:
    fixed, borne = (driven(each, (Plane(), ACROSS)) for each in (FIXED, BORNE))
    apart = (loads(fixed) - loads(borne)).abs().max()
    assert apart > 0.2 * FIXED.weight / 6
    spread = [float(loads(each).std(1).mean()) for each in (fixed, borne)]
    assert spread[0] > 1.5 * spread[1], "a differential evens the loads"


def test_straight_on_flat_ground_the_differential_does_nothing() -> None:
    fixed, borne = (driven(each, GROUND["flat"]) for each in (FIXED, BORNE))
    for one, other in zip(fixed, borne, strict=True):
        torch.testing.assert_close(one.forces, other.forces, rtol=0.0, atol=1e-9 * FIXED.weight)
        torch.testing.assert_close(one.velocity, other.velocity, rtol=0.0, atol=1e-9)
        torch.testing.assert_close(one.depth, other.depth, rtol=0.0, atol=1e-9)
