# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Branches under torch.vmap."""

import torch

from terrain_estimator.model.gaussian import cholesky
from terramechanics.contact.stresses import quadrature, wheel_forces
from terramechanics.numerics.batching import any_of
from terramechanics.presets import load_soil


def test_one_flag_in_one_mapped_call_decides_for_all() -> None:
    def branch(flags: torch.Tensor) -> torch.Tensor:
        return torch.ones(1) if any_of(flags) else torch.zeros(1)

    flags = torch.zeros(3, 2, dtype=torch.bool)
    assert torch.equal(torch.vmap(branch)(flags), torch.zeros(3, 1))
    flags[1, 0] = True
    assert torch.equal(torch.vmap(branch)(flags), torch.ones(3, 1))


def test_mapped_wheel_forces_equal_those_of_each_wheel_alone() -> None:
    constants, nodes = load_soil("loose_sand").constants(), quadrature()
    slip = torch.tensor([-0.2, 0.1, 0.5], dtype=torch.float64)
    sinkage = torch.full_like(slip, 0.01)
    mapped = torch.vmap(lambda i, z: wheel_forces(i, z, constants, 0.13, 0.16, nodes))(
        slip, sinkage
    )
    alone = torch.stack(
        [
            wheel_forces(i, z, constants, 0.13, 0.16, nodes)
            for i, z in zip(slip, sinkage, strict=True)
        ]
    )
    torch.testing.assert_close(mapped, alone, rtol=1e-12, atol=1e-12)


def test_one_bad_matrix_leaves_the_factors_of_the_others_alone() -> None:
    matrix = torch.eye(3, dtype=torch.float64).repeat(4, 1, 1)
    matrix[2, 0, 0] = torch.nan
    factors = torch.vmap(cholesky)(matrix)
    assert torch.equal(factors[[0, 1, 3]], matrix[[0, 1, 3]])
    assert bool(torch.isnan(factors[2]).any())
