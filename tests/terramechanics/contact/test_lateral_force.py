# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A wheel at a slip angle against scipy's adaptive integration, its limits, and its side."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.integrate import quad

from terramechanics.contact.stresses import quadrature, wheel_forces
from terramechanics.effects import describe, make_effect
from terramechanics.effects.soil import side_resistance
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs, Situation
from tests.terramechanics.effects.wedge import resistance

RADIUS, WIDTH, SINKAGE = 0.13, 0.16, 0.02
SOIL = load_soil("loose_sand")
TYPICAL = np.array([1000.0, 0.6, 1.0])  # c [Pa], tan phi, 1
ANGLES = (0.05, math.radians(15.0), math.radians(45.0), math.radians(75.0))
SLIPS = (-0.4, -0.05, 0.0, 0.2, 0.9)


def tensor(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def found(slip: float, angle: float | None, points: int = 6) -> NDArray[np.float64]:
    turned = None if angle is None else tensor(angle)
    forces = wheel_forces(
        tensor(slip),
        tensor(SINKAGE),
        SOIL.constants(),
        RADIUS,
        WIDTH,
        quadrature(points),
        None,
        turned,
    )
    return np.asarray(forces.numpy() @ TYPICAL)


def integrated(slip: float, angle: float) -> NDArray[np.float64]:
    """N, T, M and Y."""
    theta_1 = math.acos(1.0 - SINKAGE / RADIUS)
    theta_m = (SOIL.c1 + SOIL.c2 * slip) * theta_1
    cohesion, tan_phi, _ = TYPICAL
    sin, cos = math.sin, math.cos

    def sigma(theta: float) -> float:
        mapped = theta if theta > theta_m else theta_1 - theta * (theta_1 - theta_m) / theta_m
        return (SOIL.k_c / WIDTH + SOIL.k_phi) * max(
            RADIUS * (cos(mapped) - cos(theta_1)), 0.0
        ) ** SOIL.n

    def shear(theta: float) -> tuple[float, float]:
        along = RADIUS * (theta_1 - theta - (1.0 - slip) * (sin(theta_1) - sin(theta)))
        across = RADIUS * (1.0 - slip) * (theta_1 - theta) * math.tan(angle)
        whole = math.hypot(along, across)
        stress = (cohesion + sigma(theta) * tan_phi) * -math.expm1(-whole / SOIL.shear_modulus)
        return (stress * along / whole, stress * across / whole) if whole else (0.0, 0.0)

    def total(f: Callable[[float], float]) -> float:
        ends = itertools.pairwise((0.0, theta_m, theta_1))
        return (
            RADIUS
            * WIDTH
            * sum(quad(f, a, b, epsabs=0.0, epsrel=1e-9, limit=200)[0] for a, b in ends)
        )

    return np.array(
        [
            total(lambda t: sigma(t) * cos(t) + shear(t)[0] * sin(t)),
            total(lambda t: shear(t)[0] * cos(t) - sigma(t) * sin(t)),
            RADIUS * total(lambda t: shear(t)[0]),
            total(lambda t: shear(t)[1]),
        ]
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_forces_at_a_slip_angle_agree_with_adaptive_integration(angle: float) -> None:
    for slip in SLIPS:
        expected = integrated(slip, angle)
        scale = abs(expected[0]) * np.array([1.0, 1.0, RADIUS, 1.0])
        for points, tolerance in ((6, 3e-5), (24, 1e-8)):
            assert np.abs((found(slip, angle, points) - expected) / scale).max() < tolerance, (
                slip,
                points,
            )


@pytest.mark.parametrize("slip", SLIPS)
def test_without_a_slip_angle_there_is_no_lateral_force_and_nothing_else_changes(
    slip: float,
) -> None:
    straight = found(slip, 0.0)
    assert straight[3] == 0.0
    np.testing.assert_allclose(straight[:3], found(slip, None), rtol=1e-12)
    np.testing.assert_allclose(found(slip, 1e-6)[:3], found(slip, None), rtol=1e-4)


@pytest.mark.parametrize("slip", SLIPS)
def test_to_the_other_side_the_lateral_force_turns_and_the_others_stay(slip: float) -> None:
    right, left = found(slip, 0.4), found(slip, -0.4)
    np.testing.assert_allclose(left, right * [1.0, 1.0, 1.0, -1.0], rtol=1e-12)
    assert right[3] > 0.0


def test_both_directions_share_one_limit_of_the_shear_stress() -> None:
    angles = torch.tensor(ANGLES, dtype=torch.float64)
    slip, sinkage = torch.full_like(angles, 0.3), torch.full_like(angles, SINKAGE)
    coefficients = wheel_forces(
        slip, sinkage, SOIL.constants(), RADIUS, WIDTH, quadrature(24), None, angles
    ).numpy()
    torque, lateral = coefficients[:, 2, 0] / RADIUS, coefficients[:, 3, 0]  # of a unit of cohesion
    area = RADIUS * WIDTH * math.acos(1.0 - SINKAGE / RADIUS)
    assert np.all(np.hypot(torque, lateral) < area)
    assert np.all(np.diff(lateral) > 0.0)
    assert np.all(np.diff(torque) < 0.0)


def test_scripted_and_plain_forces_at_a_slip_angle_are_the_same_numbers() -> None:
    slip = torch.linspace(-0.4, 0.9, 27, dtype=torch.float64)
    arguments = (
        slip,
        torch.full_like(slip, SINKAGE),
        SOIL.constants(),
        RADIUS,
        WIDTH,
        quadrature(),
        None,
        torch.full_like(slip, 0.3),
    )
    assert torch.equal(torch.jit.script(wheel_forces)(*arguments), wheel_forces(*arguments))


def test_the_side_of_a_wheel_resists_as_integrated() -> None:
    theta_1 = math.acos(1.0 - SINKAGE / RADIUS)

    def pushed(theta: float) -> float:
        depth = RADIUS * (math.cos(theta) - math.cos(theta_1))
        return depth**2 * (RADIUS - depth * math.cos(theta))

    expected = 7e4 * quad(pushed, 0.0, theta_1)[0]
    assert float(
        side_resistance(tensor(7e4), tensor(SINKAGE), RADIUS, quadrature())
    ) == pytest.approx(expected, rel=1e-8)


def test_lateral_bulldozing_adds_to_the_lateral_force_alone_and_nothing_straight_ahead() -> None:
    rover = load_rover("mars_rover")
    none = torch.zeros(1, 1, dtype=torch.float64)
    where = Situation(rover, 0.0, torch.arange(1), none, none, none[:, 0])
    effect = describe("lateral_bulldozing").acting(tensor(7e4).view(1, 1))
    for angle in (-0.5, 0.5):
        contact = ContactInputs(
            none, none + SINKAGE, SOIL.constants(), SOIL.strength(), slip_angle=none + angle
        )
        forces = contact.forces(rover.wheel_radius, rover.wheel_width, quadrature())
        added = (effect.push(where, contact, forces) - forces)[0, 0]
        assert added[:3].tolist() == [0.0, 0.0, 0.0]
        side = float(
            side_resistance(tensor(7e4), tensor(SINKAGE), rover.wheel_radius, quadrature())
        )
        assert float(added[3]) == pytest.approx(math.sin(angle) * side, rel=1e-9)
        pulled = (make_effect("bulldozing", 1e4).push(where, contact, forces) - forces)[0, 0]
        assert pulled.tolist() == pytest.approx([0.0, -resistance(1e4, SINKAGE, SOIL), 0.0, 0.0])
    straight = ContactInputs(none, none + SINKAGE, SOIL.constants(), SOIL.strength())
    forces = straight.forces(rover.wheel_radius, rover.wheel_width, quadrature())
    assert torch.equal(effect.push(where, straight, forces), forces)
