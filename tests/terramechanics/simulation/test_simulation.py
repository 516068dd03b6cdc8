# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives: balances of force and energy, limits, repeatability, an independent integration."""

from dataclasses import fields

import numpy as np
import pytest
import torch
from scipy import optimize
from torch import Tensor

from terramechanics.contact.sinkage import WheelGround
from terramechanics.contact.stresses import quadrature, wheel_forces
from terramechanics.presets import load_rover, load_soil, rover_names, soil_names
from terramechanics.simulation.sample import TIME_STEP, Drive, Sample
from terramechanics.simulation.schedules import Command, make_schedule
from terramechanics.simulation.simulation import Simulation, simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import Flat, Ramp
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.equilibrium import StepEquations, _search_rates, solve_rates
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import level_pose, wheel_loads
from tests.rovers import BOGIE_IN_FRONT, FOUR_WHEELS, KINDS
from tests.samples import sampled

MARS = load_rover("mars_rover")
LOOSE = load_soil("loose_sand")


def drive(
    rover: str | Rover,
    soil: str,
    schedule: str = "S1",
    seconds: float = 8.0,
    batch: int = 12,
    seed: int = 3,
) -> Drive:
    generator = torch.Generator().manual_seed(seed)
    ground = Ground.random_strength(load_soil(soil), batch, generator)
    known = load_rover(rover) if isinstance(rover, str) else rover
    return simulate(known, ground, schedule, seconds, generator, batch)


def rates(rover: Rover, speed: float, batch: int = 1) -> Tensor:
    return torch.full((batch, rover.axles), speed / rover.wheel_radius, dtype=torch.float64)


def driven(simulation: Simulation, speed: float, steps: int) -> Sample:
    """Return the last of so many steps with equal wheel rates."""
    return [simulation.step(Command.RATE, rates(simulation.rover, speed)) for _ in range(steps)][-1]


CASES = [
    (rover, soil, schedule)
    for rover in rover_names()
    for soil in soil_names()
    for schedule in ("S1", "S2", "S4")
]


@pytest.mark.parametrize(("rover", "soil", "schedule"), sampled(CASES[::4], CASES))
def test_the_regression_rows_hold_exactly_without_noise(
    rover: str, soil: str, schedule: str
) -> None:
    """Check velocity, load and torque rows with more quadrature points than the simulation.

    The rows are affine in (c, tan phi).
    """
    run = drive(rover, soil, schedule)
    truth, r, p = run.sample, run.rover, run.rover.wheels_per_axle
    coefficients = wheel_forces(
        truth.slip, truth.sinkage, truth.constants, r.wheel_radius, r.wheel_width, quadrature(24)
    )
    forces = (coefficients[..., :2] * truth.strength.unsqueeze(-2)).sum(-1) + coefficients[..., 2]
    normal, traction, torque = forces.unbind(-1)
    sine, cosine = torch.sin(truth.contact_angle), torch.cos(truth.contact_angle)
    before = torch.cat([run.start_velocity.unsqueeze(-1), truth.velocity[:, :-1]], dim=-1)
    inertia = r.mass * (truth.velocity - before) / TIME_STEP
    velocity_row = (
        inertia
        + r.weight * torch.sin(truth.pitch)
        - p * (traction * cosine - normal * sine).sum(-1)
    )
    load_row = r.weight * torch.cos(truth.pitch) - p * (normal * cosine + traction * sine).sum(-1)
    inertia_of_wheels = (
        torch.diff(truth.wheel_rate, dim=1, prepend=truth.wheel_rate[:, :1])
        / TIME_STEP
        * r.wheel_inertia
    )
    torque_row = (truth.torque - torque)[:, 1:] - inertia_of_wheels[:, 1:]
    good = run.measurable()
    assert float(good.double().mean()) > (0.3 if soil == "compact_sand" else 0.75)
    assert float(velocity_row[good].abs().max()) < 1e-7 * r.weight
    assert float(load_row[good].abs().max()) < 1e-7 * r.weight
    assert float(torque_row[good[:, 1:]].abs().max()) < 1e-7 * r.weight * r.wheel_radius


@pytest.mark.parametrize("rover", KINDS, ids=lambda rover: rover.name)
def test_the_loads_of_a_drive_are_those_of_the_statics(rover: Rover) -> None:
    run = drive(rover, "loose_sand", "S3", seconds=2.0)
    level, pose = run.sample, level_pose(run.rover, run.sample.position[:, -1])
    loads = wheel_loads(run.rover, pose, level.traction[:, -1], level.ground_torque[:, -1])
    torch.testing.assert_close(level.normal[:, -1], loads, rtol=1e-8, atol=1e-8 * run.rover.weight)


