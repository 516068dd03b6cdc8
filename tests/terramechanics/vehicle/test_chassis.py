# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Balances of a rover with any number of wheels: against vectors, and what it refuses."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rover_parameters.records import ConfigError
from terramechanics.presets import load_rover
from terramechanics.vehicle.chassis import Chassis, PassiveJoint
from terramechanics.vehicle.suspension import balance_matrix, level_pose
from terramechanics.vehicle.wheel_places import chassis_places

ROVER = load_rover("mars_rover")
SIX = Chassis.of(ROVER, track=1.0, yaw_inertia=40.0)
Vector = NDArray[np.float64]


def test_balances_are_the_forces_and_moments_of_vectors_in_space() -> None:
    """With every wheel steered to another angle."""
    generator = np.random.default_rng(2)
    steering = generator.uniform(-2.0, 2.0, 6)
    forces = generator.normal(size=(6, 4))
    found = torch.einsum(
        "hwf,wf->h", SIX.balance_matrix(torch.tensor(steering)), torch.tensor(forces)
    ).numpy()
    centre, across = np.array(SIX.centre), np.array([0.0, -1.0, 0.0])  # nose-up is about -y
    force, moment, joints = np.zeros(3), np.zeros(3), np.zeros(3)
    for wheel, (normal, traction, torque, lateral) in enumerate(forces):
        heading = np.array([math.cos(steering[wheel]), math.sin(steering[wheel]), 0.0])
        left = np.array([-heading[1], heading[0], 0.0])
        axle = np.array([SIX.wheel_x[wheel], SIX.wheel_y[wheel], SIX.wheel_radius])
        ground = axle * [1.0, 1.0, 0.0]
        at_axle, at_ground = np.array([0.0, 0.0, normal]) + traction * heading, lateral * left

        def about(point: Vector) -> Vector:
            return np.asarray(
                np.cross(axle - point, at_axle)  # noqa: B023 - used in this turn alone
                + np.cross(ground - point, at_ground)  # noqa: B023
                - torque * left  # noqa: B023
            )

        force, moment = force + at_axle + at_ground, moment + about(centre)
        for index, joint in enumerate(SIX.joints):
            pivot = np.array([joint.pivot_x, 0.0, joint.pivot_height])
            joints[index] += joint.turns[wheel] * about(pivot) @ across
    expected = [force[0], force[1], moment[2], force[2], moment @ across, moment[0], *joints]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_velocity_of_hubs_does_the_work_of_their_forces() -> None:
    generator = torch.Generator().manual_seed(1)
    steering, velocity, forces = (
        torch.rand(shape, generator=generator, dtype=torch.float64) for shape in (6, 3, (6, 4))
    )
    hubs = torch.einsum("waf,f->wa", SIX.motion_matrix(steering), velocity)
    power = (hubs * forces[:, [1, 3]]).sum()
    sums = torch.einsum("hwf,wf->h", SIX.balance_matrix(steering), forces)[:3]
    assert float(power) == pytest.approx(float(sums @ velocity), rel=1e-12)


def test_balances_of_both_sides_are_those_of_the_planar_rover() -> None:
    planar = balance_matrix(ROVER, level_pose(ROVER, torch.zeros(1, dtype=torch.float64)))[0]
    body = SIX.balance_matrix(torch.zeros(6, dtype=torch.float64))[..., :3]
    both = body[:, :3] + body[:, 3:]
    for row, same in ((0, both[0]), (1, both[3]), (2, both[4]), (3, both[6] + both[7])):
        torch.testing.assert_close(same, planar[row], rtol=0.0, atol=1e-14)
    assert both[[1, 2, 5, 8]].abs().max() < 1e-14


def test_closure_leaves_what_joints_leave_undetermined() -> None:
    assert SIX.closure().shape == (0, 6)
    four = dataclasses.replace(
        SIX, joints=(), wheel_x=(0.3, 0.3, -0.3, -0.3), wheel_y=(0.2, -0.2, 0.2, -0.2)
    )
    twisted = four.closure()[0]
    np.testing.assert_allclose(twisted.abs().numpy(), 0.5)
    assert float(twisted @ torch.tensor([1.0, -1.0, -1.0, 1.0], dtype=torch.float64)) ** 2 > 3.9
    assert (four.closure() @ four.modes()).abs().max() < 1e-14


def test_wheels_beside_each_other_are_rows_from_front_to_rear() -> None:
    twins = tuple(
        dataclasses.replace(wheel, name=f"{wheel.name}_{twin}")
        for wheel in ROVER.wheels
        for twin in (1, 2)
    )
    rover = dataclasses.replace(ROVER, wheels=twins)
    twelve = Chassis.of(rover, track=1.0, yaw_inertia=40.0)
    places = chassis_places(rover)
    assert sorted(places) == list(range(12))
    further_in = 0.5 - 1.2 * rover.wheel_width
    for place, wheel, y in zip(
        places, twins, (0.5, further_in, -0.5, -further_in) * 3, strict=True
    ):
        assert twelve.wheel_x[place] == rover.axle_x[wheel.axle]
        assert twelve.wheel_y[place] == pytest.approx(y)
        turns = [joint.turns[place] for joint in twelve.joints]
        left, on_bogie = y > 0.0, float(wheel.axle > 0)
        expected = [on_bogie, 0.0, 1.0] if left else [0.0, on_bogie, -1.0]
        assert turns == expected
    assert twelve.closure().shape == (6, 12)
    three = dataclasses.replace(rover, wheels=tuple(each for k, each in enumerate(twins) if k % 4))
    with pytest.raises(
        ConfigError, match="every axle needs as many wheels left as right, got left"
    ):
        Chassis.of(three, track=1.0, yaw_inertia=40.0)


def test_rovers_that_fall_over_are_refused() -> None:
    line: dict[str, Any] = {"joints": (), "wheel_x": (1.0, 0.0, -1.0), "wheel_y": (0.0, 0.0, 0.0)}
    with pytest.raises(ConfigError, match="3 wheels cannot bear a body with 0 joints"):
        dataclasses.replace(SIX, **line)
    joint = PassiveJoint(0.1, 0.2, (1.0, 1.0, -1.0, -1.0))
    four: dict[str, Any] = {"wheel_x": (1.0, 1.0, -1.0, -1.0), "wheel_y": (1.0, -1.0) * 2}
    with pytest.raises(ConfigError, match="4 wheels cannot bear a body with 2 joints"):
        dataclasses.replace(SIX, joints=(joint, joint), **four)
    with pytest.raises(ConfigError, match="wheel_y has 2 values, wheel_x has 6"):
        dataclasses.replace(SIX, wheel_y=(1.0, -1.0))
    with pytest.raises(ConfigError, match="turns: 2 values for 6 wheels"):
        dataclasses.replace(SIX, joints=(PassiveJoint(0.0, 0.0, (1.0, 1.0)),))
    with pytest.raises(ConfigError, match="compliance is -1 m/N"):
        dataclasses.replace(SIX, compliance=-1.0)
