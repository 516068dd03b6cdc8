# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The mean score at the truth of blocks that are tied by their velocities.

Rows that are linear in the noise of their columns, in chains of blocks whose c and tan phi are
known exactly. So the score of each is the precision of that prior times the shift of its mean, and
its average over chains has to be zero.
"""

import math

import pytest
import torch
from torch import Tensor

from studies import batched
from terrain_estimator.model.block import (
    FIXED,
    LINK_VARIANCE,
    LONGEST_CORRECTION,
    BlockRows,
    GaussNewtonStep,
    Posterior,
    Solution,
    block_rows,
    fixed_columns,
    row_noise,
    solution_of,
    without_apparent,
    without_velocity_bias,
)
from terrain_estimator.model.gaussian import drop
from terrain_estimator.model.row_names import row_names
from terrain_estimator.model.rows import Rows

CHAINS, BLOCKS, N = 4000, 60, 10
STEP_S, VELOCITY_SD = 0.1, 0.01
THETA = torch.tensor([2.0, 0.6, 1.0], dtype=torch.float64)
COLUMNS = torch.tensor([0.05, 0.3, -0.25], dtype=torch.float64)
CHANGE = torch.tensor([0.01, -0.1, 0.0], dtype=torch.float64)  # by one deviation of the input
KNOWN = 1e10  # precision of c and tan phi
SIZE = 1 + FIXED
LONGEST = torch.ones(2, dtype=torch.float64)


def chain_rows(velocity: Tensor, features: Tensor) -> BlockRows:
    """Return the rows of a block with measured velocities [n] and columns [n, 3]."""
    ones = torch.ones(N, 1, dtype=torch.float64)
    noise = CHANGE.expand(1, N, 1, 1, 3)
    rows = Rows(features.view(1, N, 1, 3), noise, 0.0 * ones, 0.0 * ones, ones, ones[:, None, :0])
    measured = torch.stack([velocity, torch.full_like(velocity, VELOCITY_SD**2)], 1)
    return block_rows(
        rows, ones[:, None, :0], STEP_S * ones[:, 0], measured, ones[:0, 0],
        fixed_columns(row_names(3), 1.0)[:2], LINK_VARIANCE,
    )  # fmt: skip


def before(posterior: Posterior) -> Posterior:
    """Return the posteriors without the velocity at the block's start."""
    mean, precision = torch.vmap(lambda m, p: drop(m, p, SIZE - 1))(
        posterior.mean, posterior.precision
    )
    return Posterior(mean, precision, posterior.log_weight)


def mean_z() -> tuple[Tensor, float]:
    """Return the mean score over its deviation [2] after all blocks, and its standard error."""
    generator = torch.Generator().manual_seed(3)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    mean = torch.cat([THETA[:2], torch.zeros(SIZE - 2, dtype=torch.float64)])
    precision = torch.diag(torch.tensor([KNOWN, KNOWN, 1.0, 1.0, 1.0, 1e-4], dtype=torch.float64))
    posterior = Posterior(
        mean.expand(CHAINS, 1, SIZE),
        precision.expand(CHAINS, 1, SIZE, SIZE),
        torch.zeros(CHAINS, 1, dtype=torch.float64),
    )
    speed = STEP_S * float(COLUMNS @ THETA)
    for block in range(BLOCKS):
        true = speed * torch.arange(block * N + 1, (block + 1) * N + 1)
        features = COLUMNS + normal(CHAINS, N, 1) * CHANGE
        rows = torch.vmap(chain_rows)(true + VELOCITY_SD * normal(CHAINS, N), features)
        posterior = before(batched.solve_blocks(posterior, rows, LONGEST).posterior)
    whole = torch.linalg.inv(posterior.precision[:, 0])[:, :2, :2]
    information = torch.linalg.inv(whole) - KNOWN * torch.eye(2, dtype=torch.float64)
    score = KNOWN * (posterior.mean[:, 0, :2] - THETA[:2])
    scale = information.mean(0).diagonal().sqrt()
    return score.mean(0) / scale, float((score / scale).std()) / math.sqrt(CHAINS)


