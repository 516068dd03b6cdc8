# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Limits of the contact model, its angles and its quadrature; ranges of effects and hills."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate
from torch import Tensor

from rover_parameters.records import ConfigError
from terramechanics.contact.stresses import (
    MAX_SLIP,
    MIN_SLIP,
    entry_angle,
    in_range,
    quadrature,
    shear_reversal_angle,
    stress_ratio,
    wheel_forces,
    wheel_forces_linear_stress,
)
from terramechanics.effects import EFFECTS, describe, make_effect
from terramechanics.effects.simulated import SimulatedEffect
from terramechanics.effects.vehicle import ExtraMass
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs, Situation
from terramechanics.terrain.profile import MEAN_SLOPE, STEEPEST, random_hills
from terramechanics.vehicle.climbing import climb

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
R, B = ROVER.wheel_radius, ROVER.wheel_width


def number(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)


def up(value: float) -> float:
    return math.nextafter(value, math.inf)


def down(value: float) -> float:
    return math.nextafter(value, -math.inf)


@given(share=st.floats(1e-9, 0.999))
def test_the_entry_angle_is_where_the_rim_meets_the_surface(share: float) -> None:
    assert math.cos(float(entry_angle(number(share * R), R))) == pytest.approx(
        1.0 - share, abs=1e-14
    )


def test_a_sinkage_beyond_the_wheel_has_the_entry_angle_of_its_limit() -> None:
    """An axle at the surface is a right angle; a wheel that does not touch has nearly none."""
    deep = float(entry_angle(number(5.0 * R), R))
    assert deep == pytest.approx(math.pi / 2.0, abs=1e-4)
    assert deep < math.pi / 2.0
    assert 0.0 < float(entry_angle(number(-1.0), R)) < 1e-5


@pytest.mark.parametrize("points", [2, 3, 6])
def test_the_quadrature_is_exact_for_polynomials_of_its_degree(points: int) -> None:
    nodes, weights = quadrature(points).numpy()
    for degree in range(2 * points):
        assert weights @ nodes**degree == pytest.approx(1.0 / (degree + 1.0), rel=1e-13)
    assert weights @ nodes ** (2 * points) != pytest.approx(1.0 / (2.0 * points + 1.0), rel=1e-9)


LIMITS = {
    ("slip", MIN_SLIP): True,
    ("slip", down(MIN_SLIP)): False,
    ("slip", MAX_SLIP): True,
    ("slip", up(MAX_SLIP)): False,
    ("sinkage", 0.0): False,
    ("sinkage", up(0.0)): True,
    ("sinkage", down(R)): True,
    ("sinkage", R): False,
    ("slip", math.nan): False,
    ("sinkage", math.nan): False,
}


@pytest.mark.parametrize(("name", "value"), LIMITS)
def test_the_model_holds_up_to_its_limits(name: str, value: float) -> None:
    inputs = {"slip": 0.2, "sinkage": 0.01} | {name: value}
    constants = SOIL.constants()
    constants[5] = 0.0  # so that the slip moves the largest stress out of the contact nowhere
    found = in_range(number(inputs["slip"]), number(inputs["sinkage"]), constants, R)
    assert bool(found) == LIMITS[name, value]


def test_the_largest_stress_lies_between_the_ends_of_the_contact() -> None:
    constants = SOIL.constants()
    for c1, c2, holds in (
        (0.5, 0.0, True),
        (0.0, 0.0, False),
        (1.0, 0.0, False),
        (0.9, 0.6, False),
    ):
        constants[4], constants[5] = c1, c2
        assert float(stress_ratio(number(0.2), constants)) == pytest.approx(c1 + 0.2 * c2)
        assert bool(in_range(number(0.2), number(0.01), constants, R)) == holds


@given(slip=st.floats(-0.5, -0.01), share=st.floats(0.02, 0.6))
def test_the_shear_changes_its_direction_where_its_integral_vanishes(
    slip: float, share: float
) -> None:
    """j(theta) = r [theta_1 - theta - (1 - i)(sin theta_1 - sin theta)]

    Where it has one sign only, an end of the contact is the answer.
    """
    theta_1 = math.acos(1.0 - share)
    found = float(shear_reversal_angle(number(slip), number(theta_1)))
    assert 0.0 <= found <= theta_1

    def displacement(theta: float) -> float:
        return theta_1 - theta - (1.0 - slip) * (math.sin(theta_1) - math.sin(theta))

    near_entry = theta_1 * (1.0 - 1e-3)
    if displacement(0.0) * displacement(near_entry) < 0.0:
        assert displacement(found) == pytest.approx(0.0, abs=1e-6)
    else:
        assert found < 1e-9 or found > theta_1 * (1.0 - 1e-2)


