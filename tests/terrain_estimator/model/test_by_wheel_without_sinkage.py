# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A model by wheel whose sinkages no sensor measures."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
import torch
from torch import Tensor

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.by_wheel import build_model_by_wheel
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.row_names import row_names_by_wheel
from terrain_estimator.model.unmeasured_by_wheel import spent_rows
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update
from tests.terrain_estimator.model.test_by_wheel import (  # noqa: F401 (fixtures)
    LOOSE,
    SKID,
    STEERED,
    exact,
    observations,
    packed,
    places_of,
    skid,
    steered,
)
from tests.turning_drives import Twist

WITHOUT = CoreConfig(use_sinkage=False)
TRUTH = torch.tensor([LOOSE.cohesion / 1e3, LOOSE.tan_phi], dtype=torch.float64)


def twin_of(model: LoadedModel) -> PAlpaca:
    places = places_of(model.rover, steered=any(model.metadata.steered))
    return build_model_by_wheel(model.rover, places, [LOOSE])


def blind(observed: Sequence[Observation]) -> list[Observation]:
    none = np.full_like(observed[0].slip, np.nan)
    return [dataclasses.replace(each, sinkage=none, sinkage_sd=none) for each in observed]


def missed(twin: PAlpaca, block: Tensor, at: Tensor, of: Tensor) -> Tensor:
    """Return what the rows [Q] miss at the strength ``of``, evaluated at the strength ``at``."""
    expansion = torch.cat([at, torch.zeros(twin.layout.constants, dtype=torch.float64)])
    rows = twin.physics.average(block, twin.learnt(block), 0, expansion, twin.every_row).rows
    return rows.present * (rows.target - rows.offset - rows.linear[:, :2] @ of)


def driven(model: LoadedModel, observed: Sequence[Observation]) -> list[Update]:
    estimator = Estimator(model, WITHOUT)
    return [estimator.update(each) for each in observed]


def test_balances_and_the_torque_of_one_wheel_of_an_axle_are_spent() -> None:
    rows = row_names_by_wheel(6, 1)
    spent, telling = spent_rows(rows, [0, 0, 1, 1, 2, 2])
    names = {rows[place] for place in spent}
    assert names == {"load", "moment", "bogie_moment", "torque_0", "torque_2", "torque_4"}
    told = {rows[place] for place in telling}
    assert told == {"load", "moment", "bogie_moment", "roll_moment"}


@pytest.mark.parametrize(
    ("name", "turn", "lean"),
    [("skid", (0.25, 0.4), 0.0), ("skid", (0.25, 0.0), 0.2), ("steered", (0.08, 0.04), 0.0)],
)
def test_rows_hold_at_the_truth_and_change_as_their_columns_say(
    name: str, turn: Twist, lean: float, request: pytest.FixtureRequest
) -> None:
    """Without noise, with the exact soil, where the sinkages drop out of all rows.

    Across a slope they are expanded at sinkages that are alike in front and behind.
    """
    model: LoadedModel = request.getfixturevalue(name)
    found = [exact(each) for each in observations(model, [turn], 8.0, noise=0.0, lean=lean)[-10:]]
    twin, block = twin_of(model), packed(model, blind(found))
    short = missed(twin, block, TRUTH, TRUTH)
    velocity = short[1:2]  # over the block, in m/s
    assert velocity.abs() < 2e-3
    assert short[2:].abs().max() < (0.01 if lean else 2e-3)  # of 5 N m
    for parameter, step in ((0, 0.02), (1, 0.004)):
        other = TRUTH.clone()
        other[parameter] += step
        predicted = missed(twin, block, TRUTH, other) - short
        anew = missed(twin, block, other, other) - short
        assert predicted.abs().max() > 0.01
        assert (predicted - anew).abs().max() < 0.02 * predicted.abs().max()


def test_sinkages_are_found_where_the_rows_hold(
    skid: LoadedModel,  # noqa: F811
) -> None:
    found = [exact(each) for each in observations(skid, [(0.25, 0.3)], 8.0, noise=0.0)[-10:]]
    physics = twin_of(skid).physics
    assert isinstance(physics, PhysicsByWheel)
    block, theta = packed(skid, blind(found)), torch.cat([TRUTH, torch.ones_like(TRUTH[:1])])
    missing = torch.ones(10, 4, dtype=torch.bool)
    sunk = physics.with_sinkages(block, missing, physics.nominal.nominal_contact(), theta)
    true = torch.from_numpy(np.array([each.sinkage for each in found]))
    assert view_of(sunk, 4).sinkage.numpy() == pytest.approx(true.numpy(), rel=0.02)


@pytest.mark.parametrize(("name", "twists"), [("skid", SKID), ("steered", STEERED)])
def test_intervals_hold_in_turns(
    name: str, twists: tuple[Twist, ...], request: pytest.FixtureRequest
) -> None:
    """3 drives of 32 s: with 95 % intervals 2 or more misses of 6 have a probability of 3 %."""
    model: LoadedModel = request.getfixturevalue(name)
    truth, held = np.array([LOOSE.cohesion, LOOSE.tan_phi]), []
    rows = usable_rows(model.rows, WITHOUT)
    for seed in range(3):
        updates = driven(model, blind(observations(model, twists, 8.0, seed=seed)))
        assert all(each.decision.outcome is Outcome.ACCEPTED for each in updates)
        estimate = updates[-1].estimate
        held += ((estimate.lower_95 <= truth) & (truth <= estimate.upper_95)).tolist()
        assert np.sqrt(np.diag(estimate.covariance))[1] < 0.1
        assert {status_of(each, rows) for each in updates}.isdisjoint({Status.IDENTIFIED})
        assert "nothing tells a drag of the drives" in updates[-1].unconfirmed
    assert sum(held) >= 5


