# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Contact forces against scipy's adaptive integration of the stresses of the literature."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq

from terramechanics.contact.laws import contact_law
from terramechanics.contact.stresses import (
    entry_angle,
    in_range,
    quadrature,
    shear_reversal_angle,
    wheel_forces,
    wheel_forces_linear_stress,
)
from terramechanics.presets import load_rover, load_soil, rover_names, soil_names
from terramechanics.terrain.soil import Soil

SLIPS = (-0.4, -0.2, -0.05, -0.003, 0.0, 0.02, 0.2, 0.5, 0.9)
SINKAGES = {
    "paper_rover": (1.4e-4, 0.005, 0.03),
    "mars_rover": (0.003, 0.018, 0.06),
    "four_wheel_rover": (0.0015, 0.02, 0.06),
}
TYPICAL = np.array([1000.0, 0.6, 1.0])  # c [Pa], tan phi, 1

Stress = Callable[[float], float]


def tensor(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def stresses(
    slip: float, sinkage: float, soil: Soil, radius: float, width: float
) -> tuple[Stress, Stress, list[float]]:
    """sigma and E as functions of theta, and the angles at which one of them has a kink."""
    theta_1 = math.acos(1.0 - sinkage / radius)
    theta_m = (soil.c1 + soil.c2 * slip) * theta_1

    def sigma(theta: float) -> float:
        mapped = theta if theta > theta_m else theta_1 - theta * (theta_1 - theta_m) / theta_m
        return (soil.k_c / width + soil.k_phi) * max(
            radius * (math.cos(mapped) - math.cos(theta_1)), 0.0
        ) ** soil.n

    def displacement(theta: float) -> float:
        return radius * ((theta_1 - theta) - (1.0 - slip) * (math.sin(theta_1) - math.sin(theta)))

    def mobilised(theta: float) -> float:
        j = displacement(theta)
        return math.copysign(-math.expm1(-abs(j) / soil.shear_modulus), j)

    grid = np.linspace(0.0, theta_1 * (1.0 - 1e-5), 500)
    values = [displacement(theta) for theta in grid]
    crossings = [
        brentq(displacement, a, b)
        for a, b, u, v in zip(grid, grid[1:], values, values[1:], strict=False)
        if u * v < 0.0
    ]
    return sigma, mobilised, sorted({0.0, theta_m, theta_1, *crossings})


def integrated(
    slip: float, sinkage: float, soil: Soil, radius: float, width: float
) -> NDArray[np.float64]:
    """Return the nine coefficients by adaptive integration."""
    sigma, e, kinks = stresses(slip, sinkage, soil, radius, width)

    def total(f: Stress) -> float:
        return sum(
            quad(f, a, b, epsabs=0.0, epsrel=1e-11, limit=200)[0]
            for a, b in itertools.pairwise(kinks)
        )

    sin, cos = math.sin, math.cos
    normal = [
        total(lambda t: e(t) * sin(t)),
        total(lambda t: sigma(t) * e(t) * sin(t)),
        total(lambda t: sigma(t) * cos(t)),
    ]
    traction = [
        total(lambda t: e(t) * cos(t)),
        total(lambda t: sigma(t) * e(t) * cos(t)),
        -total(lambda t: sigma(t) * sin(t)),
    ]
    torque = [radius * total(e), radius * total(lambda t: sigma(t) * e(t)), 0.0]
    return radius * width * np.array([normal, traction, torque])


@pytest.mark.filterwarnings(
    "ignore::scipy.integrate.IntegrationWarning"
)  # 1e-11 is more than some integrals can have
@pytest.mark.parametrize("rover_name", rover_names())
@pytest.mark.parametrize("soil_name", soil_names())
def test_quadrature_agrees_with_adaptive_integration_on_every_preset(
    rover_name: str, soil_name: str
) -> None:
    rover, soil = load_rover(rover_name), load_soil(soil_name)
    compared = 0
    for sinkage in SINKAGES[rover_name]:
        for slip in SLIPS:
            if not in_range(tensor(slip), tensor(sinkage), soil.constants(), rover.wheel_radius):
                continue
            expected = (
                integrated(slip, sinkage, soil, rover.wheel_radius, rover.wheel_width) * TYPICAL
            )
            scale = np.abs(expected[:2]).max() * np.array([[1.0], [1.0], [rover.wheel_radius]])
            for points, tolerance in ((6, 1e-5), (24, 1e-8)):
                found = wheel_forces(
                    tensor(slip),
                    tensor(sinkage),
                    soil.constants(),
                    rover.wheel_radius,
                    rover.wheel_width,
                    quadrature(points),
                )
                assert np.abs((found.numpy() * TYPICAL - expected) / scale).max() < tolerance, (
                    slip,
                    sinkage,
                    points,
                )
            compared += 1
    assert compared >= 18


def test_closed_form_equals_the_integrals_of_linear_stresses() -> None:
    soil, radius, width, sinkage, slip = load_soil("loose_sand"), 0.4, 0.1, 0.02, 0.3
    theta_1 = math.acos(1.0 - sinkage / radius)
    theta_m = (soil.c1 + soil.c2 * slip) * theta_1
    cohesion, tan_phi = 1300.0, 0.55
    sigma_m = (soil.k_c / width + soil.k_phi) * (
        radius * (math.cos(theta_m) - math.cos(theta_1))
    ) ** soil.n
    j = radius * (theta_1 - theta_m - (1.0 - slip) * (math.sin(theta_1) - math.sin(theta_m)))
    tau_m = (cohesion + sigma_m * tan_phi) * -math.expm1(-j / soil.shear_modulus)

    def linear(theta: float, peak: float, rear: float) -> float:
        if theta > theta_m:
            return peak * (theta_1 - theta) / (theta_1 - theta_m)
        return rear + (peak - rear) * theta / theta_m

    def total(f: Stress) -> float:
        return radius * width * (quad(f, 0.0, theta_m)[0] + quad(f, theta_m, theta_1)[0])

    expected = [
        total(
            lambda t: (
                linear(t, sigma_m, 0.0) * math.cos(t) + linear(t, tau_m, cohesion) * math.sin(t)
            )
        ),
        total(
            lambda t: (
                linear(t, tau_m, cohesion) * math.cos(t) - linear(t, sigma_m, 0.0) * math.sin(t)
            )
        ),
        radius * total(lambda t: linear(t, tau_m, cohesion)),
    ]
    found = wheel_forces_linear_stress(
        tensor(slip), tensor(sinkage), soil.constants(), radius, width
    ).numpy()
    np.testing.assert_allclose(found @ [cohesion, tan_phi, 1.0], expected, rtol=1e-10)


def test_a_wheel_that_does_not_touch_feels_nothing() -> None:
    soil = load_soil("loose_sand")
    forces = wheel_forces(tensor(0.2), tensor(0.0), soil.constants(), 0.13, 0.16, quadrature())
    assert (
        float(forces.abs().max()) < 0.05
    )  # clamped to a sinkage of 1e-12 of the wheel; c is in Pa


def test_signs_are_those_of_the_paper() -> None:
    """A driven wheel is pushed forward, carried and braked; a braked one is pulled back."""
    soil = load_soil("loose_sand")
    theta = torch.tensor([1000.0, 0.6, 1.0], dtype=torch.float64)
    normal, traction, torque = (
        wheel_forces(tensor(0.4), tensor(0.01), soil.constants(), 0.13, 0.16, quadrature()) @ theta
    )
    assert min(normal, traction, torque) > 0.0
    normal, traction, torque = (
        wheel_forces(tensor(-0.4), tensor(0.01), soil.constants(), 0.13, 0.16, quadrature()) @ theta
    )
    assert normal > 0.0
    assert max(traction, torque) < 0.0


def test_entry_angle_keeps_its_digits_at_shallow_sinkage() -> None:
    sinkage = 1e-7
    assert float(entry_angle(tensor(sinkage), 0.4)) == pytest.approx(
        math.sqrt(2 * sinkage / 0.4) * (1 + sinkage / (12 * 0.4)), rel=1e-12
    )


@pytest.mark.parametrize("slip", [-0.3, -0.1, -0.03])
def test_shear_changes_its_sign_where_the_mean_cosine_says(slip: float) -> None:
    theta_1 = 0.9
    theta = float(shear_reversal_angle(tensor(slip), tensor(theta_1)))
    j = theta_1 - theta - (1.0 - slip) * (math.sin(theta_1) - math.sin(theta))
    assert theta in (0.0, pytest.approx(theta_1, rel=1e-5)) or abs(j) < 1e-12


@pytest.mark.parametrize(
    ("slip", "sinkage"),
    [(math.nan, 0.01), (0.1, math.nan), (0.1, -0.001), (0.1, 0.13), (1.0, 0.01), (-0.9, 0.01)],
)
def test_values_outside_the_models_range_are_told(slip: float, sinkage: float) -> None:
    assert not bool(
        in_range(tensor(slip), tensor(sinkage), load_soil("loose_sand").constants(), 0.13)
    )


def test_scripted_and_plain_forces_are_the_same_numbers() -> None:
    soil = load_soil("regolith")
    slip = torch.linspace(-0.4, 0.9, 27, dtype=torch.float64)
    sinkage = torch.full_like(slip, 0.02)
    arguments = (slip, sinkage, soil.constants(), 0.13, 0.16, quadrature())
    assert torch.equal(torch.jit.script(wheel_forces)(*arguments), wheel_forces(*arguments))


def test_linear_stresses_of_many_wheels_are_those_of_each() -> None:
    soil = load_soil("loose_sand")
    slip, sinkage = (
        torch.tensor([0.1, 0.3, 0.5]).double(),
        torch.tensor([0.01, 0.02, 0.03]).double(),
    )
    together = wheel_forces_linear_stress(slip, sinkage, soil.constants(), 0.4, 0.1)
    for index in range(3):
        alone = wheel_forces_linear_stress(slip[index], sinkage[index], soil.constants(), 0.4, 0.1)
        torch.testing.assert_close(together[index], alone, rtol=1e-12, atol=0.0)


def test_linear_stresses_are_a_contact_law_by_name() -> None:
    soil, slip = load_soil("loose_sand"), torch.linspace(-0.3, 0.9, 7, dtype=torch.float64)
    arguments = (slip, torch.full_like(slip, 0.02), soil.constants(), 0.4, 0.1)
    law = contact_law("linear_stress")
    assert torch.equal(law(*arguments, quadrature()), wheel_forces_linear_stress(*arguments))
    with pytest.raises(ValueError, match="no exit angle and no slip angle"):
        law(*arguments, quadrature(), exit_angle=slip)
    with pytest.raises(ValueError, match="no exit angle and no slip angle"):
        law(*arguments, quadrature(), slip_angle=slip)
