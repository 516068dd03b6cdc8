# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Suspensions of every kind against independent solvers in other unknowns and frames."""

import math

import numpy as np
import pytest
import torch
from scipy import optimize

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
from tests.rovers import BOGIE_IN_FRONT, FOUR_WHEELS, KINDS, MARS, PAPER, UNEVEN, mirrored

ROVERS = KINDS
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
            torch.tensor(rover.axle_x, dtype=torch.float64).expand(24, rover.axles),
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
        for k, x in enumerate(rover.axle_x):
            pivot = pivot_of(rover, k)
            joint = turn @ pivot + origin
            arm = np.array([x, rover.wheel_radius]) - pivot
            assert np.hypot(*(axles[k] - joint)) == pytest.approx(math.hypot(*arm), abs=1e-12)


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_the_pose_is_that_of_a_general_root_finder(rover: Rover) -> None:
    """Solve for body height, pitch, absolute angles of the joints and all contacts.

    The equations are axle = contact + r normal.
    """
    profile = profiles()[3]
    pose = posed(rover, profile)
    first = 2 + len(rover.suspension)

    def equations(u: np.ndarray, episode: int) -> np.ndarray:
        (height, pitch), bogies, contacts = u[:2], u[2:first], u[first:]
        origin = np.array([float(PLACES[episode]), height])
        axles = []
        for k, x in enumerate(rover.axle_x):
            pivot, angle = pivot_of(rover, k), pitch
            for joint, bogie in zip(rover.suspension, bogies, strict=True):
                angle = bogie if k in joint.axles else angle
            arm = np.array([x, rover.wheel_radius]) - pivot
            axles.append(origin + rotation(pitch) @ pivot + rotation(angle) @ arm)
        shape = profile.shape(torch.tensor(contacts).expand(24, rover.axles))
        h, slope = shape[0][episode].numpy(), shape[1][episode].numpy()
        length = np.sqrt(1.0 + slope**2)
        touch = np.stack(
            [contacts - rover.wheel_radius * slope / length, h + rover.wheel_radius / length],
            axis=-1,
        )
        return (np.array(axles) - touch).ravel()

    for episode in range(24):
        start = np.array([0.0] * first + [float(PLACES[episode]) + x for x in rover.axle_x])
        root = optimize.root(equations, start, args=(episode,), tol=1e-13)
        assert np.abs(root.fun).max() < 1e-10
        found = [
            pose.height[episode],
            pose.pitch[episode],
            *(pose.pitch[episode] + pose.joint_angle[episode]),
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


def pivot_of(rover: Rover, axle: int) -> np.ndarray:
    """Return the point in the body frame about which an axle turns: of its joint, or the origin."""
    points = [(joint.x, joint.height) for joint in rover.suspension if axle in joint.axles]
    return np.array(points[0] if points else (0.0, 0.0))


def free_bodies(
    rover: Rover, pose: Pose, episode: int, traction: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """Return N of the axles and the acceleration, from free-body diagrams in the world frame.

    Bodies: A wheels (all wheels of an axle as one), J bogies, rocker with all mass. Unknown: A
    times N, the forces on the axles and on the pivots, the motors' torques and the acceleration:
    4 A + 2 J + 1 unknowns, 3 (A + J + 1) equations, as many where J = A - 2.
    """
    p, g, count = rover.wheels_per_axle, rover.gravity, rover.axles
    pitch = float(pose.pitch[episode])
    turn = rotation(pitch)
    axles = pose.axle[episode].numpy() @ turn.T
    centre = turn @ [rover.centre_of_mass_x, rover.centre_of_mass_height]
    slope = pitch + pose.contact_angle[episode].numpy()
    size = 3 * (count + len(rover.suspension) + 1)
    matrix, right = np.zeros((size, size)), np.zeros(size)
    normal, axle_force = slice(0, count), slice(count, 3 * count)
    motor, acceleration = slice(3 * count, 4 * count), size - 1
    for k in range(
        count
    ):  # wheel k: ground force + axle force = 0; motor torque = moment of the ground's shear
        rows = slice(3 * k, 3 * k + 2)
        matrix[rows, normal][:, k] = p * np.array([-math.sin(slope[k]), math.cos(slope[k])])
        matrix[rows, axle_force][:, 2 * k : 2 * k + 2] = np.eye(2)
        right[rows] = -p * traction[k] * np.array([math.cos(slope[k]), math.sin(slope[k])])
        matrix[3 * k + 2, motor.start + k] = 1.0
        right[3 * k + 2] = p * torque[k]
    rocker = 3 * count
    free = [k for k in range(count) if not any(k in joint.axles for joint in rover.suspension)]
    bodies = {rocker: (centre, free)}
    for index, joint in enumerate(rover.suspension):
        pivot = turn @ [joint.x, joint.height]
        bodies[rocker + 3 + 3 * index] = (pivot, list(joint.axles))
        # The pivot's force acts on the bogie and, reversed, on the rocker.
        for row, point, sign in ((rocker + 3 + 3 * index, pivot, 1.0), (rocker, centre, -1.0)):
            force = slice(4 * count + 2 * index, 4 * count + 2 * index + 2)
            arm = pivot - point
            matrix[row : row + 2, force] += sign * np.eye(2)
            matrix[row + 2, force] += sign * np.array([-arm[1], arm[0]])
    for row, (point, carried) in bodies.items():  # The axles push back on the body.
        for k in carried:
            arm = axles[k] - point
            matrix[row : row + 2, axle_force][:, 2 * k : 2 * k + 2] -= np.eye(2)
            matrix[row + 2, axle_force][2 * k : 2 * k + 2] -= [-arm[1], arm[0]]
            matrix[row + 2, motor][k] += 1.0
    matrix[rocker : rocker + 2, acceleration] = -rover.mass * np.array(
        [math.cos(pitch), math.sin(pitch)]
    )
    right[rocker : rocker + 2] += [0.0, rover.mass * g]
    solution, _, rank, _ = np.linalg.lstsq(matrix, right)
    assert rank == size
    return np.array([*solution[normal], solution[acceleration]])


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_wheel_loads_are_those_of_free_body_diagrams_with_all_joint_forces(rover: Rover) -> None:
    pose = posed(rover, profiles()[3])
    generator = torch.Generator().manual_seed(2)
    share = rover.weight / len(rover.wheels)
    unit = torch.rand(2, 24, rover.axles, generator=generator, dtype=torch.float64)
    traction, torque = share * (unit[0] - 0.3), share * rover.wheel_radius * unit[1]
    loads = wheel_loads(rover, pose, traction, torque)
    forces = torch.stack([loads, traction, torque], dim=-1)
    along = torch.einsum("...raf,...af->...r", balance_matrix(rover, pose), forces)[:, 0]
    acceleration = along / rover.mass - rover.gravity * torch.sin(pose.pitch)
    for episode in range(24):
        expected = free_bodies(
            rover, pose, episode, traction[episode].numpy(), torque[episode].numpy()
        )
        assert loads[episode].numpy() == pytest.approx(expected[:-1], rel=1e-10, abs=1e-9 * share)
        assert float(acceleration[episode]) == pytest.approx(expected[-1], abs=1e-10)


def at_rest(rover: Rover) -> np.ndarray:
    """Return the loads [axles] [N] of one wheel on level ground, without traction."""
    zero = torch.zeros(24, rover.axles, dtype=torch.float64)
    return wheel_loads(rover, posed(rover, Flat()), zero, zero)[0].numpy()


@pytest.mark.parametrize("rover", [MARS, PAPER], ids=lambda rover: rover.name)
def test_loads_at_rest_on_level_ground_are_those_of_two_beams(rover: Rover) -> None:
    """The pivot carries what its lever arm gives it, the bogie shares it by lever arms again."""
    (pivot,), (front, middle, rear) = rover.suspension, rover.axle_x
    on_pivot = rover.weight * (front - rover.centre_of_mass_x) / (front - pivot.x)
    on_rear = on_pivot * (middle - pivot.x) / (middle - rear)
    expected = (
        np.array([rover.weight - on_pivot, on_pivot - on_rear, on_rear]) / rover.wheels_per_axle
    )
    assert at_rest(rover) == pytest.approx(expected, rel=1e-12)


def test_loads_at_rest_of_four_wheels_are_those_of_one_beam() -> None:
    """50 kg at g = 9.81 m/s^2; 0.05 m behind the middle of 0.51 m lie 305 / 510 of it behind."""
    assert at_rest(FOUR_WHEELS) == pytest.approx([122.625, 122.625], rel=1e-12)
    assert UNEVEN.centre_of_mass_x == -0.05
    front = 245.25 * 205.0 / 510.0
    assert at_rest(UNEVEN) == pytest.approx([front, 245.25 - front], rel=1e-12)


def test_loads_at_rest_with_the_bogie_in_front_are_those_of_two_beams() -> None:
    """The pivot at 0.35 m and the rear axle at -0.7 m carry a weight at -0.06 m."""
    assert BOGIE_IN_FRONT.suspension[0].axles == (0, 1)
    on_pivot = 185.0 * 3.72 * 0.64 / 1.05
    expected = [on_pivot / 4.0, on_pivot / 4.0, (185.0 * 3.72 - on_pivot) / 2.0]
    assert at_rest(BOGIE_IN_FRONT) == pytest.approx(expected, rel=1e-12)


class Backwards(Profile):
    """A profile as it is seen by a rover that drives the other way."""

    def __init__(self, profile: Profile) -> None:
        self._profile = profile

    def shape(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        height, slope, curvature = self._profile.shape(-x)
        return height, -slope, curvature


@pytest.mark.parametrize("rover", ROVERS, ids=lambda rover: rover.name)
def test_a_rover_seen_from_the_other_side_has_the_mirrored_pose_and_loads(rover: Rover) -> None:
    """A bogie in front driving forward is a bogie behind driving backwards, T and M reversed."""
    profile, other = profiles()[3], mirrored(rover)
    pose = posed(rover, profile)
    there = solve_pose(other, Backwards(profile), -PLACES, level_pose(other, -PLACES))
    torch.testing.assert_close(there.height, pose.height, rtol=0.0, atol=1e-10)
    torch.testing.assert_close(there.pitch, -pose.pitch, rtol=0.0, atol=1e-10)
    torch.testing.assert_close(there.joint_angle, -pose.joint_angle, rtol=0.0, atol=1e-10)
    torch.testing.assert_close(there.contact.flip(-1), -pose.contact, rtol=0.0, atol=1e-10)
    unit = torch.rand(
        2, 24, rover.axles, generator=torch.Generator().manual_seed(4), dtype=torch.float64
    )
    traction = rover.weight / len(rover.wheels) * (unit[0] - 0.3)
    torque = rover.weight / len(rover.wheels) * rover.wheel_radius * unit[1]
    loads = wheel_loads(rover, pose, traction, torque)
    reversed_ = wheel_loads(other, there, -traction.flip(-1), -torque.flip(-1))
    torch.testing.assert_close(reversed_.flip(-1), loads, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("rover", [MARS, FOUR_WHEELS], ids=lambda rover: rover.name)
def test_driving_torque_takes_load_off_the_front_wheels_and_a_climb_does_too(
    rover: Rover,
) -> None:
    flat, zero = posed(rover, Flat()), torch.zeros(24, rover.axles, dtype=torch.float64)
    rest = wheel_loads(rover, flat, zero, zero)
    driven = wheel_loads(rover, flat, zero + 20.0, zero + 20.0 * rover.wheel_radius)
    assert bool((driven[:, 0] < rest[:, 0]).all())
    held = zero + rover.weight / len(rover.wheels) * math.sin(0.2)
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
        joints=1,
    )
    weight = 185.0 * 3.72
    assert target[0].tolist() == pytest.approx(
        [185.0 * 0.5 + weight * math.sin(0.1), weight * math.cos(0.1), 0.0, 0.0]
    )
