# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the solvers of a time step are given, and how quickly they get there."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import pytest
import torch
from torch import Tensor

from terramechanics.contact.sinkage import (
    DEEPEST,
    FEW,
    SHALLOWEST,
    WheelGround,
    equilibrium_sinkage,
)
from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP
from terramechanics.numerics.roots import bracketed_root, quasi_newton
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs
from terramechanics.terrain.profile import Flat
from terramechanics.vehicle import equilibrium
from terramechanics.vehicle.equilibrium import (
    StepEquations,
    carried,
    slip_at,
    solve_rates,
    solve_torques,
)
from terramechanics.vehicle.suspension import level_pose, solve_pose, wheel_loads

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
A, BATCH = ROVER.axles, 3
SPEED = torch.tensor([0.08, 0.1, 0.12], dtype=torch.float64)


def step_equations(duration: float = 0.1) -> StepEquations:
    """On level ground, all forces with the same quadrature."""
    x = torch.zeros(BATCH, dtype=torch.float64)
    pose = solve_pose(ROVER, Flat(), x, level_pose(ROVER, x))
    wheel = WheelGround.of(
        ROVER, SOIL.constants().expand(BATCH, A, 6), SOIL.strength().expand(BATCH, A, 2), 8
    )
    return StepEquations.of(ROVER, pose, wheel, wheel, SPEED, duration)


def rates(slip: float = 0.2) -> Tensor:
    """Wheel rates at which the wheels slip about so much, a little different by axle."""
    spread = torch.tensor([1.0, 1.05, 0.97], dtype=torch.float64)
    return (SPEED / ROVER.wheel_radius / (1.0 - slip)).unsqueeze(-1) * spread


def start_depth() -> Tensor:
    return torch.full((BATCH, A), 0.015, dtype=torch.float64)


class Recorder:
    """Stands in for the solver: keeps what it is given, and solves."""

    def __init__(self, failing: Sequence[int] = ()) -> None:
        """Episodes that are ``failing`` at first."""
        self.calls: list[tuple[Any, ...]] = []
        self._failing = list(failing)

    def __call__(self, *arguments: Any) -> tuple[Tensor, Tensor]:
        self.calls.append(arguments)
        unknown, solved = quasi_newton(*arguments)
        if len(self.calls) == 1:
            unknown[self._failing] = arguments[2][self._failing]
            solved[self._failing] = False
        return unknown, solved


