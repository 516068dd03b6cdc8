# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows on simulated drives: exact without noise, unbiased with it."""

import pytest
import torch
from torch import Tensor

from studies.accuracy.scores import TIMES_S, MeasuredDrives, draw_drives, row_mask
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.rows import PA_PER_UNIT, Rows, frame_of, regression_rows, rows_at
from terramechanics.presets import load_rover, load_soil
from terramechanics.vehicle.rover import Rover
from tests.rovers import KINDS, MARS
from tests.samples import sampled

EPISODES = 20
NAMES = row_names(3)


def drives(soil: str, rover: Rover = MARS, seconds: float = TIMES_S[-1]) -> MeasuredDrives:
    return draw_drives(rover, load_soil(soil), "S1", EPISODES, 0.0, 11, duration_s=seconds)


def flat(observations: Tensor, found: MeasuredDrives) -> Tensor:
    """Observations [n, P] of all drives up to their ends."""
    return torch.cat([observations[drive, : int(end)] for drive, end in enumerate(found.ends)])


def strength(found: MeasuredDrives) -> Tensor:
    """theta [n, 3, 1] of each of those observations."""
    theta = torch.cat(
        [found.tasks.strength / torch.tensor([PA_PER_UNIT, 1.0]), torch.ones(EPISODES, 1)], 1
    ).to(torch.float64)
    return torch.cat(
        [theta[drive].expand(int(end), 3) for drive, end in enumerate(found.ends)]
    ).unsqueeze(-1)


@pytest.mark.parametrize("rover", KINDS, ids=lambda rover: rover.name)
def test_every_balance_of_the_simulated_rover_holds_at_the_true_inputs(rover: Rover) -> None:
    """The simulator solves the same equations to 1e-6 of the weight.

    It has twice the quadrature points; torques agree to a per mille.
    """
    found = drives("loose_sand", rover, seconds=10.0)
    packed = flat(found.tasks.true, found)
    model = physics_alone(rover, load_soil("loose_sand"), exact=True)
    names = row_names(rover.axles)
    balances = [row for row, name in enumerate(names) if name not in ("velocity", "acceleration")]
    assert ("bogie_moment" in names) == bool(rover.suspension)
    rows = regression_rows(packed, packed, nominal_of(model.physics).nominal_contact())
    predicted = (rows.features[0] @ strength(found)).squeeze(-1)
    scale = torch.where(
        rows.target.abs().amax(0) > 0.0,
        rows.target.abs().amax(0),
        torch.ones(len(names), dtype=torch.float64),
    )
    missed = ((rows.target - predicted) / scale * rows.used).abs().amax(0)
    assert float(missed[balances].max()) < 2e-4, dict(zip(names, missed.tolist(), strict=True))
    assert float(rows.used[:, balances].mean()) > 0.99


def test_rows_expanded_where_they_agree_are_unbiased_where_the_sinkage_is_shallow() -> None:
    """Rows expanded at measured inputs have torques 1 to 2 % too large on compact sand.

    The sinkage there is 1.3 mm, measured to 0.3 mm.
    20 drives, about 8000 observations: the mean is known to 0.2 % (one standard error), 0.8 % is
    four of them.
    """
    found = drives("compact_sand")
    model = physics_alone(load_rover("mars_rover"), load_soil("compact_sand"), exact=True)
    contact, every = (
        nominal_of(model.physics).nominal_contact(),
        torch.ones(len(NAMES), dtype=torch.float64),
    )
    measured, true, theta = (
        flat(found.tasks.measured, found),
        flat(found.tasks.true, found),
        strength(found),
    )
    exact = regression_rows(true, true, contact)

    def excess(rows: Rows) -> float:
        torque = slice(NAMES.index("torque_0"), NAMES.index("torque_2") + 1)
        both = ((rows.used * exact.used)[:, torque] > 0.0).all(1)
        means = [((x.features[0] @ theta).squeeze(-1)[both, torque]).mean() for x in (rows, exact)]
        return float(means[0] / means[1] - 1.0)

    prior = torch.tensor([2.75, 0.6, 1.0], dtype=torch.float64)
    assert excess(regression_rows(measured, measured, contact)) > 0.01
    assert abs(excess(nominal_of(model.physics).rows(measured, contact, prior, every))) < 0.008


@pytest.mark.parametrize("rows", sampled(["v+L+M"], ["v", "v+L", "v+L+M"]))
def test_curved_laws_do_not_shift_the_velocity_row_on_average(rows: str) -> None:
    """The error of a row that is not linear in the true errors has a small mean.

    It is over the row's noise, of 20 drives, about 8000 observations. Its mean is within four
    standard errors of a quarter of what it is where the place of expansion is taken for certain.
    """
    found = drives("loose_sand")
    model, axles = physics_alone(load_rover("mars_rover"), load_soil("loose_sand"), exact=True), 3
    contact, chosen = nominal_of(model.physics).nominal_contact(), row_mask(rows, axles)
    corrected: list[Tensor] = []
    certain: list[Tensor] = []
    for drive, end in enumerate(found.ends.tolist()):
        if not end:
            continue
        measured, true = found.tasks.measured[drive, :end], found.tasks.true[drive, :end]
        theta = strength(found)[int(found.ends[:drive].sum()), :, 0]
        exact = regression_rows(true, true, contact)
        linear = exact.noise[0, :, 0] @ theta  # [n, E]
        error_of, seen = view_of(measured - true, axles), view_of(measured, axles)
        wheels = [
            error_of.slip / seen.slip_sd,
            error_of.sinkage / seen.sinkage_sd,
            error_of.contact_angle / seen.contact_angle_sd,
        ]
        # the pitch is in the target
        known = exact.features[0, :, 0] @ theta + (linear[:, :-1] * torch.cat(wheels, 1)).sum(1)
        agreed = agreement(
            regression_rows(measured, measured, contact), measured, contact, theta, chosen
        )
        scale = linear.square().sum(1).sqrt()
        for shifts, doubt in ((corrected, agreed.doubt), (certain, torch.zeros_like(agreed.doubt))):
            found_rows = rows_at(frame_of(measured, contact), agreed.inputs, contact, doubt)
            both = (found_rows.used * exact.used)[:, 0] > 0.0
            shifts.append(((found_rows.features[0, :, 0] @ theta - known) / scale)[both])
    shift, before = torch.cat(corrected), torch.cat(certain)
    error = float(shift.std()) / shift.shape[0] ** 0.5
    assert float(before.mean()) < -8.0 * error
    assert abs(float(shift.mean())) < 0.25 * abs(float(before.mean())) + 4.0 * error
