# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Stencil, rows and their place of expansion: sums over wheels and finite differences."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from torch import Tensor

from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.model.agreement import LARGEST_ERROR, agreement
from terrain_estimator.model.effect_values import with_changes
from terrain_estimator.model.packed_observation import (
    PACKED_SCALAR_FIELDS,
    PACKED_WHEEL_FIELDS,
    packed_size,
)
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.physics import UNCERTAIN, uncertain_constants
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.rows import (
    MOMENT_VARIANCE,
    ContactModel,
    Forces,
    Rows,
    drive_row,
    regression_rows,
    without_excess,
)
from terrain_estimator.model.stencil import OWN, stencil
from terramechanics.contact.stresses import wheel_forces
from terramechanics.presets import load_rover, load_soil
from terramechanics.terrain.soil import CONSTANTS

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
A = len(ROVER.axle_x)
GROUPS = ("slip", "slip_sd", "sinkage", "sinkage_sd", "angle", "angle_sd", "torque", "torque_sd")
NAMES = row_names(A)
PER_AXLE = len(ROVER.wheels) // A
THETA = np.array([1.3, 0.55, 1.0])  # c [kPa], tan phi, 1


@pytest.fixture(name="contact", scope="module")
def nominal() -> ContactModel:
    return nominal_of(physics_alone(ROVER, SOIL, exact=True).physics).nominal_contact()


def packed(**changes: float) -> Tensor:
    """Return one observation [P]; ``changes`` by name, of a group with the axle behind it."""
    values = {
        "slip": (0.12, 0.2, 0.31),
        "slip_sd": (0.01, 0.012, 0.011),
        "sinkage": (0.012, 0.016, 0.02),
        "sinkage_sd": (0.0011, 0.0012, 0.0013),
        "angle": (0.05, -0.11, 0.08),
        "angle_sd": (0.01, 0.02, 0.015),
        "torque": (4.0, 5.0, 6.0),
        "torque_sd": (0.2, 0.3, 0.4),
    }
    scalars = {
        "velocity": 0.1, "velocity_sd": 0.01, "pitch": 0.07, "pitch_sd": 0.008,
        "acceleration": 0.2, "acceleration_sd": 0.05, "bogie_angle": 0.06, "step": 0.1,
        "linked": 1.0,
    }  # fmt: skip
    flat = {f"{g}_{k}": v for g in GROUPS for k, v in enumerate(values[g])}
    flat |= scalars | changes
    assert len(flat) == packed_size(A)
    assert [name.replace("contact_", "") for name in PACKED_WHEEL_FIELDS] == [*GROUPS]
    assert tuple(scalars) == PACKED_SCALAR_FIELDS
    return torch.tensor(list(flat.values()), dtype=torch.float64)


def rows_of(observation: Tensor, contact: ContactModel) -> Rows:
    return regression_rows(observation[None], observation[None], contact)


def by_hand(observation: Tensor, contact: ContactModel) -> np.ndarray:
    """Rows [R, 3] in (c [kPa], tan phi, 1): forces of each wheel, turned and summed one by one."""
    groups = observation[: 8 * A].view(8, A)
    slip, sinkage, angle = groups[0], groups[2], groups[4].numpy()
    forces = wheel_forces(
        slip, sinkage, contact.constants, contact.radius, contact.width, contact.nodes
    ).numpy() * np.array([1e3, 1.0, 1.0])
    bogie = float(observation[8 * A + PACKED_SCALAR_FIELDS.index("bogie_angle")])
    pivot = np.array([ROVER.bogie_pivot_x, ROVER.bogie_pivot_height])
    centre = np.array([ROVER.centre_of_mass_x, ROVER.centre_of_mass_height])
    turn = np.array([[math.cos(bogie), -math.sin(bogie)], [math.sin(bogie), math.cos(bogie)]])
    along, up, whole, carried = (np.zeros(3) for _ in range(4))
    rows = np.zeros((len(NAMES), 3))
    for axle in range(A):
        normal, traction, moment = forces[axle]
        cosine, sine = math.cos(angle[axle]), math.sin(angle[axle])
        ahead = traction * cosine - normal * sine
        upward = normal * cosine + traction * sine
        hub = np.array([ROVER.axle_x[axle], ROVER.wheel_radius])
        if axle > 0:
            hub = pivot + turn @ (hub - pivot)
        along, up = along + PER_AXLE * ahead, up + PER_AXLE * upward
        arm = hub - centre
        whole = whole + PER_AXLE * (arm[0] * upward - arm[1] * ahead + moment)
        arm = hub - pivot
        if axle > 0:
            carried = carried + PER_AXLE * (arm[0] * upward - arm[1] * ahead + moment)
        rows[2 + axle] = moment
    weight = ROVER.mass * ROVER.gravity
    wheelbase = ROVER.axle_x[0] - ROVER.axle_x[-1]
    rows[NAMES.index("velocity")] = rows[NAMES.index("acceleration")] = along / ROVER.mass
    rows[NAMES.index("load")] = up / weight
    rows[NAMES.index("moment")] = whole / (weight * wheelbase)
    rows[NAMES.index("bogie_moment")] = carried / (weight * wheelbase)
    return rows