@pytest.mark.parametrize("rover", [MARS, FOUR_WHEELS, BOGIE_IN_FRONT], ids=lambda each: each.name)
def test_the_work_of_the_wheels_goes_into_motion_height_and_soil(rover: Rover) -> None:
    """Check motor work = change of kinetic energy + rise in gravity + loss to the soil.

    The soil never returns energy.
    """
    run = drive(rover, "loose_sand", seconds=20.0, batch=30)
    truth, r = run.sample, run.rover
    good = run.measurable()
    assert float(good.double().mean()) > 0.9
    p, v = r.wheels_per_axle, truth.velocity
    before = torch.cat([run.start_velocity.unsqueeze(-1), v[:, :-1]], dim=-1)
    driven = p * (truth.ground_torque * truth.wheel_rate).sum(-1) * TIME_STEP
    # Implicit steps take m (dv)^2 / 2 more than the kinetic energy gains.
    kinetic = r.mass / 2.0 * (v**2 - before**2 + (v - before) ** 2)
    rise = r.weight * torch.sin(truth.pitch) * v * TIME_STEP
    along = p * (
        truth.traction * torch.cos(truth.contact_angle)
        - truth.normal * torch.sin(truth.contact_angle)
    ).sum(-1)
    torch.testing.assert_close(
        (along * v * TIME_STEP)[good], (kinetic + rise)[good], rtol=1e-7, atol=1e-7
    )
    by_soil = (driven - kinetic - rise)[good]
    assert float(by_soil.min()) > 0.0


@pytest.mark.parametrize("rover", [MARS, FOUR_WHEELS, BOGIE_IN_FRONT], ids=lambda each: each.name)
def test_a_steady_drive_is_that_of_an_independent_solver(rover: Rover) -> None:
    """Compare with the equations in N, z and v, in scipy, with small explicit steps.

    The ground is level, the wheel rates are equal.
    """
    speed = 0.2
    ground = Ground.constant(LOOSE)
    simulation = Simulation(
        rover, ground, Flat(), torch.tensor([0.05], dtype=torch.float64), time_step=0.002
    )
    sample = driven(simulation, speed, 200)
    wheel = WheelGround.of(rover, LOOSE.constants(), LOOSE.strength(), 24)
    arm = rover.centre_of_mass_height

    def forces(z: float, v: float) -> np.ndarray:
        slip = 1.0 - v / speed
        return wheel.forces(
            torch.tensor(slip, dtype=torch.float64), torch.tensor(z, dtype=torch.float64)
        ).numpy()

    def statics(z: np.ndarray, v: float) -> list[float]:
        """Balance vertical forces and moments of the rover and of its bogie, if it has one.

        The rover turns about the ground below its centre of mass, with inertia m a h; the bogie
        about its pivot.
        """
        f = np.array([forces(depth, v) for depth in z])
        push = 2.0 * f[:, 1].sum()
        # The ground acts at the axle with N, T and the moment M; about a point on the ground T has
        # the lever arm r.
        whole = (
            2.0
            * (
                (np.array(rover.axle_x) - rover.centre_of_mass_x) @ f[:, 0]
                - rover.wheel_radius * f[:, 1].sum()
                + f[:, 2].sum()
            )
            + push * arm
        )
        bogies = [
            2.0
            * sum(
                (rover.axle_x[k] - joint.x) * f[k, 0]
                + (joint.height - rover.wheel_radius) * f[k, 1]
                + f[k, 2]
                for k in joint.axles
            )
            for joint in rover.suspension
        ]
        return [2.0 * f[:, 0].sum() - rover.weight, whole, *bogies]

    velocity, z = 0.05, np.full(rover.axles, 0.018)
    for _ in range(800):
        root = optimize.root(statics, z, args=(velocity,), tol=1e-10)
        assert np.abs(root.fun).max() < 1e-9 * rover.weight
        z = root.x
        push = 2.0 * sum(forces(depth, velocity)[1] for depth in z)
        velocity += 0.0005 * push / rover.mass
    assert float(sample.velocity) == pytest.approx(velocity, rel=3e-3)
    assert sample.sinkage[0].tolist() == pytest.approx(z.tolist(), rel=1e-3)


