# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A wheel that moves anyhow: against scipy, in the mirror, its power, limits and continuity."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad
from torch import Tensor

from terramechanics.contact.rolling import (
    WheelMotion,
    compiled_rolling_forces,
    dissipated_power,
    motion_of_slip,
    rolling_forces,
)
from terramechanics.contact.stresses import quadrature, wheel_forces
from terramechanics.presets import load_soil

RADIUS, WIDTH, SINKAGE = 0.13, 0.16, 0.02
SOIL = load_soil("loose_sand")
SPEED = st.just(0.0) | st.builds(
    lambda size, sign: sign * 10.0**size, st.floats(-8.0, 0.0), st.sampled_from((-1.0, 1.0))
)
MOTIONS = st.tuples(SPEED, SPEED, SPEED)
Speeds = tuple[float, float, float]
Vector = NDArray[np.float64]


def tensor(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)


def coefficients(
    speeds: Speeds, points: int = 24, slowest: float = 0.0, sinkage: float = SINKAGE
) -> Vector:
    rows = rolling_forces(
        WheelMotion(*(tensor(speed) for speed in speeds)),
        tensor(sinkage),
        SOIL.constants(),
        RADIUS,
        WIDTH,
        quadrature(points),
        None,
        slowest,
    )
    return np.asarray(rows.numpy())


def forces(speeds: Speeds, cohesion: float = 1000.0, tan_phi: float = 0.6) -> Vector:
    """N, T, M, Y."""
    return np.asarray(coefficients(speeds) @ np.array([cohesion, tan_phi, 1.0]))


def integrated(speeds: Speeds, cohesion: float, tan_phi: float) -> Vector:
    """N, T, M and Y by adaptive integration, the displacement by one over the rim's velocity."""
    rim, along, across = speeds
    theta_1 = math.acos(1.0 - SINKAGE / RADIUS)
    unit, weight = np.polynomial.legendre.leggauss(20)
    rolls = min(math.hypot(rim, along) / max(0.04 * abs(across), 1e-300), 1.0)
    slip = max(1.0 - abs(along) / abs(rim), -0.6) if rim else -0.6
    theta_m = max(SOIL.c1 + SOIL.c2 * slip * rolls, 1e-3) * theta_1

    def sigma(theta: float) -> float:
        mapped = theta if theta > theta_m else theta_1 - theta * (theta_1 - theta_m) / theta_m
        depth = RADIUS * (math.cos(mapped) - math.cos(theta_1))
        return (SOIL.k_c / WIDTH + SOIL.k_phi) * max(depth, 0.0) ** SOIL.n

    def edge(sign: float) -> Vector:
        """Return the forces where the edge in front (1) or behind (-1) leads."""

        def shear(theta: float) -> tuple[float, float]:
            half = 0.5 * (theta_1 - theta)
            passed = theta + half * (1.0 + unit)
            back = half * float(weight @ (rim - along * np.cos(passed))) * sign
            right = half * float(weight @ np.full_like(unit, -across))
            whole = math.hypot(back, right)
            if whole == 0.0:
                return 0.0, 0.0
            grown = 1.0
            if rim:
                grown = -math.expm1(-whole * RADIUS / (abs(rim) * SOIL.shear_modulus))
            stress = (cohesion + sigma(theta) * tan_phi) * grown
            return stress * back / whole, stress * right / whole

        def total(f: Callable[[float], float]) -> float:
            ends = itertools.pairwise((0.0, theta_m, theta_1))
            parts = (quad(f, a, b, epsabs=0.0, epsrel=1e-10, limit=400)[0] for a, b in ends)
            return RADIUS * WIDTH * sum(parts)

        return np.array(
            [
                total(lambda t: sigma(t) * math.cos(t) + shear(t)[0] * math.sin(t)),
                sign * total(lambda t: shear(t)[0] * math.cos(t) - sigma(t) * math.sin(t)),
                sign * RADIUS * total(lambda t: shear(t)[0]),
                total(lambda t: shear(t)[1]),
            ]
        )

    leads = along / (0.04 * math.hypot(rim, across)) if rim or across else math.copysign(2, along)
    front = 0.5 + 0.5 * min(max(leads, -1.0), 1.0)
    parts = [share * edge(s) for s, share in ((1.0, front), (-1.0, 1.0 - front)) if share > 0.0]
    return np.asarray(sum(parts))