@pytest.mark.parametrize("changes", [{}, {"slip_1": -0.2, "pitch": -0.3, "bogie_angle": -0.2}])
def test_rows_are_the_balances_of_the_rover_summed_wheel_by_wheel(
    contact: ContactModel, changes: dict[str, float]
) -> None:
    observation = packed(**changes)
    rows = rows_of(observation, contact)
    np.testing.assert_allclose(
        rows.features[0, 0], by_hand(observation, contact), rtol=1e-9, atol=1e-12
    )
    pitch = float(observation[8 * A + PACKED_SCALAR_FIELDS.index("pitch")])
    target = [ROVER.gravity * math.sin(pitch), math.cos(pitch), 4.0, 5.0, 6.0, 0.2, 0.0, 0.0]
    np.testing.assert_allclose(rows.target[0], target, rtol=1e-12)
    variance = [0.0, 0.0, 0.04, 0.09, 0.16, 0.0025, MOMENT_VARIANCE, MOMENT_VARIANCE]
    np.testing.assert_allclose(rows.variance[0], variance, rtol=1e-12)
    assert bool((rows.used == 1.0).all())
    view = view_of(observation, A)
    drive = drive_row(view.slip, view.sinkage, view.contact_angle, contact)
    np.testing.assert_allclose(drive[0], rows.features[0, 0, 0], rtol=1e-9)


def test_the_noise_of_a_row_is_its_change_by_a_deviation_of_each_input(
    contact: ContactModel,
) -> None:
    """Slip and sinkage by plus and minus one deviation; angles by derivatives."""
    noise = rows_of(packed(), contact).noise[0, 0].numpy()  # [R, 3 A + 1, 3]
    start = packed()
    for group, (name, sd_name) in enumerate((("slip", "slip_sd"), ("sinkage", "sinkage_sd"))):
        for axle in range(A):
            key = f"{name}_{axle}"
            at, sd = (float(start[GROUPS.index(g) * A + axle]) for g in (name, sd_name))
            above, below = (by_hand(packed(**{key: at + s * sd}), contact) for s in (1.0, -1.0))
            np.testing.assert_allclose(
                noise[:, group * A + axle], (above - below) / 2.0, rtol=1e-8, atol=1e-10
            )
    for axle in range(A):
        at, sd = (float(start[GROUPS.index(g) * A + axle]) for g in ("angle", "angle_sd"))
        above, below = (
            by_hand(packed(**{f"angle_{axle}": at + s}), contact) for s in (1e-5, -1e-5)
        )
        np.testing.assert_allclose(
            noise[:, 2 * A + axle], sd * (above - below) / 2e-5, rtol=1e-6, atol=1e-8
        )
    tilt = np.zeros((len(NAMES), 3))
    tilt[0, 2], tilt[1, 2] = (
        -ROVER.gravity * math.cos(0.07) * 0.008,
        math.sin(0.07) * 0.008,
    )
    np.testing.assert_allclose(noise[:, 3 * A], tilt, rtol=1e-12)


LOST: dict[str, tuple[dict[str, float], set[str]]] = {
    "a slip": ({"slip_1": math.nan}, set(NAMES) - {"torque_0", "torque_2"}),
    "a sinkage below zero": ({"sinkage_0": -0.001}, set(NAMES) - {"torque_1", "torque_2"}),
    "a torque": ({"torque_2": math.nan}, {"torque_2"}),
    "a torque's deviation": ({"torque_sd_0": math.inf}, {"torque_0"}),
    "the acceleration": ({"acceleration": math.nan}, {"acceleration"}),
    "its deviation": ({"acceleration_sd": math.nan}, {"acceleration"}),
    "the bogie's angle": ({"bogie_angle": math.nan}, {"moment", "bogie_moment"}),
    "a contact angle": ({"angle_2": math.inf}, set(NAMES) - {"torque_0", "torque_1"}),
}


