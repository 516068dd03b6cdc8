# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sinkages that no sensor measures: what the balances say of them, and what is left of the rows."""

import functools
import math

import pytest
import torch
from scipy.stats import binomtest
from torch import Tensor

from studies.accuracy.scores import FROM_PRIOR, MeasuredDrives, draw_drives, observation_times
from studies.batched import run
from studies.sensors import SETS, Sensors, lacking_contact_angle, lacking_sinkage, mask
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.learning.tasks import CONSTANTS_SPREAD
from terrain_estimator.model.packing import view_of, with_sinkage_and_sd
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.rows import ContactModel, balances_of, frame_of, rows_at, values_alone
from terrain_estimator.model.unmeasured import (
    lacks_sinkage,
    usual_sinkage,
    with_balanced_sinkage,
    without_sinkage,
)
from terramechanics.presets import load_rover, load_soil

ROVERS = ("paper_rover", "mars_rover", "four_wheel_rover")
SOIL = load_soil("loose_sand")


@functools.cache
def model_of(name: str) -> PAlpaca:
    return physics_alone(load_rover(name), SOIL, exact=True)


@functools.cache
def exact_drives(name: str) -> MeasuredDrives:
    return draw_drives(load_rover(name), SOIL, "S1", 2, 0.0, 5, FROM_PRIOR, duration_s=4.0)


def one(name: str) -> tuple[Tensor, ContactModel, Tensor]:
    """Return exact observations [n, P] without sinkages, the contact model, the true theta [3]."""
    drives, physics = exact_drives(name), nominal_of(model_of(name).physics)
    packed = drives.tasks.true[0]
    missing = torch.full_like(view_of(packed, physics.axles).sinkage, math.nan)
    cohesion, friction = drives.tasks.strength[0].tolist()
    theta = torch.tensor([cohesion / 1000.0, friction, 1.0], dtype=torch.float64)
    return (
        with_sinkage_and_sd(packed, missing, missing),
        values_alone(physics.nominal_contact()),
        theta,
    )


@pytest.mark.parametrize("name", ROVERS)
def test_the_balances_give_the_true_sinkages(name: str) -> None:
    """The simulator solved the same balances with accelerations; inputs are exact."""
    packed, contact, theta = one(name)
    axles = contact.geometry.axle_x.shape[0]
    found = view_of(with_balanced_sinkage(packed, contact, theta), axles)
    true = view_of(exact_drives(name).tasks.true[0], axles).sinkage
    torch.testing.assert_close(found.sinkage, true, rtol=1e-5, atol=0.0)
    assert bool((found.sinkage_sd > 0.0).all())


def test_what_is_measured_stays_as_it_is() -> None:
    packed, contact, theta = one("mars_rover")
    true = exact_drives("mars_rover").tasks.true[0]
    mixed = torch.cat([true[:5], packed[5:10]])
    assert lacks_sinkage(mixed, 3).tolist() == [False] * 5 + [True] * 5
    found = with_balanced_sinkage(mixed, contact, theta)[:5]
    torch.testing.assert_close(found, true[:5], rtol=0.0, atol=0.0, equal_nan=True)


def test_one_missing_sinkage_is_as_all() -> None:
    packed, contact, theta = one("mars_rover")
    some = exact_drives("mars_rover").tasks.true[0].clone()
    view_of(some, 3).sinkage[:, 1] = math.nan
    assert torch.equal(
        view_of(with_balanced_sinkage(some, contact, theta), 3).sinkage,
        view_of(with_balanced_sinkage(packed, contact, theta), 3).sinkage,
    )


def test_a_missing_slip_leaves_no_number_that_could_be_taken_for_one() -> None:
    packed, contact, theta = one("mars_rover")
    view_of(packed, 3).slip[3, 1] = math.nan
    physics = nominal_of(model_of("mars_rover").physics)
    rows = physics.rows(packed, contact, theta, torch.ones(8, dtype=torch.float64))
    assert rows.used[3].tolist() == [0.0] * 8
    assert rows.used[4, 0] == 1.0
    assert bool(torch.isfinite(rows.features).all())


@pytest.mark.parametrize("name", ROVERS)
def test_rows_without_sinkages_change_as_rows_solved_anew(name: str) -> None:
    """Their columns of c and tan phi are total derivatives: the sinkages move along."""
    packed, contact, theta = one(name)
    axles = contact.geometry.axle_x.shape[0]
    missing = lacks_sinkage(packed, axles)

    def solved(at: Tensor) -> Tensor:
        """Return the rows at their own sinkages, without what the sensors say [n, R]."""
        balanced = with_balanced_sinkage(packed, contact, at)
        return rows_at(frame_of(balanced, contact), balanced, contact).features[0] @ at

    balanced = with_balanced_sinkage(packed, contact, theta)
    rows = without_sinkage(rows_at(frame_of(balanced, contact), balanced, contact), missing, theta)
    assert balances_of(rows.used, 1, axles).sum() == 0.0
    for parameter, step in ((0, 1e-3), (1, 1e-4)):
        moved = theta.clone()
        moved[parameter] += step
        back = theta.clone()
        back[parameter] -= step
        total = (solved(moved) - solved(back)) / (2.0 * step) * rows.used
        column = rows.features[0, ..., parameter] * rows.used
        scale = float(total.abs().max())
        torch.testing.assert_close(column, total, rtol=0.0, atol=2e-3 * scale)
        # the sinkages matter: without them the column is another one
        fixed = rows_at(frame_of(balanced, contact), balanced, contact)
        still = fixed.features[0, ..., parameter] * rows.used
        assert float((still - total).abs().max()) > 0.05 * scale