def as_if_known(prior: Posterior, last: GaussNewtonStep, rows: BlockRows) -> Solution:
    """Return the solution of a block as if its last velocity were known for good."""
    step = without_apparent(last, rows)
    posterior = Posterior(step.mean, step.precision, prior.log_weight)
    return Solution(posterior, step.misfit)


def test_a_velocity_that_is_known_better_later_leaves_no_bias(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Over 4000 chains of 60 blocks: at most a fifth of the bias that was there, 99 % limits."""
    mended, error = mean_z()
    monkeypatch.setattr(batched, "solution_of", as_if_known)
    biased, _ = mean_z()
    assert float(biased.abs().min()) > 5.0 * error, (biased, error)
    assert bool((mended.abs() - 2.58 * error < 0.2 * biased.abs()).all()), (mended, biased, error)


def test_nothing_is_moved_where_the_columns_have_no_noise() -> None:
    generator = torch.Generator().manual_seed(4)
    velocity = torch.randn(N, generator=generator, dtype=torch.float64)
    rows = chain_rows(velocity, COLUMNS.expand(N, 3))
    rows = rows._replace(gram=0.0 * rows.gram)
    size = SIZE + 1
    mean = torch.randn(1, size, generator=generator, dtype=torch.float64)
    root = torch.eye(size, dtype=torch.float64).unsqueeze(0)
    noise = torch.diag(rows.variance.sqrt()).unsqueeze(0)
    step = GaussNewtonStep(mean, root, root, noise, mean[:, 0], mean[0, 0])
    assert torch.equal(without_velocity_bias(step, rows).mean, mean)


@pytest.mark.parametrize(("known", "held"), [(1e4, False), (1e-4, True)])
def test_no_block_is_corrected_by_more_than_half_a_deviation(
    known: float,
    held: bool,  # noqa: FBT001 # a case
) -> None:
    """As where the velocities are hardly known at all."""
    generator = torch.Generator().manual_seed(6)
    velocity = torch.randn(N, generator=generator, dtype=torch.float64)
    rows = chain_rows(velocity, COLUMNS + torch.rand(N, 1, generator=generator) * CHANGE)
    mean = torch.zeros(1, SIZE + 1, dtype=torch.float64)
    mean[0, :2] = THETA[:2]
    precision = torch.diag(
        torch.tensor([1.0, 20.0, 1.0, 1.0, 1.0, known, known], dtype=torch.float64)
    )
    theta = torch.cat([mean[:, :2], torch.ones(1, 1, dtype=torch.float64)], 1)
    noise = torch.linalg.cholesky(row_noise(rows, theta)[1])
    root = precision.sqrt().unsqueeze(0)
    step = GaussNewtonStep(mean, precision.unsqueeze(0), root, noise, mean[:, 0], mean[0, 0])
    moved = (without_velocity_bias(step, rows).mean - mean)[0]
    free = (without_velocity_bias(step, rows, longest=1e300).mean - mean)[0]
    assert (float(free @ precision @ free) > LONGEST_CORRECTION) == held
    if held:
        assert float(moved @ precision @ moved) == pytest.approx(LONGEST_CORRECTION)
        torch.testing.assert_close(moved / moved.norm(), free / free.norm())
    else:
        assert torch.equal(moved, free)


def test_the_solution_has_both_corrections() -> None:
    """First the apparent information is taken off, then the mean is moved."""
    generator = torch.Generator().manual_seed(5)
    velocity = torch.randn(N, generator=generator, dtype=torch.float64)
    rows = chain_rows(velocity, COLUMNS + torch.rand(N, 1, generator=generator) * CHANGE)
    start = torch.zeros(1, SIZE, dtype=torch.float64)
    prior = Posterior(start, torch.eye(SIZE, dtype=torch.float64).unsqueeze(0), start[:, 0])
    from_here = torch.cat([start, start[:, :1]], 1)
    root = torch.eye(SIZE + 1, dtype=torch.float64).unsqueeze(0)
    step = GaussNewtonStep(
        from_here + 1.0, 9.0 * root, 3.0 * root, root[:, :2, :2], start[:, 0], start[0, 0]
    )
    wanted = without_velocity_bias(without_apparent(step, rows), rows)
    found = solution_of(prior, step, rows).posterior
    assert torch.equal(found.mean, wanted.mean)
    assert not torch.equal(found.mean, step.mean)