CASES = {
    "driven": (1.0, 0.8, 0.1),
    "braked": (1.0, 1.2, -0.3),
    "backwards": (-1.0, -0.7, 0.2),
    "half locked": (0.3, 1.0, 0.1),
    "locked": (0.0, 1.0, 0.5),
    "locked, straight": (0.0, -1.0, 0.0),
    "against its way": (-0.3, 1.0, 0.2),
    "crabbing": (0.2, 0.0, 0.5),
    "sliding sideways": (0.0, 0.0, -1.0),
    "spinning": (1.0, 0.0, 0.0),
    "edge undecided": (0.5, 0.01, 0.4),
    "hardly rolling": (0.01, 0.01, 1.0),
}


@pytest.mark.parametrize("case", CASES)
def test_forces_agree_with_adaptive_integration(case: str) -> None:
    """At three strengths: the coefficients are those of an affine function."""
    rows = coefficients(CASES[case])
    for cohesion, tan_phi in ((0.0, 0.0), (1000.0, 0.6), (4000.0, 0.2)):
        expected = integrated(CASES[case], cohesion, tan_phi)
        scale = abs(expected[0]) * np.array([1.0, 1.0, RADIUS, 1.0])
        found = rows @ np.array([cohesion, tan_phi, 1.0])
        assert np.abs((found - expected) / scale).max() < 1e-8


@given(slip=st.floats(-0.6, 0.95), depth=st.floats(1e-3, 0.8), wide=st.floats(0.0, 1.0))
@settings(max_examples=60)
def test_without_slip_across_it_is_todays_law(slip: float, depth: float, wide: float) -> None:
    """And at a slip angle to 45 deg, where today's law has it, the same one. 60 runs."""
    arguments = (tensor(depth * RADIUS), SOIL.constants(), RADIUS, WIDTH, quadrature())
    for lateral in (0.0, wide * min(1.0 - slip, 0.5)):
        angle = tensor(math.atan2(-lateral, 1.0 - slip))
        today = wheel_forces(tensor(slip), *arguments, None, angle)
        motion = motion_of_slip(tensor(slip), tensor(lateral))
        largest = today.abs().amax()
        for speed in (1.0, 0.037):
            scaled = WheelMotion(*(speed * part for part in motion))
            assert (rolling_forces(scaled, *arguments) - today).abs().max() < 1e-12 * largest


@given(speeds=MOTIONS)
@settings(max_examples=60)
def test_mirrored_left_and_right_only_the_lateral_force_turns(speeds: Speeds) -> None:
    """60 runs."""
    rim, along, across = speeds
    mirrored = coefficients((rim, along, -across))
    np.testing.assert_array_equal(mirrored, coefficients(speeds) * [[1.0], [1.0], [1.0], [-1.0]])


@given(speeds=MOTIONS)
@settings(max_examples=60)
def test_mirrored_front_and_back_traction_and_torque_turn(speeds: Speeds) -> None:
    """60 runs."""
    rim, along, across = speeds
    mirrored = coefficients((-rim, -along, across))
    expected = coefficients(speeds) * [[1.0], [-1.0], [-1.0], [1.0]]
    np.testing.assert_allclose(mirrored, expected, rtol=1e-12, atol=1e-12 * abs(expected).max())


