# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How a body stands on uneven ground: against the planar pose, and by virtual work."""

import math

import pytest
import torch
from torch import Tensor

from terramechanics.presets import load_rover
from terramechanics.terrain.profile import Hills
from terramechanics.terrain.surface import Waves, random_waves
from terramechanics.vehicle.chassis import Chassis, Stance
from terramechanics.vehicle.stance import Attitude, rotation, solve_stance, turned
from terramechanics.vehicle.suspension import TerrainError, level_pose, solve_pose
from terramechanics.vehicle.wheel_balances import bank_balances, geometry_by_wheel
from terramechanics.vehicle.wheel_places import chassis_places, wheel_order

ROVERS = ("four_wheel_rover", "mars_rover")


def chassis_of(name: str) -> Chassis:
    return Chassis.of(load_rover(name), track=0.8, yaw_inertia=5.0)


def drawn(*shape: int, largest: float = 1.0) -> Tensor:
    generator = torch.Generator().manual_seed(6)
    return largest * (2.0 * torch.rand(*shape, generator=generator, dtype=torch.float64) - 1.0)


def on_waves(name: str, steepest: float) -> tuple[Chassis, Attitude, Stance, Tensor]:
    """Return attitude, stance and heading of eight rovers on ground of their own."""
    chassis, batch = chassis_of(name), 8
    ground = random_waves(batch, steepest, torch.Generator().manual_seed(5))
    heading, position = drawn(batch, largest=3.0), torch.zeros(batch, 2, dtype=torch.float64)
    start = Attitude.flat(chassis, position)
    return chassis, *solve_stance(chassis, ground, position, heading, start), heading


def test_on_waves_across_the_way_it_is_the_planar_pose() -> None:
    """The place of the planar one is its origin, that of the other its centre of mass."""
    rover, chassis = load_rover("mars_rover"), chassis_of("mars_rover")
    slope, number, phase = (
        torch.tensor([values], dtype=torch.float64)
        for values in ((0.05, 0.04), (2.5, 1.1), (0.3, 1.2))
    )
    zero = torch.zeros(1, dtype=torch.float64)
    profile = Hills(zero.unsqueeze(-1), slope, number, phase)
    planar = solve_pose(rover, profile, zero, level_pose(rover, zero))
    foot = rover.centre_of_mass_x
    ahead = torch.cat([foot * torch.cos(planar.pitch), zero]).unsqueeze(0)
    waves = Waves(slope, torch.stack([number, 0.0 * number], -1), phase)
    attitude, stance = solve_stance(chassis, waves, ahead, zero, Attitude.flat(chassis, ahead))
    left, right, differential = attitude.joints[0].tolist()
    assert float(attitude.pitch) == pytest.approx(float(planar.pitch), abs=1e-9)
    assert left == pytest.approx(float(planar.bogie_angle), abs=1e-9)
    assert right == pytest.approx(left, abs=1e-12)
    assert [differential, float(attitude.roll)] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert abs(left) > 0.01
    straight = torch.zeros(1, 6, dtype=torch.float64)
    found = stance.contact_angle(straight)
    torch.testing.assert_close(found, planar.contact_angle.repeat(1, 2), rtol=0.0, atol=1e-9)
    torch.testing.assert_close(
        stance.hub[..., ::2], planar.axle.repeat(1, 2, 1), rtol=0.0, atol=1e-9
    )


@pytest.mark.parametrize("name", ROVERS)
def test_every_wheel_touches_the_ground_or_the_gaps_are_least(name: str) -> None:
    chassis, attitude, stance, heading = on_waves(name, math.radians(8.0))
    assert (stance.gap @ chassis.modes()).abs().max() < 2e-4
    largest = float(stance.gap.abs().max())
    assert (largest < 1e-10) if chassis.joints else (1e-4 < largest < 0.02)
    # the ground leans both ways below the wheels, and normals are those of the ground
    assert (stance.normal.norm(dim=-1) - 1.0).abs().max() < 1e-12
    steep = (attitude.rotation(heading) @ stance.normal.mT)[:, 2]
    assert bool((steep >= math.cos(math.radians(8.0))).all())
    assert float(stance.normal[..., 1].abs().max()) > 0.01


