# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Balances of single wheels: against the chassis that turns, and against the planar rover."""

import dataclasses

import pytest
import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from terramechanics.presets import load_rover
from terramechanics.vehicle.chassis import Chassis, Stance
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.stance import turned
from terramechanics.vehicle.suspension import axle_places, balances, directions, geometry_of
from terramechanics.vehicle.wheel_balances import (
    geometry_by_wheel,
    motion_across,
    wheel_balances,
)
from terramechanics.vehicle.wheel_places import (
    WheelPlaces,
    box_inertia,
    chassis_places,
    wheel_order,
)

ROVERS = ("four_wheel_rover", "mars_rover")
TRACK = 0.8


def drawn(*shape: int, largest: float) -> Tensor:
    generator = torch.Generator().manual_seed(4)
    return largest * (2.0 * torch.rand(*shape, generator=generator, dtype=torch.float64) - 1.0)


def joints_of(rover: Rover, batch: int, angle: float) -> Tensor:
    return torch.full((batch, len(rover.suspension)), angle, dtype=torch.float64)


@pytest.mark.parametrize("name", ROVERS)
def test_on_a_plane_they_are_those_of_the_chassis_that_turns(name: str) -> None:
    rover = load_rover(name)
    geometry, side = geometry_by_wheel(rover, TRACK)
    steering = drawn(5, len(side), largest=0.9)
    level = torch.zeros_like(steering)
    found = wheel_balances(geometry, side, steering, level, joints_of(rover, 5, 0.0))[:, 0]
    in_chassis = chassis_places(rover)
    places = [in_chassis[k] for k in wheel_order(rover)]
    back = torch.argsort(torch.tensor(places))
    known = Chassis.of(rover, TRACK, 3.0).balance_matrix(steering[:, back])[:, :, places]
    torch.testing.assert_close(found[:, :6], known[:, :6], rtol=0.0, atol=1e-9)
    if rover.suspension:  # left and right bogie together
        torch.testing.assert_close(found[:, 6], known[:, 6] + known[:, 7], rtol=0.0, atol=1e-9)


def test_with_turned_bogies_they_are_those_of_the_chassis_on_that_stance() -> None:
    rover = load_rover("mars_rover")
    geometry, side = geometry_by_wheel(rover, TRACK)
    steering, chassis = drawn(5, len(side), largest=0.9), Chassis.of(rover, TRACK, 3.0)
    angles = torch.tensor([[0.1, 0.1, 0.0]], dtype=torch.float64).expand(5, -1)  # left, right
    hub, pivots = turned(chassis, angles)
    level = chassis.level_stance()
    stance = Stance(hub, level.normal.expand_as(hub), level.gap, pivots)
    in_chassis = chassis_places(rover)
    places = [in_chassis[k] for k in wheel_order(rover)]
    back = torch.argsort(torch.tensor(places))
    known = chassis.balance_matrix(steering[:, back], stance)[:, :, places]
    none = torch.zeros_like(steering)
    found = wheel_balances(geometry, side, steering, none, joints_of(rover, 5, 0.1))[:, 0]
    torch.testing.assert_close(found[:, :6], known[:, :6], rtol=0.0, atol=1e-9)
    torch.testing.assert_close(found[:, 6], known[:, 6] + known[:, 7], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", ROVERS)
def test_wheels_that_drive_straight_on_balance_as_their_axles(name: str) -> None:
    rover = load_rover(name)
    geometry, side = geometry_by_wheel(rover, TRACK)
    angles, joints = drawn(5, rover.axles, largest=0.3), joints_of(rover, 5, 0.1)
    of_wheels = [rover.wheels[k].axle for k in wheel_order(rover)]
    steering = torch.zeros(5, len(side), dtype=torch.float64)
    found = wheel_balances(geometry, side, steering, angles[:, of_wheels], joints)[:, 0]
    planar = geometry_of(rover)
    known = balances(planar, axle_places(planar, joints), directions(angles))[..., of_wheels, :]
    rows = [0, 3, 4, *range(6, found.shape[1])]  # along, up, nose up, joints
    torch.testing.assert_close(found[:, rows, :, :3], known, rtol=0.0, atol=1e-12)


def test_the_second_is_the_change_with_the_contact_angle() -> None:
    rover = load_rover("mars_rover")
    geometry, side = geometry_by_wheel(rover, TRACK)
    steering, angles = drawn(5, len(side), largest=0.9), drawn(5, len(side), largest=0.3)
    joints, small = joints_of(rover, 5, 0.1), 1e-6

    def at(moved: float) -> Tensor:
        return wheel_balances(geometry, side, steering, angles + moved, joints)

    found = (at(small)[:, 0] - at(-small)[:, 0]) / (2.0 * small)
    torch.testing.assert_close(at(0.0)[:, 1], found, rtol=0.0, atol=1e-8)


def test_motion_across_is_that_of_the_hub_in_the_frame_of_its_heading() -> None:
    velocity, rim, steering = (
        drawn(3, 7, 2, largest=0.3),
        drawn(3, 7, largest=0.2),
        drawn(3, 7, largest=0.9),
    )
    ahead, left = velocity.unbind(-1)
    along = torch.cos(steering) * ahead + torch.sin(steering) * left
    across = torch.cos(steering) * left - torch.sin(steering) * ahead
    found = motion_across(1.0 - along / rim, rim, steering, left)
    for one, known in zip(found, (rim, along, across), strict=True):
        torch.testing.assert_close(one * rim.abs(), known, rtol=0.0, atol=1e-12)


def test_wheels_are_ordered_front_to_rear_and_left_before_right() -> None:
    rover = load_rover("four_wheel_rover")
    mixed = dataclasses.replace(rover, wheels=tuple(reversed(rover.wheels)))
    names = [mixed.wheel_names[k] for k in wheel_order(mixed)]
    assert names == ["front_left", "front_right", "rear_left", "rear_right"]
    geometry, side = geometry_by_wheel(mixed, TRACK)
    assert side.tolist() == [0.4, -0.4, 0.4, -0.4]
    assert geometry.axle_x.tolist() == [rover.axle_x[k] for k in (0, 0, 1, 1)]


def test_places_that_do_not_fit_the_rover_are_refused_by_name() -> None:
    rover = load_rover("four_wheel_rover")
    assert WheelPlaces.of(rover, 0.5).yaw_inertia == box_inertia(rover, 0.5)
    with pytest.raises(ConfigError, match="steered: middle_left: four_wheel_rover has the wheels"):
        WheelPlaces.of(rover, 0.5, ("middle_left",))
    with pytest.raises(ConfigError, match=r"track_width 0\.1 m has no room for wheels of 0\.12 m"):
        WheelPlaces.of(rover, 0.1)
    one_sided = tuple(dataclasses.replace(each, side="left") for each in rover.wheels)
    with pytest.raises(ConfigError, match="axle 0 of four_wheel_rover has the sides left, left"):
        WheelPlaces.of(dataclasses.replace(rover, wheels=one_sided), 0.5)
