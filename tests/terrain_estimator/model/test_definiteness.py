# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A million random updates over nine orders of magnitude of noise, residuals and features."""

import torch
from torch import Tensor

from terrain_estimator.model.block import FIXED, BlockRows, Posterior, gauss_newton
from terrain_estimator.model.gaussian import drop, project
from tests.samples import sampled

POSTERIORS, BLOCKS = sampled(500, 5000), 200
ROWS, CONSTANTS = 9, 5
SIZE = 2 + CONSTANTS + FIXED - 1


def test_random_updates_keep_every_covariance_positive_definite() -> None:
    """A million updates in `make test-long`, a tenth of them else."""
    generator = torch.Generator().manual_seed(3)
    longest = torch.tensor([1.0, 0.25], dtype=torch.float64)
    mean = torch.randn(POSTERIORS, SIZE, generator=generator, dtype=torch.float64)
    precision = torch.eye(SIZE, dtype=torch.float64).expand(POSTERIORS, -1, -1)
    least = torch.inf
    for _ in range(BLOCKS):
        start = torch.cat([mean, mean[:, -1:]], 1)
        before = Posterior(start, torch.nn.functional.pad(precision, [0, 1, 0, 1]), mean[:, 0])
        step = gauss_newton(before, start, random_rows(generator), longest)
        mean, precision = drop(step.mean, step.precision, SIZE - 1)
        covariance = project(mean, precision, torch.eye(2, SIZE, dtype=torch.float64))[1]
        assert torch.isfinite(mean).all()
        torch.testing.assert_close(covariance, covariance.mT, rtol=0.0, atol=0.0)
        least = min(least, float(torch.linalg.eigvalsh(covariance).min()))
        assert least > 0.0
    assert least < 1e-6, "the updates were too weak to test anything"


def random_rows(generator: torch.Generator) -> BlockRows:
    """Rows in units that differ by eight orders of magnitude, with noise that depends on theta."""

    def normal(*shape: int) -> Tensor:
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    def power(low: float, high: float, *shape: int) -> Tensor:
        return 10.0 ** (
            low + (high - low) * torch.rand(shape, generator=generator, dtype=torch.float64)
        )

    unit = power(-4.0, 4.0, ROWS)
    sources = normal(1 + CONSTANTS, 3, ROWS, 12) * unit.unsqueeze(-1) * power(-3.0, 1.0, 1)
    gram = (
        (sources.flatten(0, 2) @ sources[0].flatten(0, 1).T)
        .view(-1, 3, ROWS, 3, ROWS)
        .permute(3, 0, 1, 2, 4)
        .flatten(1)
    )
    linear = normal(ROWS, SIZE + 1) * unit.unsqueeze(1)
    linear[:, 2 : 2 + CONSTANTS] = 0.0
    return BlockRows(
        linear=linear,
        offset=normal(ROWS) * unit,
        nuisance=0.1 * normal(3, ROWS * CONSTANTS) * unit.repeat_interleave(CONSTANTS),
        expansion=normal(CONSTANTS),
        gram=gram,
        target=normal(ROWS) * unit * power(-3.0, 3.0, 1),
        variance=(unit * power(-5.0, 1.0, 1)) ** 2,
        present=torch.ones(ROWS, dtype=torch.float64),
    )
