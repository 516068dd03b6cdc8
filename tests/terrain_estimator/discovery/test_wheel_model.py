# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The rows of a testbed's cells for many parameters at once."""

import dataclasses

import numpy as np
import pytest
import torch

from terrain_estimator.discovery.hypotheses.library import NOTHING, Hypothesis
from terrain_estimator.discovery.single_wheel.cells import (
    ROWS,
    Cells,
    Row,
    cells_of,
)
from terrain_estimator.discovery.single_wheel.fit import WheelModel, explain
from terrain_estimator.discovery.single_wheel.investigation import (
    competing,
    of_one_wheel,
    shown_by_one_wheel,
)
from tests.terrain_estimator.testbeds import RIG

SINGLES = of_one_wheel(shown_by_one_wheel())
LAWS = [*SINGLES, *(law for each in SINGLES for law in competing(each))]


def cells() -> Cells:
    """Return cells of a table in which effects may act, and of one of reference."""
    rows = [
        Row(table, "1", slip, load, 0.5 + slip, 0.01, 5.0, slip_angle=0.1)
        for table in ("measured", "reference")
        for load in (40.0, 90.0)
        for slip in (0.05, 0.3, 0.6)
    ]
    return cells_of(rows, frozenset({"reference"}))


@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{law.label} {law.effects[0].law_name}")
def test_cells_of_reference_have_the_rows_of_no_effect(law: Hypothesis) -> None:
    every, model, nothing = (
        cells(),
        WheelModel(RIG, NOTHING, law),
        WheelModel(RIG, NOTHING, NOTHING),
    )
    values = model.start()
    values[model.first :] = 0.5
    rows, plain = model.of(every, values), nothing.of(every, values[: model.first])
    reference = ~every.acts.numpy()
    assert rows[reference] == pytest.approx(plain[reference], rel=1e-9, abs=1e-12)
    assert np.abs(rows[~reference] - plain[~reference]).max() > 1e-6


@pytest.mark.parametrize("law", LAWS[:3], ids=lambda law: f"{law.label} {law.effects[0].law_name}")
def test_the_jacobian_is_that_of_single_differences(law: Hypothesis) -> None:
    every, model = cells(), WheelModel(RIG, law, NOTHING)
    values = model.start() + 0.1
    rows, by = model.jacobian(every, values)
    assert rows == pytest.approx(WheelModel(RIG, law, NOTHING).of(every, values), rel=1e-9)
    for parameter in range(len(values)):
        step = 1e-3 * np.eye(len(values))[parameter]
        ends = [model.of(every, values + sign * step) for sign in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / 2e-3
        error = np.abs(by[..., parameter] - slope).max(0)
        assert (error < 1e-3 * np.abs(slope).max(0) + 1e-6).all(), parameter


def test_the_rows_do_not_depend_on_what_was_asked_before() -> None:
    every, model = cells(), WheelModel(RIG, NOTHING, LAWS[0])
    values = model.start()
    first = model.of(every, values)
    model.of(every, values + 0.5)
    assert model.of(every, values) == pytest.approx(first, rel=1e-9, abs=1e-12)
    assert torch.isfinite(torch.from_numpy(first)).all()


def test_a_zero_of_the_lateral_force_that_is_free_is_found() -> None:
    """2 N besides what the model shows; one deviation of the zero is 2 N, repeatability 0.1 N."""
    free = dataclasses.replace(
        RIG, repeatability=(1e-3, 1.0, 0.1, 0.1), offset_sd=(0.0, 0.0, 2.0, 0.0)
    )
    every = cells()
    model = WheelModel(free, NOTHING, NOTHING)
    rows = torch.from_numpy(model.of(every, model.start()))
    rows[:, ROWS.index("lateral_force")] += 2.0
    found = explain(model, dataclasses.replace(every, measured=rows))
    [place] = [
        k for k, each in enumerate(free.sensor_errors) if each.name == "zero of lateral_force"
    ]
    zero = model.own - len(free.sensor_errors) + place
    assert found.values[zero] == pytest.approx(1.0, abs=0.1)
    assert found.covariance[zero, zero] < 0.1