@pytest.mark.parametrize("what", LOST)
def test_what_is_not_measured_takes_along_the_rows_that_need_it(
    contact: ContactModel, what: str
) -> None:
    changes, lost = LOST[what]
    rows, whole = rows_of(packed(**changes), contact), rows_of(packed(), contact)
    for row, name in enumerate(NAMES):
        assert bool(rows.used[0, row]) == (name not in lost), name
        if name not in lost:
            torch.testing.assert_close(rows.features[0, 0, row], whole.features[0, 0, row])
            torch.testing.assert_close(rows.target[0, row], whole.target[0, row])
            torch.testing.assert_close(rows.variance[0, row], whole.variance[0, row])
    for part in rows:
        assert bool(torch.isfinite(part).all())


def test_rows_of_several_observations_are_those_of_each(contact: ContactModel) -> None:
    each = [packed(), packed(slip_0=0.3, pitch=-0.1), packed(slip_2=math.nan)]
    together = regression_rows(torch.stack(each), torch.stack(each), contact)
    for index, observation in enumerate(each):
        alone = rows_of(observation, contact)
        torch.testing.assert_close(together.features[:, index], alone.features[:, 0])
        torch.testing.assert_close(together.noise[:, index], alone.noise[:, 0])
        for name in ("target", "variance", "used"):
            torch.testing.assert_close(getattr(together, name)[index], getattr(alone, name)[0])


def test_rows_expanded_elsewhere_are_moved_back_to_first_order(contact: ContactModel) -> None:
    """From inputs half a deviation away: what is left is of second order."""
    near = packed(slip_0=0.12 + 0.005, sinkage_1=0.016 - 0.0006)
    exact = rows_of(packed(), contact).features[0, 0] @ torch.from_numpy(THETA)
    away = rows_of(near, contact).features[0, 0] @ torch.from_numpy(THETA)
    moved = regression_rows(packed()[None], near[None], contact).features[0, 0]
    left = (moved @ torch.from_numpy(THETA) - exact).abs()
    assert bool((left <= 0.05 * (away - exact).abs() + 1e-12).all())
    assert float((away - exact).abs().max()) > 1e-3


def test_the_change_of_a_row_by_a_soil_constant_is_its_derivative() -> None:
    """By the prior deviation of each uncertain constant, for values and noise."""
    model = nominal_of(physics_alone(ROVER, SOIL, exact=False).physics)
    contact, observation = model.nominal_contact(), packed()
    rows = rows_of(observation, contact)
    for index in range(len(UNCERTAIN)):
        sides = []
        for sign in (1e-4, -1e-4):
            deviations = torch.zeros(len(UNCERTAIN), dtype=torch.float64)
            deviations[index] = sign
            varied = model.contact(0, deviations)
            sides.append(rows_of(observation, varied))
        for name, limit in (("features", 1e-2), ("noise", 5e-2)):
            above, below = (getattr(side, name)[0, 0] for side in sides)
            slope = (above - below) / 2e-4
            found = getattr(rows, name)[1 + index, 0]
            scale = float(slope.abs().max())
            torch.testing.assert_close(found, slope, rtol=0.0, atol=limit * scale)


def test_prior_deviations_of_the_constants_are_relative_and_k_phi_carries_k_c() -> None:
    constants = SOIL.constants()[None]
    assert uncertain_constants(constants, 0.0, 0.2).shape == (1, 0, 6)
    found = uncertain_constants(constants, 0.1, 0.2)[0].numpy()
    expected = np.zeros((len(UNCERTAIN), 6))
    for row, name in enumerate(UNCERTAIN):
        column = CONSTANTS.index(name)
        expected[row, column] = 0.1 * float(constants[0, column])
    k_c, k_phi = (float(constants[0, CONSTANTS.index(name)]) for name in ("k_c", "k_phi"))
    expected[UNCERTAIN.index("k_phi"), CONSTANTS.index("k_phi")] = 0.1 * math.hypot(
        k_c / 0.2, k_phi
    )
    np.testing.assert_allclose(found, expected, rtol=1e-12)


