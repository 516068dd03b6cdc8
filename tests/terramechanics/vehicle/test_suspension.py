# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The rocker-bogie suspension against independent solvers in other unknowns and frames."""

import math

import numpy as np
import pytest
import torch
from scipy import optimize

from terramechanics.presets import load_rover
from terramechanics.terrain.profile import Flat, Profile, Ramp, StepProfile, random_hills
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import (
    BodyLoad,
    Pose,
    TerrainError,
    balance_matrix,
    balance_target,
    level_pose,
    solve_pose,
    wheel_loads,
)

ROVERS = [load_rover("mars_rover"), load_rover("paper_rover")]
PLACES = torch.linspace(0.3, 9.7, 24, dtype=torch.float64)


def profiles() -> list[Profile]:
    hills = random_hills(24, torch.ones(24, dtype=torch.float64), torch.Generator().manual_seed(5))
    return [
        Flat(),
        Ramp(0.15, start=2.0, blend=2.5),
        StepProfile(0.08, start=3.0, length=2.5),
        hills,
    ]


def posed(rover: Rover, profile: Profile, x: torch.Tensor = PLACES) -> Pose:
    return solve_pose(rover, profile, x, level_pose(rover, x))


def test_on_level_ground_the_rover_is_level() -> None:
    for rover in ROVERS:
        pose = posed(rover, Flat())
        assert float(pose.pitch.abs().max()) < 1e-14
        assert float(pose.bogie_angle.abs().max()) < 1e-14
        assert float(pose.contact_angle.abs().max()) < 1e-14
        torch.testing.assert_close(
            pose.contact - PLACES.unsqueeze(-1),
            torch.tensor(rover.axle_x, dtype=torch.float64).expand(24, 3),
        )


def test_on_a_long_ramp_the_body_has_the_slope_of_the_ramp() -> None:
    pose = posed(ROVERS[0], Ramp(0.2, start=0.0), PLACES + 20.0)
    torch.testing.assert_close(pose.pitch, torch.full_like(PLACES, 0.2))
    assert float(pose.contact_angle.abs().max()) < 1e-12


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
@pytest.mark.parametrize("kind", range(4), ids=["flat", "ramp", "step", "hills"])
def test_every_wheel_touches_the_ground_and_does_not_cut_it(rover: Rover, kind: int) -> None:
    """Check that each axle is a radius from the profile, and that links keep their lengths."""
    profile = profiles()[kind]
    pose = posed(rover, profile)
    track = torch.linspace(-3.0, 13.0, 64001, dtype=torch.float64).expand(24, -1)
    ground = profile.shape(track)[0].numpy()
    for episode in range(24):
        turn = rotation(float(pose.pitch[episode]))
        origin = np.array([float(PLACES[episode]), float(pose.height[episode])])
        axles = pose.axle[episode].numpy() @ turn.T + origin
        for axle in axles:
            distance = np.hypot(track[episode].numpy() - axle[0], ground[episode] - axle[1])
            assert distance.min() == pytest.approx(rover.wheel_radius, abs=1e-7)
        pivot = turn @ np.array([rover.bogie_pivot_x, rover.bogie_pivot_height]) + origin
        for k, x in enumerate(rover.axle_x):
            joint = pivot if k > 0 else origin
            arm = (
                (x - rover.bogie_pivot_x, rover.wheel_radius - rover.bogie_pivot_height)
                if k > 0
                else (x, rover.wheel_radius)
            )
            assert np.hypot(*(axles[k] - joint)) == pytest.approx(math.hypot(*arm), abs=1e-12)


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_the_pose_is_that_of_a_general_root_finder(rover: Rover) -> None:
    """Solve for body height, pitch, absolute bogie angle and three contacts.

    The equations are axle = contact + r normal.
    """
    profile = profiles()[3]
    pose = posed(rover, profile)

    def equations(u: np.ndarray, episode: int) -> np.ndarray:
        height, pitch, bogie = u[:3]
        origin = np.array([float(PLACES[episode]), height])
        pivot = origin + rotation(pitch) @ [rover.bogie_pivot_x, rover.bogie_pivot_height]
        axles = [origin + rotation(pitch) @ [rover.axle_x[0], rover.wheel_radius]]
        drop = rover.wheel_radius - rover.bogie_pivot_height
        axles += [
            pivot + rotation(bogie) @ [x - rover.bogie_pivot_x, drop] for x in rover.axle_x[1:]
        ]
        shape = profile.shape(torch.tensor(u[3:]).expand(24, 3))
        h, slope = shape[0][episode].numpy(), shape[1][episode].numpy()
        length = np.sqrt(1.0 + slope**2)
        touch = np.stack(
            [u[3:] - rover.wheel_radius * slope / length, h + rover.wheel_radius / length], axis=-1
        )
        return (np.array(axles) - touch).ravel()

    for episode in range(24):
        start = np.array([0.0, 0.0, 0.0, *(float(PLACES[episode]) + np.array(rover.axle_x))])
        root = optimize.root(equations, start, args=(episode,), tol=1e-13)
        assert np.abs(root.fun).max() < 1e-10
        found = [
            pose.height[episode],
            pose.pitch[episode],
            pose.pitch[episode] + pose.bogie_angle[episode],
            *pose.contact[episode],
        ]
        assert root.x == pytest.approx([float(value) for value in found], abs=1e-9)


