# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of many wheels in chunks are those of all wheels at once."""

import pytest
import torch
from torch import Tensor

from terramechanics.contact.stresses import (
    CHUNK,
    compiled_wheel_forces,
    compiled_wheel_torque,
    many_wheel_forces,
    quadrature,
)
from terramechanics.presets import load_soil

RADIUS, WIDTH = 0.13, 0.1
NODES = quadrature()
COUNT = 3 * CHUNK + 5


def drawn(low: float, high: float, shape: tuple[int, ...], seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("angled", [False, True])
def test_driven_wheels_have_the_same_bytes(angled: bool) -> None:  # noqa: FBT001
    constants = load_soil("loose_sand").constants()
    slip, sinkage = drawn(0.0, 0.8, (COUNT,), 1), drawn(0.005, 0.05, (COUNT,), 2)
    angles = (drawn(0.0, 0.3, (COUNT,), 3), drawn(0.0, 0.5, (COUNT,), 4)) if angled else ()
    given = (slip, sinkage, constants, RADIUS, WIDTH, NODES, *angles)
    assert torch.equal(many_wheel_forces(*given), compiled_wheel_forces()(*given))


def test_braked_wheels_and_their_neighbours_differ_by_rounding() -> None:
    constants = load_soil("regolith").constants()
    slip, sinkage = drawn(-0.4, 0.8, (COUNT,), 1), drawn(0.005, 0.05, (COUNT,), 2)
    slip[CHUNK : 2 * CHUNK].abs_()  # a chunk without braked wheels
    given = (slip, sinkage, constants, RADIUS, WIDTH, NODES)
    expected = compiled_wheel_forces()(*given)
    difference = (many_wheel_forces(*given) - expected).abs().amax(0)
    assert (difference <= 1e-14 * expected.abs().amax(0)).all()


def test_shapes_broadcast() -> None:
    varied = load_soil("loose_sand").constants() * drawn(0.9, 1.1, (3, 1, 1, 6), 5)
    slip, sinkage = drawn(0.0, 0.8, (2000, 1), 1), drawn(0.005, 0.05, (2000, 3), 2)
    found = many_wheel_forces(slip, sinkage, varied, RADIUS, WIDTH, NODES)
    assert found.shape == (3, 2000, 3, 3, 3)
    expected = compiled_wheel_forces()(slip, sinkage, varied, RADIUS, WIDTH, NODES)
    torch.testing.assert_close(found, expected, rtol=1e-14, atol=0.0)


@pytest.mark.parametrize("lowest", [0.0, -0.4])
@pytest.mark.parametrize("angled", [False, True])
def test_the_torque_alone_is_that_of_all_forces(lowest: float, angled: bool) -> None:  # noqa: FBT001
    constants = load_soil("loose_sand").constants()
    slip, sinkage = drawn(lowest, 0.8, (300,), 1), drawn(0.005, 0.05, (300,), 2)
    angles = (drawn(0.0, 0.3, (300,), 3), drawn(0.0, 0.5, (300,), 4)) if angled else ()
    given = (slip, sinkage, constants, RADIUS, WIDTH, NODES, *angles)
    expected = compiled_wheel_forces()(*given)[:, 2, :2]
    torch.testing.assert_close(compiled_wheel_torque()(*given), expected, rtol=1e-13, atol=0.0)