@pytest.mark.parametrize("turn", [(0.25, 0.0), (0.25, 0.3)])
def test_a_shifted_centre_of_mass_is_what_its_parameters_say(
    skid: LoadedModel,  # noqa: F811
    turn: Twist,
) -> None:
    """Across a slope, to first order: what a shift of 4 mm leaves in the rows is of the second."""
    shift, names = (0.004, -0.003), skid.metadata.parameters
    found = [
        [exact(each) for each in observations(skid, [turn], 8.0, noise=0.0, lean=0.2, shift=each)]
        for each in ((0.0, 0.0), shift)
    ]
    twin = twin_of(skid)
    expansion = torch.cat([TRUTH, torch.zeros(twin.layout.constants, dtype=torch.float64)])
    short, columns = [], torch.zeros(0)
    for drive in found:
        block = packed(skid, blind(drive[-10:]))
        rows = twin.physics.average(block, twin.learnt(block), 0, expansion, twin.every_row).rows
        short.append(rows.target - rows.offset - rows.linear[:, :2] @ TRUTH)
        columns = rows.linear
    ahead, aside = (
        columns[:, names.index(each)] for each in ("centre_of_mass", "centre_of_mass_y")
    )
    told = ahead * shift[0] + aside * shift[1]
    missed = short[1] - short[0]
    order = row_names_by_wheel(4, 0)
    for row in ("yaw_rate", "roll_moment", "torque_1", "torque_3"):
        at = 1 + order.index(row)
        assert abs(float(missed[at] - told[at])) < 0.15 * abs(float(missed[at])) + 3e-5, row


def test_a_centre_of_mass_that_is_off_does_not_fool_it_across_a_slope(
    skid: LoadedModel,  # noqa: F811
) -> None:
    """3 drives of 30 s, 5 mm: with 95 % intervals 2 or more misses of 6 happen in 3 %."""
    truth, held = np.array([LOOSE.cohesion, LOOSE.tan_phi]), []
    for seed in range(3):
        drive = observations(skid, [(0.25, 0.0)], 30.0, seed=seed, lean=0.2, shift=(-0.005, 0.0))
        estimate = driven(skid, blind(drive))[-1].estimate
        held += ((estimate.lower_95 <= truth) & (truth <= estimate.upper_95)).tolist()
    assert sum(held) >= 5


def test_a_wheel_that_spins_on_the_spot_is_refused(
    skid: LoadedModel,  # noqa: F811
) -> None:
    estimator = Estimator(skid, WITHOUT)
    good = observations(skid, [(0.25, 0.1)], 0.2)
    slip = np.array([0.3, 0.95, 0.3, 0.3])
    spinning = dataclasses.replace(good[1], slip=slip, slip_sd=np.full(4, 0.02))
    estimator.update(blind(good)[0])
    decision = estimator.update(blind([spinning])[0]).decision
    assert decision.outcome is Outcome.OUT_OF_RANGE
    assert decision.detail == "wheel front_right: slip 0.95 is too near to 1 without a sinkage"
    assert Estimator(skid, CoreConfig()).update(spinning).decision.outcome is Outcome.ACCEPTED


def test_sinkages_now_and_then_confirm_nothing(
    skid: LoadedModel,  # noqa: F811
) -> None:
    """Half of the judged seconds have to have a load row."""
    drive = observations(skid, SKID, 8.0)
    for period, confirmed in ((20, True), (50, False)):
        lost, estimator = blind(drive), Estimator(skid, CoreConfig())
        mixed = [
            good if at % period < 10 else bad
            for at, (good, bad) in enumerate(zip(drive, lost, strict=True))
        ]
        last = [estimator.update(each) for each in mixed][-1]
        assert ("nothing tells a drag of the drives" in last.unconfirmed) != confirmed


def test_the_used_rows_are_those_that_are_left(
    skid: LoadedModel,  # noqa: F811
) -> None:
    used = driven(skid, blind(observations(skid, [(0.25, 0.1)], 1.0)))[-1].decision.rows_used
    assert set(used).isdisjoint({"load", "moment"})
    assert {"velocity", "torque_1", "roll_moment", "lateral_velocity", "yaw_rate"} <= set(used)


def test_one_missing_sinkage_costs_those_of_all_wheels_and_needs_the_torques(
    skid: LoadedModel,  # noqa: F811
) -> None:
    estimator = Estimator(skid, CoreConfig())
    good = observations(skid, [(0.25, 0.1)], 0.3)
    estimator.update(good[0])
    lost = np.where(np.arange(4) == 2, np.nan, good[1].sinkage)
    decision = estimator.update(dataclasses.replace(good[1], sinkage=lost)).decision
    assert decision.outcome is Outcome.ACCEPTED_PARTIALLY
    assert decision.detail == "wheel rear_left: sinkage is nan: the balances tell that of all"
    torque = np.where(np.arange(4) == 1, np.nan, good[2].torque)
    decision = estimator.update(dataclasses.replace(good[2], sinkage=lost, torque=torque)).decision
    assert decision.outcome is Outcome.NOT_FINITE
    assert "wheel rear_left: sinkage is nan; to do without it, measure" in decision.detail
    assert "torque" in decision.detail