def test_a_profile_that_is_sharper_than_the_wheel_is_refused() -> None:
    with pytest.raises(TerrainError, match=r"curved too sharply for wheels of radius 0\.4 m"):
        posed(
            ROVERS[1],
            StepProfile(0.2, start=1.0, length=0.3),
            torch.linspace(0.0, 1.5, 30, dtype=torch.float64),
        )


def rotation(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def free_bodies(
    rover: Rover, pose: Pose, episode: int, traction: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """Return N of the axles and the acceleration, from free-body diagrams in the world frame.

    Bodies: three wheels (all wheels of an axle as one), bogie, rocker with all mass. Unknown: three
    N, the forces on the axles and on the pivot, the motors' torques and the acceleration: 3 + 6 + 2
    + 3 + 1 = 15 unknowns, 15 equations.
    """
    p, g = rover.wheels_per_axle, rover.gravity
    pitch = float(pose.pitch[episode])
    turn = rotation(pitch)
    axles = pose.axle[episode].numpy() @ turn.T
    pivot = turn @ [rover.bogie_pivot_x, rover.bogie_pivot_height]
    centre = turn @ [rover.centre_of_mass_x, rover.centre_of_mass_height]
    slope = pitch + pose.contact_angle[episode].numpy()
    matrix, right = np.zeros((15, 15)), np.zeros(15)
    normal, axle_force, pivot_force, motor, acceleration = (
        slice(0, 3),
        slice(3, 9),
        slice(9, 11),
        slice(11, 14),
        14,
    )
    for k in range(
        3
    ):  # wheel k: ground force + axle force = 0; motor torque = moment of the ground's shear
        rows = slice(3 * k, 3 * k + 2)
        matrix[rows, normal][:, k] = p * np.array([-math.sin(slope[k]), math.cos(slope[k])])
        matrix[rows, axle_force][:, 2 * k : 2 * k + 2] = np.eye(2)
        right[rows] = -p * traction[k] * np.array([math.cos(slope[k]), math.sin(slope[k])])
        matrix[3 * k + 2, motor.start + k] = 1.0
        right[3 * k + 2] = p * torque[k]
    bodies = {9: (pivot, [1, 2], 1.0), 12: (centre, [0], -1.0)}
    for row, (point, carried, sign) in bodies.items():
        # The axles push back on the body; the pivot's force acts on the bogie and, reversed, on the
        # rocker.
        for k in carried:
            arm = axles[k] - point
            matrix[row : row + 2, axle_force][:, 2 * k : 2 * k + 2] -= np.eye(2)
            matrix[row + 2, axle_force][2 * k : 2 * k + 2] -= [-arm[1], arm[0]]
            matrix[row + 2, motor][k] += 1.0
        arm = pivot - point
        matrix[row : row + 2, pivot_force] += sign * np.eye(2)
        matrix[row + 2, pivot_force] += sign * np.array([-arm[1], arm[0]])
    matrix[12:14, acceleration] = -rover.mass * np.array([math.cos(pitch), math.sin(pitch)])
    right[12:14] += [0.0, rover.mass * g]
    solution, _, rank, _ = np.linalg.lstsq(matrix, right)
    assert rank == 15
    return np.array([*solution[normal], solution[acceleration]])


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_wheel_loads_are_those_of_free_body_diagrams_with_all_joint_forces(rover: Rover) -> None:
    pose = posed(rover, profiles()[3])
    generator = torch.Generator().manual_seed(2)
    share = rover.weight / 6.0
    traction = share * (torch.rand(24, 3, generator=generator, dtype=torch.float64) - 0.3)
    torque = (
        share * rover.wheel_radius * torch.rand(24, 3, generator=generator, dtype=torch.float64)
    )
    loads = wheel_loads(rover, pose, traction, torque)
    forces = torch.stack([loads, traction, torque], dim=-1)
    along = torch.einsum("...raf,...af->...r", balance_matrix(rover, pose), forces)[:, 0]
    acceleration = along / rover.mass - rover.gravity * torch.sin(pose.pitch)
    for episode in range(24):
        expected = free_bodies(
            rover, pose, episode, traction[episode].numpy(), torque[episode].numpy()
        )
        assert loads[episode].numpy() == pytest.approx(expected[:3], rel=1e-10, abs=1e-9 * share)
        assert float(acceleration[episode]) == pytest.approx(expected[3], abs=1e-10)


def test_loads_at_rest_on_level_ground_are_those_of_two_beams() -> None:
    """The pivot carries what its lever arm gives it, the bogie shares it by lever arms again."""
    for rover in ROVERS:
        pose = posed(rover, Flat())
        zero = torch.zeros(24, 3, dtype=torch.float64)
        front, middle, rear = rover.axle_x
        on_pivot = rover.weight * (front - rover.centre_of_mass_x) / (front - rover.bogie_pivot_x)
        on_rear = on_pivot * (middle - rover.bogie_pivot_x) / (middle - rear)
        expected = (
            np.array([rover.weight - on_pivot, on_pivot - on_rear, on_rear]) / rover.wheels_per_axle
        )
        assert wheel_loads(rover, pose, zero, zero)[0].numpy() == pytest.approx(expected, rel=1e-12)


def test_driving_torque_takes_load_off_the_front_wheels_and_a_climb_does_too() -> None:
    rover = ROVERS[0]
    flat, zero = posed(rover, Flat()), torch.zeros(24, 3, dtype=torch.float64)
    rest = wheel_loads(rover, flat, zero, zero)
    driven = wheel_loads(rover, flat, zero + 20.0, zero + 20.0 * rover.wheel_radius)
    assert bool((driven[:, 0] < rest[:, 0]).all())
    held = zero + rover.weight / 6.0 * math.sin(0.2)
    climbing = wheel_loads(
        rover, posed(rover, Ramp(0.2, start=0.0), PLACES + 20.0), held, held * rover.wheel_radius
    )
    assert bool((climbing[:, 0] < rest[:, 0] * math.cos(0.2)).all())


def test_the_target_of_the_balances_is_gravity_and_inertia() -> None:
    rover = ROVERS[0]
    target = balance_target(
        BodyLoad.of(rover),
        torch.tensor([0.1], dtype=torch.float64),
        torch.tensor([0.5], dtype=torch.float64),
    )
    weight = 185.0 * 3.72
    assert target[0].tolist() == pytest.approx(
        [185.0 * 0.5 + weight * math.sin(0.1), weight * math.cos(0.1), 0.0, 0.0]
    )
