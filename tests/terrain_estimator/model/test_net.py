# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The learnt columns stand at the rows that they are of."""

import pytest
import torch
from torch import Tensor

from terrain_estimator.model.net import NetFeatures

AXLES, COLUMNS = 3, 2


def columns(rows: int) -> tuple[Tensor, Tensor]:
    """Return the columns of five observations, and those that the net computes."""
    torch.manual_seed(2)
    scale = torch.linspace(1.0, 2.0, rows, dtype=torch.float64)
    net = NetFeatures(AXLES, COLUMNS, 4, 0.02, scale)
    wheels = torch.rand(3, 5, AXLES, dtype=torch.float64)
    with torch.no_grad():
        inputs = (*wheels.unbind(0), torch.rand(5, 1, dtype=torch.float64))
        return net(*inputs), net.distinct(*inputs)


def test_inputs_are_scaled_to_order_one() -> None:
    """Slips of 0.3, sinkages of the given size, angles of 0.1 rad."""
    net = NetFeatures(AXLES, COLUMNS, 4, 0.02, torch.ones(AXLES + 2, dtype=torch.float64))
    expected = [*[0.3] * AXLES, *[0.02] * AXLES, *[0.1] * (AXLES + 1)]
    assert net.get_buffer("input_scale").tolist() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("moments", [False, True])
def test_the_acceleration_has_the_columns_of_the_velocity_and_moments_their_own(
    *, moments: bool
) -> None:
    """Rows: velocity, load, torques, acceleration, two moments; zeros where moments have none."""
    every, own = columns(AXLES + (4 if moments else 2))
    assert every.shape == (5, AXLES + 5, COLUMNS)
    before = AXLES + 2
    assert torch.equal(every[:, :before], own[:, :before])
    assert torch.equal(every[:, before], own[:, 0])
    expected = own[:, before:] if moments else torch.zeros(5, 2, COLUMNS, dtype=torch.float64)
    assert torch.equal(every[:, before + 1 :], expected)
    assert bool((own != 0.0).all())