@pytest.mark.parametrize("name", ROVERS)
def test_balances_are_the_virtual_work_of_each_way_to_move(name: str) -> None:
    """Forces of wheels on uneven ground, wheels steered: work of small moves against the rows."""
    chassis, attitude, stance, _ = on_waves(name, math.radians(8.0))
    batch, wheels, joints = len(stance.hub), chassis.wheels, len(chassis.joints)
    steering, forces = drawn(batch, wheels, largest=0.8), drawn(batch, wheels, 4)
    ahead, left, up, axle = stance.axes(steering)
    normal, traction, moment, lateral = forces.unsqueeze(-1).unbind(-2)
    at_hub, beside = normal * up + traction * ahead, lateral * left
    centre = torch.tensor(chassis.centre, dtype=torch.float64)
    # Of rotations about x and z, and about y against nose-up, and of the three shifts.
    zero = torch.zeros(3, dtype=torch.float64)
    axes = torch.eye(3, dtype=torch.float64)
    ways = [(axes[0], zero), (axes[1], zero), (zero, axes[2]), (axes[2], zero)]
    ways += [(zero, -axes[1]), (zero, axes[0])]
    contact = stance.hub - chassis.wheel_radius * up
    work = [
        (at_hub * (shift + torch.linalg.cross(turn.expand_as(up), stance.hub - centre))).sum(-1)
        + (beside * (shift + torch.linalg.cross(turn.expand_as(up), contact - centre))).sum(-1)
        - moment.squeeze(-1) * (axle * turn).sum(-1)
        for shift, turn in ways
    ]
    small = 1e-6
    for joint in range(joints):
        step = torch.zeros(batch, joints, dtype=torch.float64)
        step[:, joint] = small
        moved = [turned(chassis, attitude.joints + sign * step)[0] for sign in (1.0, -1.0)]
        by_hub = (moved[0] - moved[1]) / (2.0 * small)
        turns = torch.tensor(chassis.joints[joint].turns, dtype=torch.float64).unsqueeze(-1)
        about = turns * -axes[1]  # a joint turns its wheels nose-up
        arm = torch.linalg.cross(about.expand_as(up), -chassis.wheel_radius * up)
        work.append(
            (at_hub * by_hub).sum(-1)
            + (beside * (by_hub + arm)).sum(-1)
            - moment.squeeze(-1) * (axle * about).sum(-1)
        )
    rows = torch.einsum("bhwf,bwf->bh", chassis.balance_matrix(steering, stance), forces)
    torch.testing.assert_close(rows, torch.stack(work).sum(-1).T, rtol=0.0, atol=1e-7)


def test_hubs_move_along_the_ground_below_them() -> None:
    """Their motion is what a body would give them that rises with each; N does no work."""
    chassis, _, stance, _ = on_waves("mars_rover", math.radians(8.0))
    steering, velocity = drawn(8, 6, largest=0.8), drawn(8, 3)
    found = torch.einsum("bwaf,bf->bwa", chassis.motion_matrix(steering, stance), velocity)
    ahead, left, up, _ = stance.axes(steering)
    arm = stance.hub - torch.tensor(chassis.centre, dtype=torch.float64)
    turn = velocity[:, None, 2]
    level = torch.stack([velocity[:, None, 0] - turn * arm[..., 1],
                         velocity[:, None, 1] + turn * arm[..., 0]], -1)  # fmt: skip
    rise = -(level * up[..., :2]).sum(-1) / up[..., 2]
    hub = torch.cat([level, rise.unsqueeze(-1)], -1)
    torch.testing.assert_close(found[..., 0], (hub * ahead).sum(-1), rtol=0.0, atol=1e-12)
    torch.testing.assert_close(found[..., 1], (hub * left).sum(-1), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ROVERS)
def test_the_estimators_bank_is_the_leaning_of_the_chassis(name: str) -> None:
    rover, chassis, small = load_rover(name), chassis_of(name), 1e-6
    geometry, side = geometry_by_wheel(rover, 0.8)
    steering = drawn(len(side), largest=0.9)
    in_chassis = chassis_places(rover)
    places = [in_chassis[k] for k in wheel_order(rover)]
    back = torch.argsort(torch.tensor(places))
    level = chassis.level_stance()
    left = torch.stack([-torch.sin(steering), torch.cos(steering)], -1)[back]

    def at(bank: float) -> Tensor:
        leaning = torch.cat(
            [-math.sin(bank) * left, torch.full_like(left[:, :1], math.cos(bank))], -1
        )
        stance = Stance(level.hub, leaning, level.gap, level.pivots)
        return chassis.balance_matrix(steering[back], stance)[:, places]

    known = (at(small) - at(-small)) / (2.0 * small)
    none = torch.zeros(len(rover.suspension), dtype=torch.float64)
    found = bank_balances(geometry, side, steering, none)
    torch.testing.assert_close(found[:6], known[:6], rtol=0.0, atol=1e-8)
    if rover.suspension:  # left and right bogie together
        torch.testing.assert_close(found[6], known[6] + known[7], rtol=0.0, atol=1e-8)


def test_a_rotation_turns_left_then_lifts_the_nose_then_the_left_side() -> None:
    angles = [torch.tensor([each], dtype=torch.float64) for each in (0.3, 0.2, 0.1)]
    axes = rotation(*angles)[0]
    torch.testing.assert_close(axes @ axes.T, torch.eye(3, dtype=torch.float64))
    assert float(torch.linalg.det(axes)) == pytest.approx(1.0)
    assert math.atan2(float(axes[1, 0]), float(axes[0, 0])) == pytest.approx(0.3)
    assert math.asin(float(axes[2, 0])) == pytest.approx(0.2)
    assert float(axes[2, 1]) == pytest.approx(math.sin(0.1) * math.cos(0.2))


def test_ground_that_is_curved_too_sharply_is_refused() -> None:
    chassis, zero = chassis_of("mars_rover"), torch.zeros(1, 2, dtype=torch.float64)
    sharp = random_waves(1, 1.2, torch.Generator().manual_seed(1), (0.05, 0.1))
    with pytest.raises(TerrainError, match="mars_rover finds no stance: the ground is curved"):
        solve_stance(chassis, sharp, zero, zero[:, 0], Attitude.flat(chassis, zero))
