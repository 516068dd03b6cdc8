# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Models with effects in their limits: effects known to be absent, moments of sizes."""

import math

import numpy as np
import pytest
import torch
from scipy import integrate, stats

from terrain_estimator.learning.adding import Sized, with_effects
from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.model.effect_rows import EffectRows, Observed
from terrain_estimator.model.effects import LAWS, NOT_ONLINE
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.rows import drive_row
from terramechanics.effects import EFFECTS

LOADED = load_model("mars_rover")
AXLES = LOADED.rover.axles


def observations() -> torch.Tensor:
    """Twenty packed observations."""
    generator = torch.Generator().manual_seed(8)
    soil = LOADED.metadata.soils[0]
    return draw_tasks(LOADED.rover, soil, "S1", 2.0, 1, generator).measured[0]


def with_rates(packed: torch.Tensor) -> torch.Tensor:
    rates = torch.full((packed.shape[0], AXLES), 1.3, dtype=torch.float64)
    return torch.cat([packed[:, :-2], rates, packed[:, -2:]], 1)


ABSENT = ("slope_bias", "drive_drag", "bulldozing", "slip_sinkage", "odometry_scale")


@pytest.mark.parametrize("name", ABSENT)
def test_an_effect_that_is_known_to_be_absent_changes_no_estimate(name: str) -> None:
    """Its size is zero, give or take a millionth of its range."""
    high = EFFECTS[name].high
    model, plain = with_effects(LOADED, [Sized(name, 0.0, 1e-6 * high)]), restore(LOADED)
    packed = observations()
    here, there = model.initial(), plain.initial()
    with torch.inference_mode():
        for one, other in zip(with_rates(packed), packed, strict=True):
            here, there = model.update(here, one), plain.update(there, other)
        found, expected = model.estimate(here), plain.estimate(there)
        deviation = expected[1:].diagonal().sqrt()
        assert float(((found[0] - expected[0]) / deviation).abs().max()) < 1e-2
        assert float((found[1:].diagonal().sqrt() / deviation - 1.0).abs().max()) < 1e-2
        size = model.effects(here)[0]
    assert abs(float(size[0])) < 1e-5 * high
    assert float(size[1].sqrt()) == pytest.approx(1e-6 * high, rel=0.05)


def moment(power: int, mean: float, sd: float) -> float:
    """Of a Gaussian above zero, which is zero elsewhere."""

    def integrand(x: float) -> float:
        return float(x**power * stats.norm.pdf(x, mean, sd))

    return float(integrate.quad(integrand, 0.0, mean + 12.0 * sd)[0])


def test_a_size_that_is_a_square_has_the_moments_of_the_square_of_what_is_above_zero() -> None:
    """Of exit_angle: the value is the root of the size, zero where that would be negative."""
    law = LAWS["exit_angle"](LOADED.rover)
    for mean, sd in ((0.5, 0.1), (0.1, 0.3), (0.0, 0.2), (-0.2, 0.2)):
        found = law.size_moments(torch.tensor(mean).double(), torch.tensor(sd**2).double()).tolist()
        second, fourth = (moment(power, mean, sd) for power in (2, 4))
        assert found == pytest.approx([second, fourth - second**2], rel=1e-4, abs=1e-9)


def test_every_effect_is_estimated_online_or_says_why_not() -> None:
    assert set(LAWS) | set(NOT_ONLINE) == set(EFFECTS)
    assert not set(LAWS) & set(NOT_ONLINE)


def test_the_other_unknowns_of_effects_have_the_deviations_of_their_documentation() -> None:
    """docs/effects.md, the extra unknowns; in units of the unknown."""
    found = {name: [extra.sd for extra in law.extra] for name, law in LAWS.items() if law.extra}
    assert found == {
        "slope_bias": [0.5],
        "bulldozing": [0.25],
        "grousers": [0.7],
        "slip_sinkage": [0.5],
        "multipass": [0.5],
        "payload": [10.0, 10.0],
        "odometry_scale": [0.3],
    }


@pytest.mark.parametrize(("move", "evaluated"), [(0.009, False), (0.011, True), (-0.011, True)])
def test_rows_are_evaluated_anew_when_an_effect_moved_by_a_hundredth_of_its_prior(
    move: float, *, evaluated: bool
) -> None:
    physics = with_effects(LOADED, [Sized("slope_bias", 0.0, 0.01)]).physics
    before = torch.zeros(2 + physics.uncertain_constants + 1, dtype=torch.float64)
    after = before.clone()
    after[-1] = move
    assert bool(physics.has_moved(torch.zeros(0), before, after)) == evaluated