@pytest.mark.parametrize("name", ROVERS)
def test_a_soil_constant_changes_the_rows_as_rows_solved_anew(name: str) -> None:
    """The sinkages move along; only the change of the whole row is a derivative."""
    packed, _, theta = one(name)
    physics = nominal_of(physics_alone(load_rover(name), SOIL, exact=False).physics)
    axles, none = physics.axles, torch.zeros(physics.uncertain_constants, dtype=torch.float64)
    missing = lacks_sinkage(packed, axles)

    def solved(deviations: Tensor) -> Tensor:
        contact = values_alone(physics.contact(0, deviations))
        balanced = with_balanced_sinkage(packed, contact, theta)
        return rows_at(frame_of(balanced, contact), balanced, contact).features[0] @ theta

    contact = physics.contact(0, none)
    balanced = with_balanced_sinkage(packed, values_alone(contact), theta)
    rows = without_sinkage(rows_at(frame_of(balanced, contact), balanced, contact), missing, theta)
    assert not rows.features[1:, ..., :2].any()
    assert not rows.noise[1:, ..., :2].any()
    for constant in range(none.shape[0]):
        moved = none.clone()
        moved[constant] = 0.01
        total = (solved(moved) - solved(-moved)) / 0.02 * rows.used
        column = (rows.features[1 + constant] @ theta) * rows.used
        scale = float(total.abs().max())
        torch.testing.assert_close(column, total, rtol=0.0, atol=5e-3 * scale)


def test_the_usual_sinkage_carries_an_even_share_of_the_weight() -> None:
    for name in ROVERS:
        _, contact, _ = one(name)
        drives = exact_drives(name).tasks.true[0]
        true = view_of(drives, contact.geometry.axle_x.shape[0]).sinkage.mean()
        assert 0.3 < float(usual_sinkage(contact)) / float(true) < 3.0


@pytest.mark.parametrize(
    ("name", "sensors", "spread"),
    [
        ("paper_rover", SETS[4], 0.0),
        ("four_wheel_rover", SETS[4], CONSTANTS_SPREAD),
        ("four_wheel_rover", SETS[6], 0.0),
    ],
)
def test_intervals_hold_without_sinkage(name: str, sensors: Sensors, spread: float) -> None:
    """40 drives of 20 s: 95 % intervals that held in under 85 % would fail with 95 % confidence."""
    rover, drives = load_rover(name), 40
    model = physics_alone(rover, SOIL, exact=spread == 0.0)
    drawn = draw_drives(rover, SOIL, "S1", drives, spread, 11, FROM_PRIOR, duration_s=20.0)
    lacking = lacking_sinkage(drawn, model.axles)
    assert not sensors.sinkage
    if not sensors.contact_angle:
        lacking = lacking_contact_angle(lacking, model)
    trace = run(
        model,
        lacking.tasks.measured,
        observation_times((20.0,)),
        lacking.ends,
        mask(sensors, model.axles),
    )
    sd = trace.covariance[:, -1].diagonal(dim1=-2, dim2=-1).sqrt()
    holds = ((trace.mean[:, -1] - drawn.tasks.strength).abs() < 1.96 * sd).sum(0).tolist()
    for count in holds:
        assert binomtest(count, drives, 0.95).proportion_ci(0.95).high > 0.95, holds
    prior_sd = torch.tensor([1300.0, 0.22], dtype=torch.float64)
    assert float((sd / prior_sd).median()) < 0.5  # they tell something, too


def test_the_stream_gives_what_the_batch_gives_without_sinkage() -> None:
    model = model_of("mars_rover")
    drives = lacking_sinkage(exact_drives("mars_rover"), 3)
    measured = drives.tasks.measured
    trace = run(model, measured, torch.tensor([39]))
    for drive in range(2):
        state = model.initial()
        for packed in measured[drive]:
            state = model.update(state, packed)
        assert bool(state["usable"].all())
        estimate = model.estimate(state)
        torch.testing.assert_close(estimate[0], trace.mean[drive, -1], rtol=1e-9, atol=0.0)
        torch.testing.assert_close(estimate[1:], trace.covariance[drive, -1], rtol=1e-8, atol=0.0)


def test_a_block_may_lack_some_of_its_sinkages() -> None:
    model = model_of("mars_rover")
    measured = exact_drives("mars_rover").tasks.measured[0].clone()
    view_of(measured, 3).sinkage[3:7] = math.nan
    state = model.initial()
    for packed in measured:
        state = model.update(state, packed)
    estimate = model.estimate(state)
    assert bool(torch.isfinite(estimate).all())
    whole = model.initial()
    for packed in exact_drives("mars_rover").tasks.measured[0]:
        whole = model.update(whole, packed)
    both = model.estimate(whole)
    sd = both[1:].diagonal().sqrt()
    assert bool(((estimate[0] - both[0]).abs() < 3.0 * sd).all())
