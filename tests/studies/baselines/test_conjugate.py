# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The conjugate recursion and recursive least squares against solutions of other forms."""

import torch

from studies.baselines.conjugate import marginal_deviation, predict, regress
from studies.baselines.least_squares import DIFFUSE, recursive_least_squares

GENERATOR = torch.Generator().manual_seed(11)


def randn(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=GENERATOR, dtype=torch.float64)


def test_every_step_equals_a_textbook_kalman_filter() -> None:
    """Filter a constant state: gain, covariance update and innovation variance at unit noise."""
    features, target, mean = randn(2, 12, 3), randn(2, 12), randn(3)
    precision = torch.diag(torch.tensor([0.5, 2.0, 4.0], dtype=torch.float64))
    posterior = regress(features, target, mean, precision)
    expected, variance = predict(posterior, features)
    deviation = marginal_deviation(posterior, 2)
    for drive in range(2):
        k, P = mean, torch.diag(1.0 / precision.diagonal())
        for step in range(12):
            phi, x = features[drive, step], target[drive, step]
            torch.testing.assert_close(expected[drive, step], phi @ k)
            torch.testing.assert_close(variance[drive, step], phi @ P @ phi)
            gain = P @ phi / (1.0 + phi @ P @ phi)
            k, P = k + gain * (x - phi @ k), P - torch.outer(gain, phi @ P)
            torch.testing.assert_close(posterior.mean[drive, step + 1], k)
            torch.testing.assert_close(deviation[drive, step + 1], P.diagonal()[:2].sqrt())


def test_recursive_least_squares_ends_at_the_batch_solution() -> None:
    features, target = randn(3, 30, 2), randn(3, 30)
    batch = torch.linalg.lstsq(features, target.unsqueeze(-1)).solution.squeeze(-1)
    torch.testing.assert_close(
        recursive_least_squares(features, target, 1.0)[:, -1], batch, rtol=1e-4, atol=1e-5
    )


def test_forgetting_weighs_a_row_by_its_age() -> None:
    features, target, forgetting = randn(1, 25, 2), randn(1, 25), 0.9
    weight = forgetting ** torch.arange(24, -1, -1, dtype=torch.float64)
    gathered = features[0].T @ (
        weight.unsqueeze(-1) * features[0]
    ) + forgetting**25 / DIFFUSE * torch.eye(2, dtype=torch.float64)
    expected = torch.linalg.solve(gathered, features[0].T @ (weight * target[0]))
    torch.testing.assert_close(
        recursive_least_squares(features, target, forgetting)[0, -1], expected, rtol=1e-6, atol=1e-8
    )
