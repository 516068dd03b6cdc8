# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Gaussians in information form against plain covariances."""

import torch

from terrain_estimator.model.gaussian import cholesky, drop, log_determinant, mixture, project


def random_precision(size: int, seed: int) -> torch.Tensor:
    matrix = torch.randn(
        2, size, size + 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64
    )
    return matrix @ matrix.transpose(1, 2)


def test_dropping_a_parameter_keeps_the_covariance_of_the_others() -> None:
    precision, mean = random_precision(4, 1), torch.arange(8.0, dtype=torch.float64).view(2, 4)
    kept = [0, 1, 3]
    reduced_mean, reduced = drop(mean, precision, 2)
    expected = torch.linalg.inv(precision)[:, kept][:, :, kept]
    torch.testing.assert_close(torch.linalg.inv(reduced), expected)
    assert torch.equal(reduced_mean, mean[:, kept])


def test_projection_is_the_covariance_of_linear_functions() -> None:
    precision, directions = (
        random_precision(3, 2),
        torch.tensor([[1.0, 0.0, 2.0], [0.0, 1.0, -1.0]], dtype=torch.float64),
    )
    mean, covariance = project(torch.ones(2, 3, dtype=torch.float64), precision, directions)
    torch.testing.assert_close(covariance, directions @ torch.linalg.inv(precision) @ directions.T)
    torch.testing.assert_close(mean, torch.tensor([[3.0, 0.0]], dtype=torch.float64).expand(2, 2))


def test_mixture_has_the_moments_of_its_samples() -> None:
    """400 000 samples; the tolerance is five standard errors of the largest variance (2.0)."""
    generator = torch.Generator().manual_seed(3)
    weight = torch.tensor([0.3, 0.7], dtype=torch.float64)
    means, variances = (
        torch.tensor([[-1.0], [2.0]], dtype=torch.float64),
        torch.tensor([[[0.5]], [[1.5]]], dtype=torch.float64),
    )
    mean, covariance = mixture(weight.log(), means, variances)
    count = 400_000
    chosen = torch.multinomial(weight, count, replacement=True, generator=generator)
    samples = means[chosen, 0] + variances[chosen, 0, 0].sqrt() * torch.randn(
        count, generator=generator, dtype=torch.float64
    )
    assert abs(float(samples.mean() - mean)) < 5 * (3.1 / count) ** 0.5
    assert abs(float(samples.var() - covariance)) < 5 * 3.1 * (3.0 / count) ** 0.5


def test_a_matrix_that_rounding_made_indefinite_is_still_factored() -> None:
    vector = torch.tensor([[1.0, 1.0 + 1e-15]], dtype=torch.float64)
    matrix = vector.T @ vector
    matrix[1, 1] -= 1e-14
    assert bool(torch.isfinite(cholesky(matrix)).all())


def test_a_matrix_that_is_not_a_number_or_negative_gives_nan() -> None:
    for bad in (float("nan"), -1.0):
        assert bool(
            torch.isnan(cholesky(torch.diag(torch.tensor([1.0, bad], dtype=torch.float64)))).all()
        ), bad


def test_log_determinant_is_that_of_the_matrix() -> None:
    precision = random_precision(5, 4)
    torch.testing.assert_close(log_determinant(cholesky(precision)), torch.logdet(precision))