def test_the_velocity_row_has_its_change_by_a_deviation_of_each_value_behind_it() -> None:
    model = with_effects(LOADED, [Sized("bulldozing", 2e4, 1e4), Sized("slope_bias", 0.01, 0.02)])
    physics = model.physics
    contact = nominal_of(physics).nominal_contact(0)
    view = view_of(with_rates(observations())[3], AXLES)
    known = physics.uncertain_constants
    start = torch.zeros(known + 4, dtype=torch.float64)

    def row(deviations: torch.Tensor) -> torch.Tensor:
        return physics.drive_row(view, contact.constants, contact.varied, deviations)

    found = row(start)
    assert found.shape == (1 + known + 4, 3)
    for value, moves in enumerate([True, True, True, False]):  # the accelerometer: another row
        away = start.clone()
        away[known + value] = 1e-3
        change = 1e3 * (row(away)[0] - found[0])
        assert bool((change != 0.0).any()) == moves
        torch.testing.assert_close(found[1 + known + value], change, rtol=1e-6, atol=1e-9)


def test_the_velocity_row_of_an_effect_of_size_zero_is_the_nominal_one() -> None:
    physics = with_effects(LOADED, [Sized("bulldozing", 0.0, 1e4)]).physics
    contact = nominal_of(physics).nominal_contact(0)
    view = view_of(with_rates(observations())[3], AXLES)
    deviations = torch.zeros(physics.uncertain_constants + 2, dtype=torch.float64)
    found = physics.drive_row(view, contact.constants, contact.varied, deviations)
    nominal = drive_row(view.slip, view.sinkage, view.contact_angle, contact)
    torch.testing.assert_close(found[:-2], nominal, rtol=1e-9, atol=1e-12)


def test_what_sensors_and_drives_do_is_undone_from_an_observation() -> None:
    """The formulas of the registry, inverted by hand."""
    packed = with_rates(observations()[:3])
    size = torch.tensor([[0.02]], dtype=torch.float64)

    def changed(name: str, values: torch.Tensor) -> dict[int, torch.Tensor]:
        rows = EffectRows([LAWS[name](LOADED.rover)], LOADED.rover.mass)
        rate = view_of(packed, AXLES).wheel_rate
        after = rows.corrected(Observed(packed, rate), values)
        return {k: after[:, k] for k in range(packed.shape[1]) if not _same(after, packed, k)}

    alone = changed("slope_bias", torch.tensor([[0.02, 0.0]], dtype=torch.float64))
    assert list(alone) == [8 * AXLES + 2]
    pitch = packed[:, 8 * AXLES + 2] - 0.02
    torch.testing.assert_close(alone[8 * AXLES + 2], pitch)
    unit = changed("slope_bias", torch.tensor([[0.02, 1.0]], dtype=torch.float64))
    assert list(unit) == [8 * AXLES + 2, 8 * AXLES + 4]
    weight = LOADED.rover.gravity * (torch.sin(pitch + 0.02) - torch.sin(pitch))
    torch.testing.assert_close(unit[8 * AXLES + 4], packed[:, 8 * AXLES + 4] - weight)
    torque = changed("drive_drag", size)
    assert list(torque) == [6 * AXLES + axle for axle in range(AXLES)]
    for place, value in torque.items():
        torch.testing.assert_close(value, packed[:, place] - 0.02 * 1.3)
    dry = changed("coulomb_drag", size)
    for place, value in dry.items():
        torch.testing.assert_close(value, packed[:, place] - 0.02)
    sinkage = changed("sinkage_bias", 0.1 * size)
    assert list(sinkage) == [2 * AXLES + axle for axle in range(AXLES)]
    for place, value in sinkage.items():
        expected = torch.maximum(packed[:, place] - 0.002, 0.2 * packed[:, place])
        torch.testing.assert_close(value, expected)
    slip = changed("odometry_scale", torch.tensor([[0.05, 0.4]], dtype=torch.float64))
    assert list(slip) == list(range(2 * AXLES))
    for axle in range(AXLES):
        error = 0.05 * (1.0 + 0.4 * (axle - 1.0))
        expected = (1.0 + error) * packed[:, axle] - error
        torch.testing.assert_close(slip[axle], expected.clamp(-0.6, 0.95))
        deviation = packed[:, AXLES + axle]
        torch.testing.assert_close(slip[AXLES + axle], (1.0 + error) * deviation)


def _same(after: torch.Tensor, before: torch.Tensor, column: int) -> bool:
    return bool(np.array_equal(after[:, column], before[:, column], equal_nan=True))


def test_a_load_makes_the_rover_heavier_and_moves_its_centre() -> None:
    contact = nominal_of(restore(LOADED).physics).nominal_contact()
    mass, moments = 25.0, (3.0, -2.0)
    values = torch.tensor([[mass, *moments]], dtype=torch.float64)
    rows = EffectRows([LAWS["payload"](LOADED.rover)], LOADED.rover.mass)
    loaded = rows.loaded(contact, values)
    total = LOADED.rover.mass + mass
    torch.testing.assert_close(loaded.body_scale[0], contact.body_scale * LOADED.rover.mass / total)
    shift = torch.tensor(moments, dtype=torch.float64) / total
    torch.testing.assert_close(loaded.geometry.centre.flatten(), contact.geometry.centre + shift)
    assert math.isclose(loaded.radius, contact.radius)