@pytest.mark.parametrize("slip", [-0.3, -0.05, 0.0, 0.15, 0.8])
@pytest.mark.parametrize("exit_angle", [None, 0.1])
def test_forces_are_the_integrals_of_the_stresses(slip: float, exit_angle: float | None) -> None:
    """By scipy, from the definitions of the module: behind theta_m the stress is mirrored."""
    sinkage, constants = 0.015, SOIL.constants()
    n, k_c, k_phi, shear, c1, c2 = constants.tolist()
    first = math.acos(1.0 - sinkage / R)
    largest = first * (c1 + c2 * slip)
    last = -(exit_angle or 0.0)

    def normal(theta: float) -> float:
        share = (theta - last) / (largest - last)
        place = theta if theta > largest else first - share * (first - largest)
        height = R * (math.cos(place) - math.cos(first))
        return float((k_c / B + k_phi) * max(height, 0.0) ** n)

    def mobilised(theta: float) -> float:
        j = R * (first - theta - (1.0 - slip) * (math.sin(first) - math.sin(theta)))
        return math.copysign(1.0 - math.exp(-abs(j) / shear), j)

    def total(*factors: Callable[[float], float]) -> float:
        def integrand(theta: float) -> float:
            return float(np.prod([factor(theta) for factor in factors]))

        kink = float(shear_reversal_angle(number(slip), number(first))) if slip < 0.0 else largest
        ends = sorted({last, min(largest, kink), max(largest, kink), first})
        return sum(
            integrate.quad(integrand, low, high, epsabs=1e-12, limit=200)[0]
            for low, high in itertools.pairwise(ends)
        )

    expected = R * B * np.array(
        [
            [
                total(mobilised, math.sin),
                total(normal, mobilised, math.sin),
                total(normal, math.cos),
            ],
            [
                total(mobilised, math.cos),
                total(normal, mobilised, math.cos),
                -total(normal, math.sin),
            ],
            [R * total(mobilised), R * total(normal, mobilised), 0.0],
        ]
    )  # fmt: skip
    given_exit = None if exit_angle is None else number(exit_angle)
    found = wheel_forces(number(slip), number(sinkage), constants, R, B, quadrature(24), given_exit)
    scale = np.abs(expected).max(0)
    np.testing.assert_allclose(found.numpy() / scale, expected / scale, atol=2e-6)


def test_linear_stresses_are_the_integrals_of_triangles() -> None:
    """sigma and tau rise linearly from the entry; behind theta_m sigma falls to 0 and tau to c."""
    slip, sinkage, constants = 0.25, 0.02, SOIL.constants()
    n, k_c, k_phi, shear, c1, c2 = constants.tolist()
    first = math.acos(1.0 - sinkage / R)
    largest = first * (c1 + c2 * slip)
    top = (k_c / B + k_phi) * (R * (math.cos(largest) - math.cos(first))) ** n
    j = R * (first - largest - (1.0 - slip) * (math.sin(first) - math.sin(largest)))
    a = 1.0 - math.exp(-j / shear)
    found = wheel_forces_linear_stress(number(slip), number(sinkage), constants, R, B)
    for c, tan_phi in ((1000.0, 0.0), (0.0, 0.6), (2000.0, 0.4)):
        peak = (c + top * tan_phi) * a

        def sigma(theta: float) -> float:
            ahead = (first - theta) / (first - largest)
            return top * (ahead if theta > largest else theta / largest)

        def tau(theta: float, c: float = c, peak: float = peak) -> float:
            if theta > largest:
                return peak * (first - theta) / (first - largest)
            return c + (peak - c) * theta / largest

        def both(integrand: Callable[[float], float]) -> float:
            return sum(
                float(integrate.quad(integrand, low, high)[0])
                for low, high in ((0.0, largest), (largest, first))
            )

        expected = [
            R * B * both(lambda x: sigma(x) * math.cos(x) + tau(x) * math.sin(x)),
            R * B * both(lambda x: tau(x) * math.cos(x) - sigma(x) * math.sin(x)),
            R**2 * B * both(tau),
        ]
        strength = torch.tensor([c, tan_phi, 1.0], dtype=torch.float64)
        assert (found @ strength).tolist() == pytest.approx(expected, rel=1e-6)


# ranges


@pytest.mark.parametrize("name", EFFECTS)
def test_a_size_is_taken_up_to_the_ends_of_its_range(name: str) -> None:
    described = describe(name)
    assert described.checked(described.low) == described.low
    assert described.checked(described.high) == described.high
    for outside in (down(described.low), up(described.high), math.nan, math.inf):
        with pytest.raises(ConfigError, match=name):
            described.checked(outside)


