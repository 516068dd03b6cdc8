# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The contact law scm against scipy's integrals of its definition, and against Chrono's forces."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.integrate import quad

from studies.foreign.logs import read_log
from terramechanics.contact.laws import contact_law
from terramechanics.contact.scm import Rut, scm_forces, shear_left
from terramechanics.contact.stresses import entry_angle, quadrature, wheel_forces
from terramechanics.presets import load_soil

R, B = 0.13, 0.16
REBOUND = 0.03
SAND = load_soil("loose_sand").with_values(law="scm", c1=REBOUND, c2=0.0)
NONE = (0.0, 0.0)
RUTS = (NONE, (0.012, 0.008), (0.0178, 0.02), (0.025, 0.01))
SLIPS = (-0.4, -0.05, 0.0, 0.004, 0.03, 0.2, 0.6)


def number(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def integrals(slip: float, sinkage: float, rut: tuple[float, float], rebound: float) -> np.ndarray:
    """Integrate the stresses of the definition node by node of the ground; rows N, T, M."""
    k, n = SAND.k_c / B + SAND.k_phi, SAND.n
    depth, shear = rut
    deepest = max(sinkage, depth)
    bottom, rut_surface = deepest * (1.0 - rebound), depth * (1.0 - rebound)
    front = math.sqrt(R**2 - (R - max(sinkage - rut_surface, 1e-3 * sinkage)) ** 2)
    rear = -math.sqrt(max(R**2 - (R - max(sinkage - bottom, 0.0)) ** 2, 0.0))

    def height(x: float) -> float:
        return sinkage - R + math.sqrt(R**2 - x**2)

    def pressure(x: float) -> float:
        d = height(x)
        if x < 0.0:
            return k * deepest**n * min(max((d - bottom) / (deepest - bottom), 0.0), 1.0)
        if d < depth:
            return k * depth**n * min(max((d - rut_surface) / (depth - rut_surface), 0.0), 1.0)
        return k * max(d, 0.0) ** n

    def speed(x: float) -> float:  # of the rim along the ground, over that of the wheel
        return 1.0 - math.sqrt(R**2 - x**2) / R / (1.0 - slip)

    turn = R * math.sin(math.acos(1.0 - slip)) if slip > 0.0 else 0.0
    bore = math.sqrt(R**2 - (R - max(sinkage - depth, 0.0)) ** 2)
    kinks = sorted({0.0, turn, -turn, bore, rear, front})
    kinks = [x for x in kinks if rear <= x <= front]

    def over(function: Callable[[float], float], low: float, high: float) -> float:
        cuts = [low, *(x for x in kinks if low < x < high), high]
        return sum(
            quad(function, a, b, epsabs=1e-12, epsrel=1e-10, limit=200)[0]
            for a, b in itertools.pairwise(cuts)
        )

    def mobilised(x: float) -> float:
        j = shear + over(lambda y: abs(speed(y)), x, front)
        return -math.copysign(-math.expm1(-j / SAND.shear_modulus), speed(x))

    def arm(x: float) -> float:
        return math.sqrt(R**2 - x**2)

    found = np.zeros((3, 3))
    found[0, 2] = over(pressure, rear, front)
    found[1, 0] = over(mobilised, rear, front)
    found[1, 1] = over(lambda x: pressure(x) * mobilised(x), rear, front)
    found[2, 0] = over(lambda x: mobilised(x) * arm(x), rear, front)
    found[2, 1] = over(lambda x: pressure(x) * mobilised(x) * arm(x), rear, front)
    found[2, 2] = over(lambda x: pressure(x) * x, rear, front)
    return B * found


@pytest.mark.parametrize("rut", RUTS)
@pytest.mark.parametrize("slip", SLIPS)
def test_forces_are_those_of_the_definition(slip: float, rut: tuple[float, float]) -> None:
    known = None if rut == NONE else Rut(number(rut[0]), number(rut[1]))
    found = scm_forces(
        number(slip), number(0.018), SAND.constants(), R, B, quadrature(24), rut=known
    )
    expected = integrals(slip, 0.018, rut, REBOUND)
    scale = np.array([B * R, 100.0, 100.0])  # of T by c, N by tan phi, N
    np.testing.assert_allclose(found.numpy() / scale, expected / scale, atol=2e-6)


@pytest.mark.parametrize("slip", SLIPS)
def test_few_nodes_are_enough(slip: float) -> None:
    rut = Rut(number(0.0145), number(0.01))
    few, many = (
        scm_forces(number(slip), number(0.018), SAND.constants(), R, B, quadrature(points), rut=rut)
        for points in (6, 48)
    )
    scale = torch.tensor([B * R, 100.0, 100.0], dtype=torch.float64)
    torch.testing.assert_close(few / scale, many / scale, rtol=0.0, atol=2e-4)


def test_an_exit_angle_is_added_to_the_rebound() -> None:
    stiff = SAND.with_values(c1=0.01).constants()
    angle = entry_angle(number(0.02 * 0.018), R)
    extended = scm_forces(number(0.2), number(0.018), stiff, R, B, quadrature(), angle)
    both = scm_forces(number(0.2), number(0.018), SAND.constants(), R, B, quadrature())
    torch.testing.assert_close(extended, both)


def test_a_rut_of_nothing_is_fresh_ground() -> None:
    slip = torch.linspace(-0.4, 0.8, 25, dtype=torch.float64)
    sinkage = torch.full_like(slip, 0.018)
    none = Rut(torch.zeros_like(slip), torch.zeros_like(slip))
    fresh = scm_forces(slip, sinkage, SAND.constants(), R, B, quadrature(24))
    found = scm_forces(slip, sinkage, SAND.constants(), R, B, quadrature(24), rut=none)
    torch.testing.assert_close(found, fresh, rtol=1e-6, atol=1e-7)


def test_a_passing_wheel_leaves_the_shear_that_it_does() -> None:
    theta_1 = math.acos(1.0 - 0.018 / R)
    for slip in (-0.3, 0.1, 0.5):
        expected = quad(
            lambda t, i=slip: abs(1.0 - math.cos(t) / (1.0 - i)) * R * math.cos(t), 0.0, theta_1,
            limit=400,
        )[0]  # fmt: skip
        found = float(shear_left(number(slip), number(0.018), R))
        assert found == pytest.approx(expected, rel=1e-4)


def test_the_law_by_name_is_scripted_and_the_same_numbers() -> None:
    slip = torch.linspace(-0.4, 0.9, 27, dtype=torch.float64)
    sinkage = torch.full_like(slip, 0.02)
    rut = Rut(torch.full_like(slip, 0.015), torch.full_like(slip, 0.004))
    arguments = (slip, sinkage, SAND.constants(), R, B, quadrature())
    for known in (None, rut):
        named = contact_law("scm")(*arguments, rut=known)
        assert torch.equal(named, scm_forces(*arguments, rut=known))
    assert torch.equal(contact_law("wong_reece")(*arguments), wheel_forces(*arguments))


def test_a_side_force_is_refused() -> None:
    with pytest.raises(ValueError, match="no side force"):
        contact_law("scm")(
            number(0.1), number(0.01), SAND.constants(), R, B, quadrature(), None, number(0.1)
        )


@pytest.mark.parametrize("log", ["A_cruise_scm", "B_slopes_scm", "B_differential_scm"])
def test_forces_are_those_that_chrono_computed_for_front_wheels(log: str) -> None:
    """Its damping (10 kPa s/m) is not in the law: up to 4 % of the load at 0.13 m/s."""
    read = read_log(log)

    def mean(name: str) -> torch.Tensor:
        sides = (read.columns[f"front_{side}_{name}"] for side in ("left", "right"))
        return torch.from_numpy(0.5 * sum(sides))

    cohesion, tan_phi = read.truth
    slip, sinkage = mean("slip"), mean("sinkage")
    constants = SAND.constants().expand(len(slip), 6).clone()
    constants[:, 4] = (SAND.k_c / B + SAND.k_phi) * sinkage ** (SAND.n - 1.0) / 5e7
    law = scm_forces(slip, sinkage, constants, R, B, quadrature())
    forces = law[..., 0] * cohesion + law[..., 1] * tan_phi + law[..., 2]
    true = torch.stack([mean("load"), mean("drawbar"), mean("torque")], -1)
    error = forces.mean(0) - true.mean(0)
    assert abs(error[0]) < 0.04 * true[:, 0].mean()
    assert abs(error[1]) < 0.3
    assert abs(error[2]) < 0.17
    assert (forces - true).square().mean(0).sqrt()[1] < 2.1