Law = Callable[[Tensor, Tensor, Tensor], Tensor]


@pytest.mark.parametrize("uncertain", [0, 1, 3])
def test_a_stencil_reads_a_quadratic_law_exactly(uncertain: int) -> None:
    """Values, first and half second differences in deviations of slip and sinkage, mixed one too;
    by each constant with the step of a thousandth."""
    found = stencil(uncertain)
    step = 1e-3

    def law(slip: Tensor, sinkage: Tensor, which: Tensor) -> Tensor:
        own = 2.0 + 3.0 * slip - 4.0 * sinkage + 0.5 * slip**2 + 0.7 * sinkage**2
        by_constant = which * (1.0 + 2.0 * slip + 5.0 * sinkage)
        return own + 0.9 * slip * sinkage + step * by_constant

    at = law(found.moves[:, 0], found.moves[:, 1], found.constants.double())
    read = found.weights @ at  # [3, C]
    np.testing.assert_allclose(read[:, 0], [2.0, 3.0, -4.0], atol=1e-9)
    np.testing.assert_allclose(found.curvature @ at, [0.5, 0.7, 0.9], atol=1e-9)
    for k in range(1, 1 + uncertain):
        np.testing.assert_allclose(read[:, k], [k, 2.0 * k, 5.0 * k], rtol=1e-6)
    assert found.moves.shape[0] == 3 + 3 * (1 + uncertain)
    assert not found.constants[:OWN].any()
    assert found.weights[:, 0, OWN:].count_nonzero() == 0


def agreed_by_hand(rows: Rows, chosen: Tensor) -> tuple[np.ndarray, np.ndarray]:
    """e = G' S^-1 r and I - G' S^-1 G of the first observation, without the velocity's row."""
    use = (rows.used[0] * chosen).numpy() > 0.0
    use[0] = False
    noise = (rows.noise[0, 0].numpy() @ THETA)[use]
    residual = (rows.target[0].numpy() - rows.features[0, 0].numpy() @ THETA)[use]
    covariance = noise @ noise.T + np.diag(rows.variance[0].numpy()[use])
    error = noise.T @ np.linalg.solve(covariance, residual)
    left = np.eye(noise.shape[1]) - noise.T @ np.linalg.solve(covariance, noise)
    return error, left


