# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Single steps of the simulated rover: standing, getting stuck, and what a sample says of it."""

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from terramechanics.contact.sinkage import DEEPEST, WheelGround, equilibrium_sinkage, free_rolling
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs, Effect, Plant, Situation
from terramechanics.simulation.sample import SLOWEST, TIME_STEP, Sample
from terramechanics.simulation.schedules import (
    HIGHEST_SLIP,
    HIGHEST_TORQUE,
    Command,
    TorqueBands,
    make_schedule,
)
from terramechanics.simulation.simulation import Simulation, simulate, start
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Flat, Profile, Ramp, Sampled, random_hills
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.suspension import (
    BodyLoad,
    TerrainError,
    balance_matrix,
    balance_target,
    level_pose,
    solve_pose,
    wheel_loads,
)

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
P = ROVER.wheels_per_axle


def numbers(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def simulation(
    batch: int, profile: Profile, speed: float = 0.1, dt: float = TIME_STEP
) -> Simulation:
    velocity = torch.full((batch,), speed, dtype=torch.float64)
    return Simulation(ROVER, Ground.constant(SOIL), profile, velocity, dt)


def driven(sim: Simulation, steps: int, command: Tensor) -> Sample:
    """The last of so many steps."""
    return [sim.step(Command.RATE, command) for _ in range(steps)][-1]


def rates(batch: int, speed: float) -> Tensor:
    return torch.full((batch, ROVER.axles), speed / ROVER.wheel_radius, dtype=torch.float64)


@pytest.mark.parametrize("batch", [1, 2, 5])
def test_a_rover_that_stands_on_a_slope_is_held_by_equal_parts_of_its_wheels(batch: int) -> None:
    """Without slip; the forces balance the weight along and across the slope."""
    grade = 0.12
    sim = simulation(batch, Ramp(grade, start=-20.0), 0.0)
    sample = sim.step(Command.RATE, rates(batch, 0.0))
    assert bool(sample.standing.all())
    assert not bool(sample.stuck.any())
    assert bool(torch.isnan(sample.slip).all())
    assert not sample.velocity.any()
    hold = ROVER.weight * math.sin(grade) / len(ROVER.wheels)
    torch.testing.assert_close(sample.traction, torch.full_like(sample.traction, hold))
    torch.testing.assert_close(
        sample.ground_torque, torch.full_like(sample.traction, hold * ROVER.wheel_radius)
    )
    across = P * sample.normal.sum(-1)
    torch.testing.assert_close(across, torch.full_like(across, ROVER.weight * math.cos(grade)))
    assert not bool(sample.valid.any())


def test_a_parked_rover_is_never_stuck_and_one_that_spins_is_after_its_second() -> None:
    parked = simulation(1, Flat(), 0.0)
    for _ in range(15):
        assert not bool(parked.step(Command.RATE, rates(1, 0.0)).stuck.any())
    weak = Soil("weak", 1.1, 900.0, 1.5e6, 0.025, 0.18, 0.32, 0.0, 0.05)
    spinning = Simulation(ROVER, Ground.constant(weak), Flat(), numbers(0.0))
    stuck = [bool(spinning.step(Command.RATE, rates(1, 0.2)).stuck[0]) for _ in range(40)]
    samples = [bool(value) for value in stuck]
    first = samples.index(True)
    assert first >= 9
    assert all(samples[first:])


@pytest.mark.parametrize("dt", [0.1, 0.05])
def test_a_rover_is_stuck_when_it_has_struggled_for_a_second(dt: float) -> None:
    """Wheels that start at a run on ground without strength slip at once."""
    weak = Soil("weak", 1.1, 900.0, 1.5e6, 0.025, 0.18, 0.32, 0.0, 0.01)
    sim = Simulation(ROVER, Ground.constant(weak), Flat(), numbers(0.0), dt)
    slips, stuck = [], []
    for _ in range(round(3.0 / dt)):
        sample = sim.step(Command.RATE, rates(1, 0.5))
        slips.append(float(sample.slip.mean()))
        stuck.append(bool(sample.stuck[0]))
    begun = next(k for k, slip in enumerate(slips) if slip > 0.9)
    assert stuck.index(True) == begun + round(1.0 / dt) - 1


@pytest.mark.parametrize(("share", "counts"), [(0.98, False), (1.0, True)])
def test_a_wheel_in_the_ground_to_its_axle_struggles(share: float, *, counts: bool) -> None:
    """DEEPEST is the share of the radius at which the search for a sinkage ends."""
    sim = simulation(1, Flat())
    steady = sim._contacts(sim._pose, Command.RATE, rates(1, 0.12), TIME_STEP)
    deep = dataclasses.replace(steady, sinkage=steady.sinkage.clone())
    deep.sinkage[0, 1] = share * DEEPEST * ROVER.wheel_radius
    for _ in range(10):
        sim._count_struggle(deep, numbers(0.1), torch.tensor([False]))
    assert bool(sim._stuck) == counts


def test_slower_than_the_slowest_wheel_is_standing() -> None:
    for factor, stands in ((0.999, True), (1.01, False)):
        sim = simulation(2, Flat(), 0.0)
        sample = sim.step(Command.RATE, rates(2, factor * SLOWEST))
        assert sample.standing.tolist() == [stands] * 2
    one_turns = rates(1, 0.0)
    one_turns[0, 1] = 0.5
    assert not bool(simulation(1, Flat(), 0.0).step(Command.RATE, one_turns).standing.any())


def test_a_sample_carries_time_place_and_the_torque_that_turns_the_wheels() -> None:
    sim = simulation(2, Flat(), 0.1, 0.05)
    sim.settle(rates(2, 0.12))
    before = sim.velocity.clone()
    first = sim.step(Command.RATE, rates(2, 0.12))
    second = sim.step(Command.RATE, rates(2, 0.15))
    assert second.time.tolist() == pytest.approx([0.1, 0.1])
    torch.testing.assert_close(first.position, 0.05 * before)
    torch.testing.assert_close(second.position, first.position + 0.05 * first.velocity)
    torch.testing.assert_close(second.acceleration, (second.velocity - first.velocity) / 0.05)
    spin = ROVER.wheel_inertia * (0.03 / ROVER.wheel_radius) / 0.05
    torch.testing.assert_close(
        second.torque - second.ground_torque, torch.full((2, 3), spin).double()
    )
    torch.testing.assert_close(first.torque, first.ground_torque)
    torch.testing.assert_close(
        second.slip, 1.0 - second.velocity[:, None] / (ROVER.wheel_radius * second.wheel_rate)
    )
    assert bool(second.valid.all())
    torch.testing.assert_close(second.specific_force(3.0), second.acceleration)


def test_a_rover_that_climbs_moves_along_the_slope() -> None:
    """Its place is horizontal: the cosine of the slope of the way."""
    grade = 0.2
    sim = simulation(1, Ramp(grade, start=-20.0), 0.1)
    first = sim.step(Command.RATE, rates(1, 0.15))
    second = sim.step(Command.RATE, rates(1, 0.15))
    way = TIME_STEP * float(first.velocity)
    assert way > 0.0
    assert float(second.position - first.position) == pytest.approx(way * math.cos(grade))
    assert float(second.height - first.height) == pytest.approx(way * math.sin(grade))
    assert float(second.pitch) == pytest.approx(grade)
    force = float(second.specific_force(ROVER.gravity))
    assert force == pytest.approx(float(second.acceleration) + ROVER.gravity * math.sin(grade))


def test_a_settled_rover_goes_on_as_it_is() -> None:
    sim = simulation(2, Flat())
    sim.settle(rates(2, 0.12))
    velocity = sim.velocity.clone()
    sample = driven(sim, 5, rates(2, 0.12))
    torch.testing.assert_close(sample.velocity, velocity, rtol=1e-5, atol=0.0)
    assert float(sample.acceleration.abs().max()) < 1e-5


def test_commanded_torques_turn_the_wheels_as_their_slip_says() -> None:
    sim = simulation(2, Flat(), 0.1)
    torque = torch.tensor([[4.8, 5.0, 5.2], [5.0, 5.0, 5.0]]).double()
    for _ in range(2):
        sim.step(Command.TORQUE, torque)
    before = sim.rate.clone()
    sample = sim.step(Command.TORQUE, torque)
    torch.testing.assert_close(sample.ground_torque, torque, rtol=1e-5, atol=1e-6)
    expected = sample.velocity[:, None] / (ROVER.wheel_radius * (1.0 - sample.slip))
    torch.testing.assert_close(sample.wheel_rate, expected)
    spin = ROVER.wheel_inertia * (sample.wheel_rate - before) / TIME_STEP
    torch.testing.assert_close(sample.torque - sample.ground_torque, spin)


def test_wheels_can_be_braked_by_torque_but_not_by_a_rate_below_the_slowest() -> None:
    braking = torch.full((1, 3), -1.0, dtype=torch.float64)
    sample = simulation(1, Flat(), 0.2).step(Command.TORQUE, braking)
    torch.testing.assert_close(sample.ground_torque, braking, rtol=1e-5, atol=1e-6)
    assert float(sample.velocity) < 0.2
    turned = rates(1, 0.2)
    turned[0, 1] = 0.0
    held = simulation(1, Flat(), 0.2).step(Command.RATE, turned)
    slowest = turned.clamp(min=SLOWEST / ROVER.wheel_radius)
    same = simulation(1, Flat(), 0.2).step(Command.RATE, slowest)
    torch.testing.assert_close(held.velocity, same.velocity)
    torch.testing.assert_close(held.traction, same.traction)


def test_friction_takes_its_share_of_a_commanded_torque() -> None:
    class Bearings(Effect):
        def friction(self, where: Situation) -> Tensor:
            return torch.full_like(where.rate, 0.75)

    velocity, torque = numbers(0.1), torch.full((1, 3), 5.0, dtype=torch.float64)
    plant = Plant([Bearings()])
    sim = Simulation(ROVER, Ground.constant(SOIL), Flat(), velocity, plant=plant)
    sample = sim.step(Command.TORQUE, torque)
    torch.testing.assert_close(sample.ground_torque, torque - 0.75, rtol=1e-5, atol=1e-6)


def test_named_schedules_start_settled_and_own_ones_as_they_are_given() -> None:
    generator = torch.Generator().manual_seed(1)
    ground = Ground.constant(SOIL)
    sim, schedule = start(ROVER, ground, "S3", generator, 3)
    assert torch.equal(sim.rate, schedule.command(0.0))
    assert bool((sim.velocity < schedule.start_velocity).all())
    torque_driven, bands = start(ROVER, ground, "S2", generator, 3)
    assert torch.equal(torque_driven.velocity, bands.start_velocity)
    again, same = start(ROVER, ground, schedule, generator, 3, "flat", 0.02)
    assert same is schedule
    assert again.time_step == 0.02
    assert torch.equal(again.velocity, schedule.start_velocity)


def test_a_schedule_is_asked_for_the_end_of_each_step_in_order() -> None:
    asked: list[float] = []

    class Noting:
        kind, start_velocity = Command.RATE, numbers(0.1)

        def command(self, time: float) -> Tensor:
            asked.append(time)
            return rates(1, 0.12)

    generator = torch.Generator().manual_seed(1)
    simulate(ROVER, Ground.constant(SOIL), Noting(), 0.5, generator, 1, "flat")
    assert asked == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])


