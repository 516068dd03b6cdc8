# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rovers that turn: against the planar simulator, in the mirror, their energy, their turns."""

import dataclasses
import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from terramechanics.contact.rolling import WheelMotion, dissipated_power
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.schedules import Command
from terramechanics.simulation.simulation import Simulation
from terramechanics.simulation.spatial import BodySample, BodySimulation, Plane
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Hills
from terramechanics.terrain.surface import Waves, random_waves
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.steering import (
    ackermann_twist,
    partly_steered_command,
    skid_command,
    steered_command,
)

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
FOUR = Chassis(
    name="four",
    mass=60.0,
    yaw_inertia=6.0,
    gravity=9.81,
    wheel_radius=0.165,
    wheel_width=0.12,
    wheel_inertia=0.02,
    wheel_x=(0.3, 0.3, -0.3, -0.3),
    wheel_y=(0.28, -0.28, 0.28, -0.28),
    centre=(0.0, 0.0, 0.25),
)
SIX = Chassis.of(ROVER, track=1.0, yaw_inertia=40.0)
RIGHT = [1, 0, 3, 2]
"""The wheel on the other side, of each of FOUR."""
Sampled = list[BodySample]


def numbers(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def driven(
    chassis: Chassis,
    twists: Tensor,
    command: Callable[[Chassis, Tensor], tuple[Tensor, Tensor]],
    plane: Plane | None = None,
    soil: str = "loose_sand",
) -> Sampled:
    """Drive by twists [time, batch, 3]."""
    batch, ground = twists.shape[1], load_soil(soil)
    simulation = BodySimulation(
        chassis, ground.constants().expand(batch, 6), ground.strength().expand(batch, 2), plane
    )
    samples = [simulation.step(*command(chassis, twist)) for twist in twists]
    assert all(bool(sample.solved.all()) for sample in samples)
    return samples


def steady(times: int, *twists: tuple[float, float, float]) -> Tensor:
    return torch.tensor(twists, dtype=torch.float64).expand(times, -1, -1)


@pytest.mark.parametrize("slope", [0.0, 0.08, -0.08])
def test_straight_ahead_it_is_the_planar_simulator(slope: float) -> None:
    """Each step is the same implicit one, so that every sample agrees, not the steady state only.

    On flat ground and on plane slopes, with another rate of each axle and accelerations.
    """
    zero = torch.zeros(1, 1, dtype=torch.float64)
    profile = Hills(zero + slope, zero, zero + 1.0, zero)
    planar = Simulation(ROVER, Ground.constant(SOIL), profile, numbers(0.1))
    body = BodySimulation(SIX, SOIL.constants()[None], SOIL.strength()[None], Plane(slope_x=slope))
    rates = torch.tensor([[1.2, 1.3, 1.1]], dtype=torch.float64)
    straight = torch.zeros(1, 6, dtype=torch.float64)
    planar.settle(rates)
    body.settle(rates.repeat(1, 2) * ROVER.wheel_radius, straight, numbers(0.1, 0.0, 0.0)[None])
    weight = ROVER.weight
    for count in range(15):
        now = rates * (1.0 + 0.3 * math.sin(0.7 * count) * numbers(1.0, 0.5, -0.2))
        expected = planar.step(Command.RATE, now)
        found = body.step(now.repeat(1, 2) * ROVER.wheel_radius, straight)
        assert bool(found.solved.all())
        normal, traction, _, lateral = found.forces.unbind(-1)
        for one, other, unit in (
            (found.velocity[:, 0], expected.velocity, 1.0),
            (found.sinkage, expected.sinkage.repeat(1, 2), 1.0),
            (normal, expected.normal.repeat(1, 2), weight),
            (traction, expected.traction.repeat(1, 2), weight),
            (found.torque, expected.torque.repeat(1, 2), weight * ROVER.wheel_radius),
            (found.pitch, expected.pitch, 1.0),
            (found.slip, expected.slip.repeat(1, 2), 1.0),
        ):
            assert (one - other).abs().max() < 1e-9 * unit
        assert lateral.abs().max() < 1e-12 * weight
        assert found.velocity[:, 1:].abs().max() < 1e-12


def test_over_waves_along_the_way_it_is_the_planar_simulator() -> None:
    """To half a percent: here hubs move along the ground, in the planar one along the body."""
    slope, number, phase = (
        numbers(0.05, 0.035)[None],
        numbers(2.5, 1.0)[None],
        numbers(0.3, 1.2)[None],
    )
    planar = Simulation(
        ROVER, Ground.constant(SOIL), Hills(numbers(0.0)[None], slope, number, phase), numbers(0.1)
    )
    # the place of the planar one is that of its origin
    shifted = phase + number * ROVER.centre_of_mass_x
    waves = Waves(slope, torch.stack([number, 0.0 * number], -1), shifted)
    body = BodySimulation(SIX, SOIL.constants()[None], SOIL.strength()[None], surface=waves)
    rates, straight = torch.full((1, 3), 1.0, dtype=torch.float64), torch.zeros(1, 6)
    rim = rates.repeat(1, 2) * ROVER.wheel_radius
    planar.settle(rates)
    body.settle(rim, straight.double(), numbers(0.1, 0.0, 0.0)[None])
    leaned = []
    for _ in range(60):
        expected, found = planar.step(Command.RATE, rates), body.step(rim, straight.double())
        assert bool(found.solved.all())
        assert (found.velocity[:, 0] / expected.velocity - 1.0).abs().max() < 5e-3
        assert (found.pitch - expected.pitch).abs().max() < 2e-4
        assert (found.joints[:, 0] - expected.bogie_angle).abs().max() < 2e-4
        normal = found.forces[:, :3, 0]
        assert (normal - expected.normal).abs().max() < 2e-4 * ROVER.weight
        leaned.append(float(found.pitch))
    assert max(leaned) - min(leaned) > 0.05


def test_a_rigid_body_on_bumps_lifts_wheels_and_rests_on_the_others() -> None:
    """12 drives, turns and straight ones, on hard ground with bumps of 5 deg."""
    bumps = random_waves(12, math.radians(5.0), torch.Generator().manual_seed(1), (0.8, 3.0))
    soil = load_soil("compact_sand")
    body = BodySimulation(
        FOUR, soil.constants().expand(12, 6), soil.strength().expand(12, 2), surface=bumps
    )
    turns = 0.4 * (torch.arange(12) % 2).double()
    twist = torch.stack([torch.full_like(turns, 0.25), torch.zeros_like(turns), turns], -1)
    lifted = []
    for _ in range(40):
        sample = body.step(*skid_command(FOUR, twist))
        assert bool(sample.solved.all())
        normal, up = sample.forces[..., 0], sample.depth < 0.0
        lifted.append(up)
        assert bool((normal > -1e-12 * FOUR.weight).all())
        assert bool((normal[up] < 1e-5 * FOUR.weight).all())
        assert int((~up).sum(-1).min()) >= 3
        heavy = (normal.sum(-1) / FOUR.weight - 1.0).abs().max()
        assert float(heavy) < 0.02  # all of the weight, to the leaning of the ground
    assert bool(torch.stack(lifted).any())


def test_a_left_turn_is_the_mirror_image_of_a_right_one() -> None:
    twists = torch.stack([steady(5, (0.2, 0.05, 0.3)), steady(5, (0.2, -0.05, -0.3))], 1)[:, :, 0]
    plane = Plane(0.05, numbers(0.1, -0.1))
    for command in (skid_command, steered_command):
        last = driven(FOUR, twists, command, plane)[-1]
        turn = numbers(1.0, -1.0, -1.0)
        torch.testing.assert_close(last.velocity[1], last.velocity[0] * turn, rtol=0.0, atol=1e-9)
        force = numbers(1.0, 1.0, 1.0, -1.0)
        mirrored = last.forces[1, RIGHT] * force
        torch.testing.assert_close(mirrored, last.forces[0], rtol=0.0, atol=1e-6)
        torch.testing.assert_close(last.sinkage[1, RIGHT], last.sinkage[0], rtol=1e-8, atol=0.0)
        assert float(last.velocity[0, 2]) > 0.0
        assert float(last.roll[0]) == pytest.approx(-float(last.roll[1]), abs=1e-9)


def manoeuvres() -> Tensor:
    """Twists [time, batch, 3] of drives that turn, back out, crab, turn on the spot and stop."""
    generator = torch.Generator().manual_seed(3)
    drawn = torch.rand(5, 16, 3, generator=generator, dtype=torch.float64) * 2.0 - 1.0
    drawn = drawn * numbers(0.3, 0.2, 0.6)
    drawn[2] = 0.0
    return drawn.repeat_interleave(2, 0)


@pytest.mark.parametrize(
    ("chassis", "command"),
    [
        (dataclasses.replace(FOUR, compliance=1e-4), skid_command),
        (SIX, steered_command),
    ],
)
def test_motors_pay_for_what_the_ground_takes_and_the_body_gains(
    chassis: Chassis, command: Callable[[Chassis, Tensor], tuple[Tensor, Tensor]]
) -> None:
    """16 random drives of five commands on random slopes, one of them to stop."""
    generator = torch.Generator().manual_seed(4)
    slopes = (torch.rand(2, 16, generator=generator, dtype=torch.float64) - 0.5) * 0.3
    samples = driven(chassis, manoeuvres(), command, Plane(slopes[0], slopes[1]))
    inertia = numbers(chassis.mass, chassis.mass, chassis.yaw_inertia)
    before = torch.zeros(16, dtype=torch.float64)
    for sample in samples:
        motion = WheelMotion(sample.rim, sample.along, sample.across)
        taken = dissipated_power(motion, sample.forces, chassis.wheel_radius)
        assert bool((taken >= -1e-12 * chassis.weight).all())
        motors = (sample.forces[..., 2] * sample.rim).sum(-1) / chassis.wheel_radius
        climbed = -chassis.mass * (sample.gravity[:, :2] * sample.velocity[:, :2]).sum(-1)
        energy = 0.5 * (inertia * sample.velocity**2).sum(-1)
        # An implicit step loses half of m dv^2 besides, so that it never gains energy.
        left = motors - taken.sum(-1) - climbed - (energy - before) / 0.1
        assert bool((left >= -1e-7 * chassis.weight).all())
        before = energy
        weight = chassis.mass * sample.gravity[:, 2]
        torch.testing.assert_close(sample.forces[..., 0].sum(-1), -weight, rtol=1e-8, atol=0.0)


@pytest.mark.parametrize("chassis", [FOUR, SIX])
def test_a_point_turn_keeps_its_centre_on_flat_ground(chassis: Chassis) -> None:
    """Of a rover that is the same front and rear: the bogie of SIX is not."""
    last = driven(chassis, steady(15, (0.0, 0.0, 0.5)), steered_command)[-1]
    kept = float(last.position.norm())
    assert 0.3 < float(last.velocity[0, 2]) <= 0.5
    if chassis is FOUR:
        assert kept < 1e-9
    else:
        assert 1e-6 < kept < 0.05


@pytest.mark.parametrize("soil", ["loose_sand", "compact_sand", "regolith"])
def test_skid_steering_turns_more_slowly_than_wheels_that_roll(soil: str) -> None:
    """Measured in the steady state: 23 to 32 % of their yaw rate."""
    twists = steady(8, (0.2, 0.0, 0.3), (0.0, 0.0, 0.3))
    last = driven(FOUR, twists, skid_command, soil=soil)[-1]
    assert bool((last.velocity[:, 2] > 0.02).all())
    assert bool((last.velocity[:, 2] < 0.9 * 0.3).all())
    steered = driven(FOUR, twists, steered_command, soil=soil)[-1]
    assert bool((steered.velocity[:, 2] > 1.2 * last.velocity[:, 2]).all())


def test_a_crab_at_a_right_angle_goes_straight_to_the_left() -> None:
    last = driven(FOUR, steady(15, (0.0, 0.15, 0.0)), steered_command)[-1]
    assert 0.1 < float(last.velocity[0, 1]) <= 0.15
    assert last.velocity[0, [0, 2]].abs().max() < 1e-9
    assert float(last.sinkage[0, 1] - last.sinkage[0, 0]) > 1e-4  # it leans back to the right


def test_a_rover_that_backs_out_is_the_mirror_image_of_one_that_drives_in() -> None:
    last = driven(FOUR, steady(12, (0.2, 0.0, 0.0), (-0.2, 0.0, 0.0)), skid_command)[-1]
    assert float(last.velocity[1, 0]) == pytest.approx(-float(last.velocity[0, 0]), rel=1e-9)
    torch.testing.assert_close(last.sinkage[1, [2, 3, 0, 1]], last.sinkage[0], rtol=1e-8, atol=0.0)


@pytest.mark.parametrize("command", [skid_command, steered_command])
def test_after_a_stop_it_stands_on_a_slope(
    command: Callable[[Chassis, Tensor], tuple[Tensor, Tensor]],
) -> None:
    """It creeps by less than the slowest rim, 1 mm/s: measured 0.12 mm/s at 10 deg."""
    go, stop = steady(6, (0.2, 0.0, 0.3)), steady(6, (0.0, 0.0, 0.0))
    last = driven(FOUR, torch.cat([go, stop]), command, Plane(0.1, 0.15))[-1]
    assert last.velocity[:, :2].norm() < 2e-4
    downhill = (last.velocity[:, :2] * last.gravity[:, :2]).sum()
    assert float(downhill) > 0.0


def test_with_fixed_rear_wheels_the_rear_axle_rolls_on_its_heading() -> None:
    twist = ackermann_twist(FOUR, numbers(0.2), numbers(0.2))
    rim, steering = steered_command(FOUR, twist)
    assert steering[0, 2:].tolist() == [0.0, 0.0]
    assert 0.0 < float(steering[0, 1]) < float(steering[0, 0])  # the inner wheel turns in further
    assert bool((rim > 0.0).all())
    last = driven(FOUR, twist.expand(15, 1, 3), steered_command)[-1]
    assert 0.1 < float(last.velocity[0, 2]) < 0.2


def test_wheels_that_nothing_steers_stay_straight_and_the_others_roll_about_their_axle() -> None:
    speed, turn = numbers(0.2), numbers(0.2)
    none, front = torch.zeros(4, dtype=torch.bool), torch.tensor(FOUR.wheel_x) > 0.0
    twist = torch.stack([speed, torch.zeros_like(speed), turn], -1)
    for steered, (rims, angles) in (
        (none, skid_command(FOUR, twist)),
        (~none, steered_command(FOUR, twist)),
        (front, steered_command(FOUR, ackermann_twist(FOUR, speed, turn))),
    ):
        rim, angle = partly_steered_command(FOUR, speed, turn, steered)
        torch.testing.assert_close(rim, rims)
        torch.testing.assert_close(angle, angles)
    one = torch.tensor([True, False, False, False])
    assert int((partly_steered_command(FOUR, speed, turn, one)[1] != 0.0).sum()) == 1


def test_a_steady_turn_stays_as_it_is_settled() -> None:
    rim, steering = steered_command(FOUR, numbers(0.2, 0.0, 0.3)[None])
    simulation = BodySimulation(FOUR, SOIL.constants()[None], SOIL.strength()[None])
    settled = simulation.settle(rim, steering, numbers(0.15, 0.0, 0.2)[None])
    assert bool(settled.solved.all())
    assert float(settled.velocity[0, 2]) > 0.1
    for _ in range(12):
        simulation.step(rim, steering)
    sample = simulation.step(rim, steering)
    # The step turns the frame by a finite angle: an error of first order in its length.
    torch.testing.assert_close(sample.velocity, settled.velocity, rtol=0.0, atol=1e-4)