def test_an_effect_of_one_axle_gets_it_and_the_others_do_not() -> None:
    wheels = torch.ones(1, ROVER.axles, dtype=torch.float64)
    where = Situation(ROVER, 0.0, torch.arange(1), 0.0 * wheels, wheels, 0.1 * wheels[:, 0])
    inputs = ContactInputs(0.3 * wheels, 0.015 * wheels, SOIL.constants(), SOIL.strength())
    for failed, axle in (
        (make_effect("failed_wheel", 0.5, 0), 0),
        (make_effect("failed_wheel", 0.5, 1), 1),
        (make_effect("failed_wheel", 0.5), ROVER.axles - 1),
    ):
        changed = failed.contact(where, inputs).slip[0] != 0.3
        assert changed.tolist() == [k == axle for k in range(ROVER.axles)]
    payload = make_effect("payload", 3.0, 1).payload(where)
    assert payload is not None
    assert payload.mass.tolist() == [3.0]
    with pytest.raises(ConfigError, match="acts sideways"):
        make_effect("lateral_bulldozing", 1.0)


def test_a_mass_is_placed_where_its_moments_have_it() -> None:
    """Moments about the rover's centre of mass; no mass stays there, whatever its moments."""
    wheels = torch.ones(2, ROVER.axles, dtype=torch.float64)
    where = Situation(ROVER, 0.0, torch.arange(2), 0.0 * wheels, wheels, 0.1 * wheels[:, 0])
    values = torch.tensor([[4.0, 2.0, -1.0], [0.0, 2.0, -1.0]], dtype=torch.float64)
    placed = SimulatedEffect(ExtraMass, values).payload(where)
    assert placed is not None
    x, height = ROVER.centre_of_mass_x, ROVER.centre_of_mass_height
    assert placed.mass.tolist() == [4.0, 0.0]
    assert placed.x.tolist() == pytest.approx([x + 0.5, x])
    assert placed.height.tolist() == pytest.approx([height - 0.25, height])


@pytest.mark.parametrize(("c1", "c2", "ratio"), [(0.9, 0.5, 0.999), (0.2, -0.8, 0.001)])
def test_the_largest_stress_stays_inside_the_contact(c1: float, c2: float, ratio: float) -> None:
    """theta_m / theta_1 is clamped to 0.001 and 0.999."""
    slip, sinkage = (torch.tensor(value, dtype=torch.float64) for value in (0.6, 0.02))

    def forces(first: float, second: float) -> Tensor:
        soil = SOIL.with_values(c1=first, c2=second)
        size = (ROVER.wheel_radius, ROVER.wheel_width)
        return wheel_forces(slip, sinkage, soil.constants(), *size, quadrature(12))

    torch.testing.assert_close(forces(c1, c2), forces(ratio, 0.0), rtol=1e-12, atol=1e-12)


def test_random_hills_scale_down_with_what_the_rover_can_pull() -> None:
    """The same draw: above twice the steepest slope all of it, below that in proportion."""
    steepest = math.tan(STEEPEST)

    def drawn(capability: float) -> Tensor:
        generator = torch.Generator().manual_seed(6)
        hills = random_hills(300, torch.full((300,), capability).double(), generator)
        return torch.cat([hills.mean, hills.amplitude], 1)

    whole = drawn(2.0 * steepest)
    assert torch.equal(drawn(50.0), whole)
    torch.testing.assert_close(drawn(0.5 * steepest), 0.25 * whole)
    assert not drawn(-1.0).any()
    means, sines = whole[:, 0], whole[:, 1:].abs().sum(1)
    assert float(means.abs().max()) <= MEAN_SLOPE
    share = sines / (STEEPEST - means.abs())
    assert 0.4 <= float(share.min()) < 0.42
    assert 0.98 < float(share.max()) <= 1.0 + 1e-12


def test_the_pull_on_a_slope_is_the_traction_of_all_wheels_that_carry_the_rover() -> None:
    slope, slip = torch.tensor([0.0, 0.2]).double(), torch.tensor([0.3, 0.3]).double()
    found = climb(ROVER, SOIL.constants().expand(2, 6), SOIL.strength().expand(2, 2), slope, slip)
    assert float(found.pull[0]) > float(found.pull[1]) > 0.0
    load = ROVER.weight * math.cos(0.2) / len(ROVER.wheels)
    even = wheel_forces(slip[:1], found.sinkage[1:], SOIL.constants(), R, B, quadrature(6))
    normal = (even[0, 0] @ torch.cat([SOIL.strength(), torch.ones(1).double()])).item()
    assert normal == pytest.approx(load, rel=0.05)
