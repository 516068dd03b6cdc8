# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The training loss against the recursion that it replaces."""

import math

import pytest
import torch

from terrain_estimator.learning.loss import (
    log_marginal,
    negative_log_predictive,
    overlap,
    span_share,
    whiten,
)

GENERATOR = torch.Generator().manual_seed(4)


def randn(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=GENERATOR, dtype=torch.float64)


def test_log_marginal_is_the_sum_of_the_recursions_one_step_predictives() -> None:
    """Banerjee et al. eqs. 20 to 23, one row at a time."""
    features, target = randn(1, 15, 3), randn(1, 15)
    mean, precision = randn(3), torch.tensor([0.5, 2.0, 1.0], dtype=torch.float64)
    Lambda, q, total = (
        torch.diag(precision),
        torch.diag(precision) @ mean,
        torch.zeros((), dtype=torch.float64),
    )
    for phi, x in zip(features[0], target[0], strict=True):
        spread = 1.0 + phi @ torch.linalg.solve(Lambda, phi)
        total = total - 0.5 * (
            (x - phi @ torch.linalg.solve(Lambda, q)) ** 2 / spread
            + torch.log(2 * math.pi * spread)
        )
        Lambda, q = Lambda + torch.outer(phi, phi), q + phi * x
    torch.testing.assert_close(
        log_marginal(features, target, torch.ones(1, 15, dtype=torch.float64), mean, precision)[0],
        total,
    )


def test_rows_without_weight_do_not_count() -> None:
    features, target = randn(2, 6, 2), randn(2, 6)
    weight = torch.tensor([1.0, 1.0, 1.0, 1.0, 0.0, 0.0], dtype=torch.float64).expand(2, 6)
    mean, precision = torch.zeros(2, dtype=torch.float64), torch.ones(2, dtype=torch.float64)
    short = log_marginal(
        features[:, :4], target[:, :4], torch.ones(2, 4, dtype=torch.float64), mean, precision
    )
    torch.testing.assert_close(log_marginal(features, target, weight, mean, precision), short)


def test_a_context_makes_the_rest_of_a_task_more_likely() -> None:
    """One parameter of spread 3 under unit noise, 200 tasks: 10 blocks determine it to 0.3."""
    features = torch.ones(200, 12, 1, 1, dtype=torch.float64)
    target = 3.0 * randn(200, 1, 1) + randn(200, 12, 1)
    valid, zero = torch.ones(200, 12, dtype=torch.float64), torch.zeros(1, dtype=torch.float64)
    precision = torch.full((1,), 1.0 / 9.0, dtype=torch.float64)
    losses = [
        negative_log_predictive(features, target, valid, torch.full((200,), n), zero, precision)
        for n in (0, 10)
    ]
    # unit noise alone costs 1.419 nat, its standard error over 400 rows is 0.035
    assert abs(float(losses[1]) - 1.419 - 0.05) < 0.15
    assert losses[0] > losses[1]


def test_overlap_is_the_squared_cosine() -> None:
    nominal = torch.zeros(1, 2, 1, 2, dtype=torch.float64)
    nominal[0, 0, 0, 0] = nominal[0, 1, 0, 1] = 2.0
    learnt = torch.ones(1, 2, 1, 1, dtype=torch.float64)
    assert float(overlap(nominal, learnt, torch.ones(1, 2, dtype=torch.float64))) == pytest.approx(
        0.5
    )


def test_whitened_columns_and_their_cost_give_the_density_of_the_rows() -> None:
    root = randn(4, 4)
    covariance, noise, residual = (
        root @ root.T + torch.eye(4, dtype=torch.float64),
        torch.tensor([0.1, 0.0, 2.0, 0.3]).double(),
        randn(4),
    )
    zero = torch.zeros(4, dtype=torch.float64)
    (whitened, cost), (plain, free) = (
        whiten(residual.unsqueeze(-1), covariance, extra) for extra in (noise, zero)
    )
    assert float(free) == 0.0
    expected, without = (
        torch.distributions.MultivariateNormal(zero, covariance + torch.diag(extra)).log_prob(
            residual
        )  # type: ignore[no-untyped-call]
        for extra in (noise, zero)
    )
    torch.testing.assert_close(
        -0.5 * (whitened.square().sum() - plain.square().sum()) - cost, expected - without
    )


def test_the_span_share_is_one_inside_the_nominal_span_and_zero_across_it() -> None:
    nominal, valid = randn(3, 6, 2, 2), torch.ones(3, 6, dtype=torch.float64)
    inside = nominal @ randn(2, 4)
    flat = nominal.flatten(1, 2)
    other = randn(3, 12, 4)
    across = (other - flat @ torch.linalg.lstsq(flat, other).solution).unflatten(1, (6, 2))
    assert float(span_share(nominal, inside, valid)) == pytest.approx(1.0)
    assert float(span_share(nominal, across, valid)) == pytest.approx(0.0, abs=1e-12)