@given(
    speeds=MOTIONS,
    braked=st.none() | st.floats(0.0, 0.6),
    n=st.floats(0.3, 2.0),
    shear_modulus=st.floats(1e-3, 0.1),
    places=st.tuples(st.floats(0.05, 0.6), st.floats(-0.3, 0.35)),
)
@settings(max_examples=200)
def test_the_ground_takes_power_from_every_wheel(
    speeds: Speeds,
    braked: float | None,
    n: float,
    shear_modulus: float,
    places: tuple[float, float],
) -> None:
    """200 runs: half at any motion, half lightly braked, where shear alone gives some back.

    Power is affine in the strength, so that the corners of its range bound it.
    """
    rim, along, across = speeds
    if braked is not None:
        along = rim * (1.0 + braked)
    motion = WheelMotion(tensor(rim), tensor(along), tensor(across))
    constants = torch.tensor([n, 900.0, 1.5e6, shear_modulus, *places], dtype=torch.float64)
    depth = torch.tensor([1e-4, 0.01, 0.1, 0.4, 0.9], dtype=torch.float64)
    rows = compiled_rolling_forces()(
        motion, depth * RADIUS, constants, RADIUS, WIDTH, quadrature(12)
    )
    for corner in itertools.product((0.0, 1e4), (0.0, 1.2)):
        found = rows @ torch.tensor([*corner, 1.0], dtype=torch.float64)
        assert bool((dissipated_power(motion, found, RADIUS) >= 0.0).all())


def test_shear_alone_gives_power_back_at_light_braking() -> None:
    """Which is why the test above would notice a law whose pressure took nothing."""
    speeds = (1.0, 1.3, 0.0)
    rows = coefficients(speeds, sinkage=0.1)
    motion = WheelMotion(*(tensor(speed) for speed in speeds))
    by_friction, by_pressure = (
        float(dissipated_power(motion, torch.tensor(rows[:, column]), RADIUS)) for column in (1, 2)
    )
    assert by_friction < 0.0
    assert by_friction + by_pressure > 0.0


@pytest.mark.parametrize(
    ("speeds", "way"),
    [
        ((1.0, 0.8, 0.0), (0.0, 0.0, 1.0)),  # slip across through zero
        ((1.0, 1.05, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),  # the wheel locks and turns back
        ((0.0, 1.0, 0.3), (1.0, 0.0, 0.0)),
        ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
        ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),  # the leading edge changes
        ((0.0, 0.0, 1.0), (1.0, -1.0, 0.0)),
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((1.0, 1.0, 0.0), (0.0, 1.0, 0.0)),  # from driven to braked
        ((1.0, 0.04, 0.0), (0.0, 1.0, 0.0)),
    ],
)
def test_forces_are_continuous(speeds: Speeds, way: Speeds) -> None:
    middle = forces(speeds)
    for step in (1e-5, -1e-5, 1e-8, -1e-8):
        moved = tuple(speed + step * part for speed, part in zip(speeds, way, strict=True))
        change = forces((moved[0], moved[1], moved[2])) - middle
        assert np.abs(change).max() < 100.0 * abs(step) * middle[0]


def test_friction_of_a_wheel_that_hardly_moves_goes_through_zero() -> None:
    assert not coefficients((0.0, 0.0, 0.0), slowest=1e-3)[1:].any()
    creep = [coefficients((0.0, speed, 0.0), slowest=1e-3)[2, 1] for speed in (1e-8, 2e-8, -1e-8)]
    assert creep[0] < 0.0
    assert creep[1] == pytest.approx(2.0 * creep[0], rel=1e-3)
    assert creep[2] == pytest.approx(-creep[0], rel=1e-9)
    fast = (0.01, 0.1, 0.03)
    np.testing.assert_array_equal(coefficients(fast, slowest=1e-3), coefficients(fast))


def test_scripted_and_plain_forces_are_the_same_numbers() -> None:
    speeds = torch.tensor(list(CASES.values()), dtype=torch.float64).unbind(-1)
    arguments = (
        WheelMotion(*speeds), tensor(SINKAGE), SOIL.constants(), RADIUS, WIDTH, quadrature(),
        tensor(0.1),
    )  # fmt: skip
    plain = rolling_forces(*arguments)
    assert plain.shape == (len(CASES), 4, 3)
    assert torch.equal(compiled_rolling_forces()(*arguments), plain)