@pytest.fixture(name="recorder")
def recording(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    recorder = Recorder()
    monkeypatch.setattr(equilibrium, "quasi_newton", recorder)
    return recorder


def assert_jacobian(
    residual: Callable[..., Tensor], jacobian: Callable[..., Tensor], u: Tensor
) -> None:
    """It is the derivative of the residual, by central differences."""
    index = torch.arange(u.shape[0])
    found = jacobian(u, index)
    for column in range(u.shape[1]):
        move = torch.zeros_like(u)
        move[:, column] = 1e-6
        slope = (residual(u + move, index) - residual(u - move, index)) / 2e-6
        torch.testing.assert_close(found[:, :, column], slope, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("duration", [0.1, 2.0])
def test_the_jacobian_under_wheel_rates_is_the_derivative(
    recorder: Recorder, duration: float
) -> None:
    step = step_equations(duration)
    found = solve_rates(step, rates(), start_depth(), SPEED)
    assert bool(found.solved.all())
    residual, jacobian, start, limits = recorder.calls[0]
    torch.testing.assert_close(start[:, :A], start_depth().log())
    torch.testing.assert_close(start[:, A], SPEED / (ROVER.wheel_radius * rates()).mean(-1))
    assert_jacobian(residual, jacobian, start)
    part = torch.tensor([2, 0])
    torch.testing.assert_close(
        jacobian(start[part], part), jacobian(start, torch.arange(BATCH))[part]
    )
    low, high = (math.log(end * ROVER.wheel_radius) for end in (SHALLOWEST, DEEPEST))
    torch.testing.assert_close(limits[0], torch.tensor([low] * A + [-3.0], dtype=torch.float64))
    torch.testing.assert_close(limits[1], torch.tensor([high] * A + [3.0], dtype=torch.float64))


def test_the_jacobian_under_torques_is_the_derivative(recorder: Recorder) -> None:
    step = step_equations()
    by_rates = solve_rates(step, rates(), start_depth(), SPEED)
    torque = by_rates.forces[..., 2]
    slip = torch.full_like(torque, 0.15)
    found = solve_torques(step, torque, start_depth(), slip)
    residual, jacobian, start, limits = recorder.calls[1]
    torch.testing.assert_close(start, torch.cat([start_depth().log(), slip], 1))
    assert_jacobian(residual, jacobian, start)
    assert limits[0][A:].tolist() == [MIN_SLIP] * A
    assert limits[1][A:].tolist() == [MAX_SLIP] * A
    # the torques of a solution under rates give that solution
    torch.testing.assert_close(found.slip, by_rates.slip, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(found.sinkage, by_rates.sinkage, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(found.velocity, by_rates.velocity, rtol=1e-6, atol=1e-8)
    assert bool(found.obeyed.all())


def test_a_solution_balances_the_rover_and_belongs_to_its_end_velocity() -> None:
    step = step_equations()
    found = solve_rates(step, rates(), start_depth(), SPEED)
    assert float(step.imbalance(found.forces, found.velocity).abs().max()) < 1e-9
    torch.testing.assert_close(
        found.slip, 1.0 - found.velocity.unsqueeze(-1) / (ROVER.wheel_radius * rates())
    )
    torch.testing.assert_close(found.slip, slip_at(ROVER, found.velocity, rates()))
    torch.testing.assert_close(found.forces, step.wheel.forces(found.slip, found.sinkage))
    push = float(ROVER.wheels_per_axle) * found.forces[..., 1].sum(-1) / ROVER.mass
    torch.testing.assert_close(found.velocity, SPEED + 0.1 * push)


@pytest.mark.parametrize("kind", ["rates", "torques"])
def test_where_newton_fails_a_search_begins_close_to_the_solution(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = step_equations()
    direct = solve_rates(step, rates(), start_depth(), SPEED)
    failing = Recorder(range(BATCH))
    monkeypatch.setattr(equilibrium, "quasi_newton", failing)
    far = torch.full((BATCH, A), 0.002, dtype=torch.float64)
    if kind == "rates":
        found = solve_rates(step, rates(), far, 0.0 * SPEED)
        wanted = torch.cat(
            [
                direct.sinkage.log(),
                (direct.velocity / (ROVER.wheel_radius * rates()).mean(-1)).unsqueeze(-1),
            ],
            1,
        )
    else:
        found = solve_torques(step, direct.forces[..., 2], far, torch.zeros_like(far))
        wanted = torch.cat([direct.sinkage.log(), direct.slip], 1)
    assert bool(found.solved.all())
    searched = failing.calls[1][2]
    torch.testing.assert_close(searched, wanted, rtol=0.0, atol=0.02)
    torch.testing.assert_close(found.slip, direct.slip, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(found.sinkage, direct.sinkage, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("episode", range(BATCH))
def test_a_single_episode_that_newton_misses_is_searched_for_alone(
    episode: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = step_equations()
    direct = solve_rates(step, rates(), start_depth(), SPEED)
    failing = Recorder([episode])
    monkeypatch.setattr(equilibrium, "quasi_newton", failing)
    found = solve_rates(step, rates(), start_depth(), SPEED)
    assert bool(found.solved.all())
    assert failing.calls[1][2].shape[0] == 1
    torch.testing.assert_close(found.sinkage, direct.sinkage, rtol=1e-6, atol=1e-8)
    torch.testing.assert_close(found.velocity, direct.velocity, rtol=1e-6, atol=1e-8)


def test_a_search_finds_a_rover_that_is_braked_from_a_run() -> None:
    """Its wheels turn at a tenth of its speed; after two seconds it goes as they do."""
    step = dataclasses.replace(step_equations(2.0), velocity=10.0 * SPEED)
    rate = (SPEED / ROVER.wheel_radius).unsqueeze(-1).expand(BATCH, A)
    _, end = equilibrium._search_rates(step, rate, start_depth())
    direct = solve_rates(step, rate, start_depth(), SPEED)
    assert bool(direct.solved.all())
    torch.testing.assert_close(end, direct.velocity, rtol=1e-4, atol=1e-6)
    assert bool((end < 0.5 * step.velocity).all())


def test_torques_beyond_what_the_ground_takes_are_not_obeyed() -> None:
    step = step_equations()
    torque = torch.tensor([[1e3, 5.0, 5.0], [5.0, 5.0, 5.0], [5.0, -1e3, 5.0]]).double()
    found = solve_torques(step, torque, start_depth(), torch.full((BATCH, A), 0.2).double())
    assert found.obeyed[:2].tolist() == [[False, True, True], [True] * 3]
    assert not bool(found.obeyed[2, 1])
    assert float(found.slip[0, 0]) == MAX_SLIP
    assert float(found.slip[2, 1]) == MIN_SLIP
    torch.testing.assert_close(found.forces[1, :, 2], torque[1], rtol=1e-6, atol=1e-5)


def test_wheel_rates_that_ask_for_more_slip_than_the_range_are_not_obeyed() -> None:
    step = step_equations()
    fast = rates()
    fast[0, 1] *= 100.0
    found = solve_rates(step, fast, start_depth(), SPEED)
    assert found.obeyed.tolist() == [[True, False, True], [True] * 3, [True] * 3]
    assert float(found.slip[0, 1]) == MAX_SLIP


def test_carried_sinkages_agree_with_the_loads_that_they_make() -> None:
    step = step_equations()
    slip = torch.tensor([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0], [0.5, 0.1, -0.1]]).double()
    depth = carried(step, slip, start_depth(), 40)
    forces = step.wheel.forces(slip, depth)
    load = wheel_loads(ROVER, step.pose, forces[..., 1], forces[..., 2], step.body)
    torch.testing.assert_close(forces[..., 0], load, rtol=1e-6, atol=1e-6)
    once = carried(step, slip, start_depth(), 1)
    assert float((once / depth - 1.0).abs().max()) > 1e-4


# how quickly


def counted(function: Callable[..., Tensor]) -> tuple[Callable[..., Tensor], list[int]]:
    calls: list[int] = []

    def call(*arguments: Any) -> Tensor:
        calls.append(arguments[0].shape[0])
        return function(*arguments)

    return call, calls


def residual(u: Tensor, index: Tensor) -> Tensor:
    """x e^x = k and x + y = 1, another k in every episode."""
    k = 1.0 + index.to(u.dtype)
    return torch.stack([u[:, 0] * torch.exp(u[:, 0]) - k, u.sum(-1) - 1.0], dim=-1)


def slopes(u: Tensor, index: Tensor) -> Tensor:
    del index
    zero, one = torch.zeros_like(u[:, 0]), torch.ones_like(u[:, 0])
    top = torch.stack([(1.0 + u[:, 0]) * torch.exp(u[:, 0]), zero], -1)
    return torch.stack([top, torch.stack([one, one], -1)], -2)


def test_a_smooth_problem_takes_nine_evaluations_and_two_jacobians() -> None:
    """Broyden's update saves Jacobians; solved episodes drop out."""
    value, values = counted(residual)
    slope, derivatives = counted(slopes)
    limits = (torch.tensor([-5.0, -5.0]).double(), torch.tensor([5.0, 5.0]).double())
    start = torch.full((4, 2), 0.5, dtype=torch.float64)
    found, solved = quasi_newton(value, slope, start, limits)
    assert bool(solved.all())
    for episode in range(4):
        x = float(found[episode, 0])
        assert x * math.exp(x) == pytest.approx(1.0 + episode, abs=1e-9)
    assert len(values) <= 9
    assert len(derivatives) == 2
    assert values[0] == 4
    assert values[-1] < 4


def test_a_linear_problem_is_solved_by_one_move_and_a_far_one_by_bounded_moves() -> None:
    matrix = torch.tensor([[2.0, 1.0], [0.5, 3.0]], dtype=torch.float64)
    goal = torch.tensor([[0.3, -0.2], [3.0, 0.0]], dtype=torch.float64)
    value, values = counted(lambda u, index: (u - goal[index]) @ matrix.T)
    wide = (torch.full((2,), -9.0).double(), torch.full((2,), 9.0).double())
    start = torch.zeros(2, 2, dtype=torch.float64)
    found, solved = quasi_newton(value, lambda u, _: matrix.expand(u.shape[0], 2, 2), start, wide)
    assert bool(solved.all())
    torch.testing.assert_close(found, goal)
    # the start, one move for the first, then half a unit each for the second
    assert values == [2, 2] + [1] * 5


def test_a_singular_problem_is_given_up_where_it_started() -> None:
    start = torch.full((1, 2), 0.25, dtype=torch.float64)
    limits = (torch.zeros(2).double(), torch.ones(2).double())
    found, solved = quasi_newton(
        lambda u, _: 1.0 + 0.0 * u,
        lambda u, _: torch.zeros(u.shape[0], 2, 2).double(),
        start,
        limits,
    )
    assert not bool(solved.any())
    assert torch.equal(found, start)


def test_a_bracket_is_closed_in_few_evaluations() -> None:
    value, values = counted(lambda x: torch.tanh(5.0 * x) - 0.3)
    low, high = torch.tensor([-1.0, -4.0]).double(), torch.tensor([1.5, 1.0]).double()
    found = bracketed_root(value, low, high, tolerance=1e-10)
    assert found.tolist() == pytest.approx([math.atanh(0.3) / 5.0] * 2, abs=1e-9)
    assert len(values) <= 2 + 22


@pytest.mark.parametrize(
    ("function", "low", "high", "root"),
    [
        (lambda x: torch.exp(x) - 5.0, -3.0, 4.0, math.log(5.0)),
        (lambda x: 0.5 - torch.exp(-x), -1.0, 4.0, math.log(2.0)),
    ],
)
def test_an_end_that_stays_put_counts_half_so_that_curved_functions_are_as_quick(
    function: Callable[[Tensor], Tensor], low: float, high: float, root: float
) -> None:
    """Convex and concave: the chords alone would take twice as many evaluations."""
    value, values = counted(function)
    ends = torch.tensor([low]).double(), torch.tensor([high]).double()
    found = bracketed_root(value, *ends, tolerance=1e-6, evaluations=60)
    assert float(found) == pytest.approx(root, abs=1e-6)
    assert len(values) <= 14


def test_every_third_trial_halves_the_bracket_of_a_steep_function() -> None:
    """Chords alone would take 106 evaluations."""
    value, values = counted(lambda x: torch.exp(60.0 * x) - 1e3)
    ends = torch.tensor([-1.0]).double(), torch.tensor([1.0]).double()
    found = bracketed_root(value, *ends, tolerance=1e-6, evaluations=200)
    assert float(found) == pytest.approx(math.log(1e3) / 60.0, abs=1e-6)
    assert len(values) <= 36


def test_a_root_at_an_end_costs_no_trial() -> None:
    value, values = counted(lambda x: x - torch.tensor([0.0, 1.0, 2.0, -2.0]).double())
    ends = torch.zeros(4).double(), torch.ones(4).double()
    assert bracketed_root(value, *ends, tolerance=1e-9).tolist() == [0.0, 1.0, 1.0, 0.0]
    assert len(values) == 2


@pytest.mark.parametrize("start", [None, 0.01])
def test_a_sinkage_is_found_in_ten_evaluations_of_the_forces(start: float | None) -> None:
    calls: list[int] = []

    class Counting(WheelGround):
        def forces(self, slip: Tensor, sinkage: Tensor) -> Tensor:
            calls.append(1)
            return super().forces(slip, sinkage)

    plain = WheelGround.of(ROVER, SOIL.constants(), SOIL.strength(), 8)
    wheel = Counting(plain.radius, plain.width, plain.constants, plain.strength, plain.nodes)
    load = torch.tensor([40.0, 110.0, 300.0]).double()
    slip = torch.tensor([0.1, 0.4, -0.2]).double()
    begun = None if start is None else torch.full_like(load, start)
    depth = equilibrium_sinkage(wheel, slip, load, begun)
    torch.testing.assert_close(plain.forces(slip, depth)[:, 0], load, rtol=1e-9, atol=0.0)
    assert len(calls) <= 10


def test_wheels_that_carry_nothing_or_too_much_are_not_searched_for() -> None:
    calls: list[int] = []

    class Counting(WheelGround):
        def forces(self, slip: Tensor, sinkage: Tensor) -> Tensor:
            calls.append(1)
            return super().forces(slip, sinkage)

    plain = WheelGround.of(ROVER, SOIL.constants(), SOIL.strength(), 8)
    wheel = Counting(plain.radius, plain.width, plain.constants, plain.strength, plain.nodes)
    load = torch.tensor([0.0, 1e9, -3.0]).double()
    depth = equilibrium_sinkage(wheel, torch.zeros_like(load), load) / ROVER.wheel_radius
    assert depth.tolist() == pytest.approx([SHALLOWEST, DEEPEST, SHALLOWEST])
    assert len(calls) == 2  # the ends, and where the search begins


@pytest.mark.parametrize(
    ("count", "lowest", "groups"), [(FEW - 1, -0.3, 1), (FEW, -0.3, 2), (FEW, 0.0, 1)]
)
def test_braked_wheels_are_treated_apart_where_they_are_many(
    count: int, lowest: float, groups: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []
    forces = ContactInputs.forces

    def counting(self: ContactInputs, *arguments: Any) -> Tensor:
        calls.append(self.slip.numel())
        return forces(self, *arguments)

    monkeypatch.setattr(ContactInputs, "forces", counting)
    slip = torch.linspace(lowest, 0.5, count, dtype=torch.float64)
    wheel = WheelGround.of(ROVER, SOIL.constants(), SOIL.strength(), 6)
    assert wheel.forces(slip, torch.full_like(slip, 0.01)).shape == (count, 3)
    assert (len(calls), sum(calls)) == (groups, count)


def test_many_braked_wheels_at_a_slip_angle_get_the_forces_of_each() -> None:
    """With their lateral force; many are treated in two groups."""
    count = 300
    slip = torch.linspace(-0.4, 0.8, count, dtype=torch.float64)
    angle = torch.linspace(-0.5, 0.5, count, dtype=torch.float64)
    parts = [
        WheelGround(
            ROVER.wheel_radius, ROVER.wheel_width, SOIL.constants(), SOIL.strength(),
            WheelGround.of(ROVER, SOIL.constants(), SOIL.strength(), 12).nodes,
            slip_angle=angle[index],
        )
        for index in (slice(None), slice(0, 150), slice(150, None))
    ]  # fmt: skip
    sinkage = torch.full_like(slip, 0.015)
    whole = parts[0].forces(slip, sinkage)
    assert whole.shape == (count, 4)
    apart = torch.cat(
        [parts[1].forces(slip[:150], sinkage[:150]), parts[2].forces(slip[150:], sinkage[150:])]
    )
    torch.testing.assert_close(whole, apart, rtol=1e-5, atol=1e-5)


def test_a_wheel_that_is_braked_at_the_end_of_its_slip_still_has_a_solution() -> None:
    step = step_equations()
    torque = torch.full((BATCH, A), 5.0, dtype=torch.float64)
    torque[:, 1] = torch.tensor([-8.0, -10.0, -12.0])
    found = solve_torques(step, torque, start_depth(), torch.full((BATCH, A), 0.2).double())
    assert bool(found.solved.all())
    assert found.slip[:, 1].tolist() == [MIN_SLIP] * BATCH
    assert found.obeyed.tolist() == [[True, False, True]] * BATCH
    assert float(step.imbalance(found.forces, found.velocity).abs().max()) < 1e-8


def test_balances_are_in_units_of_the_weight_and_of_weight_times_wheelbase() -> None:
    wheelbase = ROVER.axle_x[0] - ROVER.axle_x[-1]
    expected = [ROVER.weight * unit for unit in (1.0, 1.0, wheelbase, wheelbase)]
    assert step_equations().scale.tolist() == pytest.approx(expected)
