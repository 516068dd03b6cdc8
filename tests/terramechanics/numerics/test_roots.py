# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Batched root finding against scipy and against known answers."""

import math

import pytest
import torch
from scipy import optimize
from torch import Tensor

from terramechanics.numerics.roots import bracketed_root, damped_newton, quasi_newton


def tensor(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def test_a_bracketed_root_is_that_of_scipy() -> None:
    targets = tensor(-0.9, -0.2, 0.0, 0.3, 0.99)
    found = bracketed_root(
        lambda x: torch.tanh(3.0 * x) - targets,
        tensor(*[-2.0] * 5),
        tensor(*[3.0] * 5),
        tolerance=1e-13,
    )
    expected = [
        optimize.brentq(lambda x, t=target: math.tanh(3.0 * x) - t, -2.0, 3.0, xtol=1e-14)
        for target in targets.tolist()
    ]
    assert found.tolist() == pytest.approx(expected, abs=1e-11)


def test_a_function_without_root_ends_at_the_nearer_end() -> None:
    found = bracketed_root(
        lambda x: x - tensor(-5.0, 5.0, 0.25),
        tensor(0.0, 0.0, 0.0),
        tensor(1.0, 1.0, 1.0),
        tolerance=1e-12,
    )
    assert found.tolist() == pytest.approx([0.0, 1.0, 0.25])


def test_a_steep_function_that_holds_one_end_still_converges() -> None:
    found = bracketed_root(
        lambda x: torch.exp(20.0 * x) - 2.0,
        tensor(-5.0),
        tensor(2.0),
        tolerance=1e-13,
        evaluations=100,
    )
    assert float(found) == pytest.approx(math.log(2.0) / 20.0, abs=1e-12)


def residual(u: Tensor, index: Tensor) -> Tensor:
    """x^2 + y^2 = radius^2, y = x e^x, another radius in every episode."""
    radius = 1.0 + index.to(u.dtype)
    return torch.stack(
        [u[:, 0] ** 2 + u[:, 1] ** 2 - radius**2, u[:, 1] - u[:, 0] * torch.exp(u[:, 0])], dim=-1
    )


def jacobian(u: Tensor, index: Tensor) -> Tensor:
    x, y = u.unbind(-1)
    del index
    rows = [
        torch.stack([2.0 * x, 2.0 * y], dim=-1),
        torch.stack([-(1.0 + x) * torch.exp(x), torch.ones_like(x)], dim=-1),
    ]
    return torch.stack(rows, dim=-2)


def test_quasi_newton_solves_every_episode() -> None:
    start = torch.full((6, 2), 0.5, dtype=torch.float64)
    found, solved = quasi_newton(residual, jacobian, start, (tensor(0.0, 0.0), tensor(10.0, 10.0)))
    assert bool(solved.all())
    for episode in range(6):
        radius = episode + 1.0
        # Along y = x e^x one unknown is left.
        x = optimize.brentq(
            lambda x, r=radius: math.hypot(x, x * math.exp(x)) - r, 0.0, 10.0, xtol=1e-14
        )
        expected = [x, x * math.exp(x)]
        assert found[episode].tolist() == pytest.approx(expected, abs=1e-9)


def test_quasi_newton_says_where_there_is_no_solution() -> None:
    start = torch.full((3, 2), 0.5, dtype=torch.float64)
    found, solved = quasi_newton(residual, jacobian, start, (tensor(0.0, 0.0), tensor(1.0, 1.2)))
    assert solved.tolist() == [True, False, False]
    assert bool(torch.isfinite(found).all())
    assert bool((found <= tensor(1.0, 1.2)).all())


def test_an_unsolvable_equation_ends_after_24_moves() -> None:
    asked = []

    def never(u: Tensor, index: Tensor) -> Tensor:
        asked.append(index)
        return u**2 + 1.0

    limits = (tensor(-2.0), tensor(2.0))
    _, solved = quasi_newton(never, lambda u, _: 2.0 * u.unsqueeze(-1), tensor(0.7)[None], limits)
    assert not bool(solved)
    assert len(asked) == 1 + 24


def test_damped_newton_finds_the_root_of_a_force_that_saturates() -> None:
    """From where Newton's own moves grow without end; each of five episodes is another one."""

    def friction(u: Tensor, index: Tensor) -> Tensor:
        return torch.tanh(50.0 * (u - 0.1 * index.to(u.dtype).unsqueeze(-1)))

    def slope(u: Tensor, index: Tensor) -> Tensor:
        return (50.0 * (1.0 - friction(u, index) ** 2)).unsqueeze(-1)

    start = torch.full((5, 1), 0.45, dtype=torch.float64)
    start[0] = 0.05
    limits = tensor(-1.0), tensor(1.0)
    found, solved = damped_newton(friction, slope, start, limits)
    assert solved[[0, 4]].tolist() == [True, True]
    assert found[[0, 4], 0].tolist() == pytest.approx([0.0, 0.4], abs=1e-10)
    assert start[0, 0] == 0.05  # nobody wrote into the start
    assert bool((found[~solved].abs() <= 1.0).all())


def test_damped_newton_solves_every_episode() -> None:
    start = torch.full((6, 2), 0.5, dtype=torch.float64)
    limits = tensor(0.0, 0.0), tensor(10.0, 10.0)
    found, solved = damped_newton(residual, jacobian, start, limits)
    assert bool(solved.all())
    torch.testing.assert_close(found, quasi_newton(residual, jacobian, start, limits)[0])