@pytest.mark.parametrize("masked", [[], ["load"], ["torque_1", "moment"]])
def test_the_place_of_agreement_is_one_step_of_orthogonal_distance_regression(
    contact: ContactModel, masked: list[str]
) -> None:
    """Torques near those of the rows, so that no error is beyond the limit."""
    base = rows_of(packed(), contact)
    torques = base.features[0, 0, 2 : 2 + A] @ torch.from_numpy(THETA)
    observation = packed(**{f"torque_{k}": float(torques[k]) + 0.3 * (k - 1) for k in range(A)})
    rows, chosen = rows_of(observation, contact), torch.ones(len(NAMES)).double()
    for name in masked:
        chosen[NAMES.index(name)] = 0.0
    found = agreement(rows, observation[None], contact, torch.from_numpy(THETA), chosen, 1e9)
    error, left = agreed_by_hand(rows, chosen)
    moved = found.inputs[0]
    for group, name in enumerate(("slip", "sinkage")):
        place = GROUPS.index(name) * A
        for axle in range(A):
            value, sd = observation[place + axle], observation[place + A + axle]
            wanted = float(value + sd * error[group * A + axle])
            wanted = wanted if name == "slip" else max(wanted, 0.3 * float(value))
            assert float(moved[place + axle]) == pytest.approx(wanted, rel=1e-8)
    kept = [k for k in range(packed_size(A)) if k // A not in {0, 2}]
    assert torch.equal(moved[kept], observation[kept])
    diagonal = np.diag(left)
    np.testing.assert_allclose(found.doubt[0, 0], diagonal[:A], rtol=1e-8)
    np.testing.assert_allclose(found.doubt[0, 1], diagonal[A : 2 * A], rtol=1e-8)
    np.testing.assert_allclose(
        found.doubt[0, 2], [left[k, A + k] for k in range(A)], rtol=1e-8, atol=1e-12
    )


def test_no_input_is_moved_further_than_the_limit_or_out_of_the_models_range(
    contact: ContactModel,
) -> None:
    observation = packed(torque_0=200.0, torque_1=-200.0, torque_2=200.0)
    rows, theta = rows_of(observation, contact), torch.from_numpy(THETA)
    chosen = torch.ones(len(NAMES)).double()
    moved = agreement(rows, observation[None], contact, theta, chosen).inputs[0]
    errors = [
        (moved - observation)[k] / observation[k + A] for k in (*range(A), *range(2 * A, 3 * A))
    ]
    largest = max(abs(float(error)) for error in errors)
    assert largest == pytest.approx(LARGEST_ERROR)
    # three deviations on, the wheel would slip more than the model allows: it stays
    for torque in (200.0, -200.0):
        slipping = packed(slip_0=0.94, slip_sd_0=0.3, torque_0=torque)
        rows = rows_of(slipping, contact)
        moved = agreement(rows, slipping[None], contact, theta, chosen).inputs[0]
        place = float(moved[0])
        assert place == 0.94 or place == pytest.approx(0.94 - LARGEST_ERROR * 0.3)
        assert float(moved[2 * A]) >= 0.3 * 0.012


def test_an_excess_grows_with_the_square_of_the_inputs_deviations(contact: ContactModel) -> None:
    """h'' P / 2: evaluated a deviation apart, which is ``scale`` times as far in sinkage."""
    generator = torch.Generator().manual_seed(3)
    n, points = 2, contact.stencil.curvature.shape[1]
    evaluated = torch.rand(points, n, A, 3, 3, generator=generator, dtype=torch.float64)
    values = torch.zeros(1, n, A, 3, 3, dtype=torch.float64)
    forces = Forces(values, values[:1], values[:1])
    scale = 1.0 + torch.rand(n, A, generator=generator, dtype=torch.float64)

    def excess(kind: int, factor: float) -> Tensor:
        doubt = torch.zeros(n, 3, A, dtype=torch.float64)
        doubt[:, kind] = 0.3
        return without_excess(forces, evaluated, factor * scale, doubt, contact).values

    for kind, grown in ((0, 1.0), (1, 4.0), (2, 2.0)):
        assert bool((excess(kind, 1.0) != 0.0).any())
        torch.testing.assert_close(excess(kind, 2.0), grown * excess(kind, 1.0))


def test_physics_without_effects_has_no_sizes_of_effects() -> None:
    none = torch.zeros(0, dtype=torch.float64)
    physics = nominal_of(physics_alone(ROVER, SOIL, exact=True).physics)
    assert physics.effect_sizes(none, none).shape == (0, 2)


def test_changes_by_an_effect_are_derivatives_and_carry_its_target_in_the_constant() -> None:
    """Rows that are linear in two values of effects, over two observations."""
    draw = torch.Generator().manual_seed(3)
    shapes = {"features": (2, 5, 3), "noise": (2, 5, 4, 3), "target": (2, 5)}
    base = {name: torch.randn(shape, generator=draw).double() for name, shape in shapes.items()}
    slopes = {
        name: torch.randn((2, *shape), generator=draw).double() for name, shape in shapes.items()
    }
    used = torch.ones(2, 5, dtype=torch.float64)
    used_moved = torch.ones(2, 2, 5, dtype=torch.float64)
    used_moved[1, 0, 3] = 0.0  # the second value takes one row out of its range
    moved = {name: (base[name] + 1e-3 * slopes[name]).flatten(0, 1) for name in shapes}
    variance = torch.ones_like(used)
    none = torch.zeros(2, 5, 0, dtype=torch.float64)
    rows = Rows(
        base["features"].unsqueeze(0), base["noise"].unsqueeze(0), base["target"], variance, used,
        none,
    )  # fmt: skip
    varied = Rows(
        moved["features"].unsqueeze(0),
        moved["noise"].unsqueeze(0),
        moved["target"],
        variance.repeat(2, 1),
        used_moved.flatten(0, 1),
        none.repeat(2, 1, 1),
    )
    found = with_changes(rows, varied)
    features, noise = slopes["features"].clone(), slopes["noise"].clone()
    features[..., 2] -= slopes["target"]
    features[1, 0, 3], noise[1, 0, 3] = 0.0, 0.0
    assert torch.allclose(found.features[1:], features, atol=1e-9)
    assert torch.allclose(found.noise[1:], noise, atol=1e-9)
    assert torch.equal(found.features[0], base["features"])
    assert torch.equal(found.noise[0], base["noise"])
    assert torch.equal(found.target, base["target"])
    assert torch.equal(found.used, used)