def test_without_slip_on_rigid_ground_the_rover_rolls() -> None:
    rigid = LOOSE.with_values(k_phi=1e4 * LOOSE.k_phi, shear_modulus=1e-6)
    simulation = Simulation(
        MARS, Ground.constant(rigid), Flat(), torch.tensor([0.2], dtype=torch.float64)
    )
    sample = driven(simulation, 0.2, 10)
    assert sample.slip.abs().amax().item() < 2e-3
    assert sample.velocity.item() == pytest.approx(0.2, rel=2e-3)
    assert sample.sinkage.amax().item() < 2e-4
    assert sample.ground_torque.amax().item() < 0.01 * MARS.weight * MARS.wheel_radius


def test_a_climb_costs_slip_and_torque_and_a_descent_brakes() -> None:
    slips, torques = [], []
    for grade in (-0.25, 0.0, 0.1):
        profile = Ramp(grade, start=-20.0)
        simulation = Simulation(
            MARS, Ground.constant(LOOSE), profile, torch.tensor([0.15], dtype=torch.float64)
        )
        simulation.settle(rates(MARS, 0.2))
        sample = simulation.step(Command.RATE, rates(MARS, 0.2))
        slips.append(float(sample.slip.mean()))
        torques.append(float(sample.ground_torque.mean()))
        assert float(sample.pitch) == pytest.approx(grade, abs=1e-9)
        assert float(sample.specific_force(MARS.gravity)) == pytest.approx(
            MARS.gravity * np.sin(grade), abs=0.01
        )
    assert slips[0] < 0.0 < slips[1] < slips[2]
    assert torques[0] < torques[1] < torques[2]


def test_velocity_is_the_sum_of_accelerations_and_position_follows_velocity() -> None:
    run = drive("mars_rover", "loose_sand")
    truth = run.sample
    torch.testing.assert_close(
        truth.velocity,
        run.start_velocity.unsqueeze(-1) + (TIME_STEP * truth.acceleration).cumsum(-1),
    )
    moved = truth.position.diff(dim=-1)
    torch.testing.assert_close(moved, (TIME_STEP * truth.velocity * torch.cos(truth.pitch))[:, :-1])
    torch.testing.assert_close(truth.time[0], TIME_STEP * torch.arange(1, 81, dtype=torch.float64))


@pytest.mark.parametrize("schedule", ["S1", "S2", "S3", "S4"])
def test_the_same_seed_gives_the_same_run(schedule: str) -> None:
    first, again, other = (
        drive("paper_rover", "loose_sand", schedule, 2.0, 4, seed) for seed in (3, 3, 4)
    )
    for item in fields(Sample):
        torch.testing.assert_close(
            getattr(first.sample, item.name),
            getattr(again.sample, item.name),
            rtol=0.0,
            atol=0.0,
            equal_nan=True,
        )
    assert not torch.equal(first.sample.velocity, other.sample.velocity)


def test_an_episode_does_not_depend_on_its_companions() -> None:
    generator = torch.Generator().manual_seed(3)
    strength = torch.tensor([[700.0, 0.5], [3000.0, 0.8]], dtype=torch.float64)
    both = Ground([Patch(LOOSE.constants(), strength)])
    schedule = make_schedule("S1", MARS, both, 2, generator)
    commands = [schedule.command(0.1 * step) for step in range(1, 21)]
    together = Simulation(MARS, both, Flat(), schedule.start_velocity)
    alone = [
        Simulation(
            MARS,
            Ground([Patch(LOOSE.constants(), strength[[k]])]),
            Flat(),
            schedule.start_velocity[[k]],
        )
        for k in (0, 1)
    ]
    for command in commands:
        together.step(Command.RATE, command)
        for k, simulation in enumerate(alone):
            simulation.step(Command.RATE, command[[k]])
    assert together.velocity.tolist() == pytest.approx(
        [float(simulation.velocity) for simulation in alone], rel=1e-7
    )


def test_the_ground_changes_below_one_wheel_after_the_other() -> None:
    changed = Soil(
        **{**{item.name: getattr(LOOSE, item.name) for item in fields(Soil)}, "cohesion": 4000.0}
    )
    ground = Ground([Patch.of(LOOSE), Patch.of(changed, start=0.8)])
    simulation = Simulation(MARS, ground, Flat(), torch.tensor([0.2], dtype=torch.float64))
    samples = [simulation.step(Command.RATE, rates(MARS, 0.25)) for _ in range(120)]
    reached = [
        [bool(sample.strength[0, axle, 0] == 4000.0) for sample in samples] for axle in range(3)
    ]
    times = [reached[axle].index(True) for axle in range(3)]
    assert times[0] < times[1] < times[2]
    assert samples[-1].slip.mean() < samples[0].slip.mean()