def test_an_effect_is_asked_at_the_end_of_each_step() -> None:
    """And before the first, for the place where the rover begins."""
    asked: list[tuple[float, int]] = []

    class Noting(Effect):
        def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
            asked.append((where.time, where.episode.shape[0]))
            return contact

        def friction(self, where: Situation) -> Tensor:
            return 0.25 * where.rate

    velocity = torch.full((2,), 0.1, dtype=torch.float64)
    plain = simulation(2, Flat())
    sim = Simulation(ROVER, Ground.constant(SOIL), Flat(), velocity, plant=Plant([Noting()]))
    asked.clear()
    for step in (1, 2):
        sample, without = (s.step(Command.RATE, rates(2, 0.12)) for s in (sim, plain))
        times = [time for time, _ in asked]
        assert times == pytest.approx([step * TIME_STEP] * len(times))
        assert times
        asked.clear()
        torch.testing.assert_close(sample.velocity, without.velocity)
        lost = sample.torque - without.torque
        torch.testing.assert_close(lost, 0.25 * rates(2, 0.12), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("soil", ["loose_sand", "compact_sand"])
def test_the_torques_of_s2_are_shares_of_what_an_even_load_needs(soil: str) -> None:
    """From a third of the way between rolling freely and the highest torque; then half."""
    ground, batch = Ground.constant(load_soil(soil)), 400
    schedule = make_schedule("S2", ROVER, ground, batch, torch.Generator().manual_seed(1))
    assert isinstance(schedule, TorqueBands)
    wheel = WheelGround.of(ROVER, load_soil(soil).constants(), load_soil(soil).strength(), 8)
    load = numbers(ROVER.weight / len(ROVER.wheels))
    free = wheel.forces(*free_rolling(wheel, load))[:, 2]
    slip = torch.full_like(load, HIGHEST_SLIP)
    most = wheel.forces(slip, equilibrium_sinkage(wheel, slip, load))[:, 2]
    high = min(float(HIGHEST_TORQUE * free), float(most))
    low = float(free) + (high - float(free)) / 3.0
    torch.testing.assert_close(
        schedule.high, torch.full((batch,), high).double(), rtol=1e-6, atol=0.0
    )
    torch.testing.assert_close(
        schedule.low, torch.full((batch,), low).double(), rtol=1e-6, atol=0.0
    )
    for time, part in ((0.1, 1.0), (20.0, 1.0), (20.1, 0.5)):
        drawn = schedule.command(time)
        assert drawn.shape == (batch, ROVER.axles)
        width = part * (high - low)
        assert part * low <= float(drawn.min()) < part * low + 0.02 * width
        assert part * high - 0.02 * width < float(drawn.max()) <= part * high


# statics


@pytest.mark.parametrize("batch", [1, 4])
def test_loads_and_balances_follow_the_pose_of_each(batch: int) -> None:
    x = torch.linspace(0.0, 1.0, batch, dtype=torch.float64)
    pose = solve_pose(ROVER, Ramp(0.15, start=-30.0), x, level_pose(ROVER, x))
    traction = torch.full((batch, 3), 12.0, dtype=torch.float64)
    torque = torch.full((batch, 3), 1.7, dtype=torch.float64)
    load = wheel_loads(ROVER, pose, traction, torque)
    matrix = balance_matrix(ROVER, pose)
    forces = torch.stack([load, traction, torque], -1)
    acting = torch.einsum("brak,bak->br", matrix, forces)
    body = BodyLoad.of(ROVER)
    push = 3.0 * P * 12.0 / ROVER.mass - ROVER.gravity * math.sin(0.15)
    target = balance_target(body, pose.pitch, torch.full((batch,), push).double(), joints=1)
    torch.testing.assert_close(acting, target, rtol=1e-7, atol=1e-6)
    assert bool((load[:, 2] > load[:, 0]).all())


@dataclasses.dataclass
class Counted:
    """A profile that counts how often it is asked."""

    profile: Profile
    asked: int = 0

    def shape(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        self.asked += 1
        return self.profile.shape(x)


def test_a_pose_is_found_in_a_few_steps_of_newton() -> None:
    """It converges quadratically: six evaluations of hills."""
    x = torch.linspace(0.3, 9.7, 24, dtype=torch.float64)
    hills = random_hills(24, torch.ones(24).double(), torch.Generator().manual_seed(5))
    fresh = Counted(hills)
    pose = solve_pose(ROVER, fresh, x, level_pose(ROVER, x))
    assert fresh.asked <= 6
    moved = Counted(hills)
    solve_pose(ROVER, moved, x + 0.01, pose)
    assert moved.asked <= 6


def test_ground_that_is_curved_more_sharply_than_a_wheel_is_refused() -> None:
    """The radius of a hollow may not come near that of the wheel: 1 - r h'' > 0.1."""
    x = torch.zeros(1, dtype=torch.float64)
    for radii, refused in ((1.05, True), (1.3, False)):
        curvature = 1.0 / (radii * ROVER.wheel_radius)
        bend = torch.full((1, 3), curvature, dtype=torch.float64)
        slope = curvature * torch.tensor([[-0.05, 0.0, 0.05]], dtype=torch.float64)
        hollow = Sampled(slope, bend, -0.05 + ROVER.axle_x[0], 0.05)
        if refused:
            with pytest.raises(TerrainError, match="curved too sharply"):
                solve_pose(ROVER, hollow, x, level_pose(ROVER, x))
        else:
            solve_pose(ROVER, hollow, x, level_pose(ROVER, x))


@pytest.mark.parametrize(("bend", "refused"), [(0.92, True), (0.88, False)])
def test_the_curvature_that_a_wheel_feels_on_a_slope_is_that_along_the_ground(
    bend: float, *, refused: bool
) -> None:
    """It is h'' / (1 + h'^2)^(3/2)."""
    x = torch.zeros(1, dtype=torch.float64)
    slope = torch.ones(1, 5, dtype=torch.float64)
    second = torch.full_like(slope, bend / ROVER.wheel_radius * math.sqrt(8.0))
    ground = Sampled(slope, second, ROVER.axle_x[-1] - 1e-4, 1e-4)
    level = level_pose(ROVER, x)
    if refused:
        with pytest.raises(TerrainError, match="curved too sharply"):
            solve_pose(ROVER, ground, x, level)
    else:
        solve_pose(ROVER, ground, x, level)


# ground and its files