def test_wheels_that_stand_hold_the_rover_and_have_no_slip() -> None:
    simulation = Simulation(
        MARS, Ground.constant(LOOSE), Ramp(0.1, start=-20.0), torch.zeros(1, dtype=torch.float64)
    )
    sample = driven(simulation, 0.0, 1)
    assert bool(sample.standing)
    assert bool(sample.slip.isnan().all())
    assert float(sample.velocity) == 0.0
    assert not bool(sample.valid.any())
    weight = (
        2.0
        * (
            sample.normal * torch.cos(sample.contact_angle)
            + sample.traction * torch.sin(sample.contact_angle)
        ).sum()
    )
    assert float(weight) == pytest.approx(MARS.weight * np.cos(0.1), rel=1e-9)
    assert 2.0 * float(sample.traction.sum()) == pytest.approx(MARS.weight * np.sin(0.1), rel=1e-9)
    assert not bool(driven(simulation, 0.0, 20).stuck)
    sample = driven(simulation, 0.2, 20)
    assert not bool(sample.standing)
    assert float(sample.velocity) > 0.02


def test_on_ground_too_weak_to_drive_the_rover_is_stuck_after_a_second_and_nothing_breaks() -> None:
    weak = LOOSE.with_values(cohesion=0.0, tan_phi=0.05)
    simulation = Simulation(
        MARS, Ground.constant(weak), Flat(), torch.tensor([0.2], dtype=torch.float64)
    )
    samples = [simulation.step(Command.RATE, rates(MARS, 0.2)) for _ in range(40)]
    stuck = [bool(sample.stuck) for sample in samples]
    assert stuck[-1]
    assert not any(stuck[:9])
    assert stuck == sorted(stuck)
    for sample in samples:
        for item in fields(Sample):
            assert bool(getattr(sample, item.name).isfinite().all()), item.name
        assert float(sample.velocity) >= 0.0


@pytest.mark.parametrize("kind", list(Command))
def test_hostile_commands_leave_finite_numbers(kind: Command) -> None:
    generator = torch.Generator().manual_seed(8)
    batch = 20
    ground = Ground.random_strength(LOOSE, batch, generator)
    simulation = Simulation(
        MARS, ground, Ramp(0.3, start=0.0), torch.full((batch,), 0.1, dtype=torch.float64)
    )
    largest = 30.0 if kind is Command.TORQUE else 5.0
    for _ in range(sampled(6, 12)):
        command = largest * torch.rand(batch, 3, generator=generator, dtype=torch.float64) ** 6
        sample = simulation.step(kind, command)
        for item in fields(Sample):
            values = getattr(sample, item.name)
            moving = (
                ~sample.standing if item.name == "slip" else torch.ones(batch, dtype=torch.bool)
            )
            assert bool(values[moving].isfinite().all()), item.name


def test_the_search_finds_what_newton_finds() -> None:
    """Newton gives up from a far start, and solves from the bracketing search."""
    batch = 10
    ground = Ground.random_strength(LOOSE, batch, torch.Generator().manual_seed(1))
    pose = level_pose(MARS, torch.zeros(batch, dtype=torch.float64))
    fine = WheelGround.of(MARS, *ground.at(pose.contact), points=12)
    coarse = WheelGround.of(MARS, *ground.at(pose.contact), points=3)
    step = StepEquations.of(
        MARS, pose, fine, coarse, torch.full((batch,), 0.12, dtype=torch.float64), TIME_STEP
    )
    rate = rates(MARS, 0.15, batch) * torch.tensor([1.1, 0.9, 1.0], dtype=torch.float64)
    start = torch.full((batch, 3), 0.018, dtype=torch.float64)
    exact = solve_rates(step, rate, start, step.velocity)
    assert bool(exact.solved.all())
    depth, end = _search_rates(step, rate, start)
    torch.testing.assert_close(end, exact.velocity, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(depth, exact.sinkage, rtol=1e-4, atol=1e-7)
    far = solve_rates(step, rate, torch.full_like(start, 1e-6), 40.0 * step.velocity)
    assert bool(far.solved.all())
    torch.testing.assert_close(far.velocity, exact.velocity, rtol=1e-7, atol=1e-9)
