# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Gaussians in information form: each function against its definition, in plain numpy."""

import numpy as np
import pytest
import torch
from torch import Tensor

from terrain_estimator.model.gaussian import (
    cholesky,
    drop,
    log_determinant,
    mixture,
    project,
    random_walk,
    symmetrize,
)


def normal(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def definite(count: int, size: int, seed: int = 0) -> Tensor:
    root = normal(count, size, size + 2, seed=seed)
    return root @ root.mT + 0.1 * torch.eye(size, dtype=torch.float64)


def test_the_symmetric_part_is_half_of_a_matrix_and_its_transpose() -> None:
    matrix = normal(2, 3, 3)
    found = symmetrize(matrix).numpy()
    for k in range(2):
        np.testing.assert_array_equal(found[k], (matrix[k].numpy() + matrix[k].numpy().T) / 2)


@pytest.mark.parametrize("lacking", [3e-13, 3e-11, 3e-9, 3e-7])
def test_a_matrix_gets_no_more_than_it_needs_to_be_definite(lacking: float) -> None:
    """Eigenvalues 2 and -lacking: at least that is added to the diagonal, at most a hundredfold."""
    good, bad = definite(1, 2)[0], torch.ones(2, 2, dtype=torch.float64)
    bad[0, 1] = bad[1, 0] = 1.0 + lacking
    factor = cholesky(torch.stack([good, bad]))
    torch.testing.assert_close(factor[0], torch.linalg.cholesky(good), rtol=0.0, atol=0.0)
    added = factor[1] @ factor[1].mT - bad
    assert abs(float(added[0, 1])) < 1e-15
    for entry in added.diagonal().tolist():
        assert lacking < entry < 100.0 * lacking


def test_what_is_added_is_in_proportion_to_the_diagonal() -> None:
    scale = torch.tensor([1e-3, 1e3], dtype=torch.float64)
    bad = torch.tensor([[1.0, 1.0 + 3e-9], [1.0 + 3e-9, 1.0]], dtype=torch.float64)
    factor = cholesky(scale[:, None] * bad * scale)
    added = (factor @ factor.mT).diagonal() / scale**2 - 1.0
    torch.testing.assert_close(added, added.flip(0), rtol=1e-3, atol=0.0)
    assert 3e-9 < float(added[0]) < 3e-7


@pytest.mark.parametrize("lacking", [5e-6, 1e-4, 0.5])
def test_a_matrix_far_from_definite_is_not_a_number_and_takes_no_other_along(
    lacking: float,
) -> None:
    good, bad = definite(1, 2)[0], torch.ones(2, 2, dtype=torch.float64)
    bad[0, 1] = bad[1, 0] = 1.0 + lacking
    factor = cholesky(torch.stack([bad, good]))
    assert bool(torch.isnan(factor[0]).all())
    torch.testing.assert_close(factor[1], torch.linalg.cholesky(good), rtol=0.0, atol=0.0)


def test_the_log_determinant_of_each_of_a_batch_is_numpys() -> None:
    matrices = definite(5, 4).view(5, 1, 4, 4)
    expected = np.linalg.slogdet(matrices.numpy())[1]
    np.testing.assert_allclose(log_determinant(cholesky(matrices)), expected, rtol=1e-12)


def test_a_projection_is_that_of_each_gaussian_alone() -> None:
    precision, mean, directions = definite(3, 4), normal(3, 4), normal(2, 4, seed=1)
    means, covariances = project(mean, precision, directions)
    for k in range(3):
        inverse = np.linalg.inv(precision[k].numpy())
        np.testing.assert_allclose(means[k], directions.numpy() @ mean[k].numpy(), rtol=1e-12)
        np.testing.assert_allclose(
            covariances[k], directions.numpy() @ inverse @ directions.numpy().T, rtol=1e-9
        )


@pytest.mark.parametrize("index", range(4))
def test_marginalising_any_parameter_keeps_mean_and_covariance_of_the_others(index: int) -> None:
    precision, mean = definite(3, 4), normal(3, 4)
    kept = [k for k in range(4) if k != index]
    reduced_mean, reduced = drop(mean, precision, index)
    for k in range(3):
        np.testing.assert_array_equal(reduced_mean[k], mean[k, kept])
        expected = np.linalg.inv(precision[k].numpy())[np.ix_(kept, kept)]
        np.testing.assert_allclose(np.linalg.inv(reduced[k].numpy()), expected, rtol=1e-9)


def test_mixtures_in_two_rows_of_weights_have_the_moments_of_their_definition() -> None:
    log_weight, mean = normal(2, 3), normal(3, 2, seed=1)
    covariance = definite(3, 2)
    found_mean, found = mixture(log_weight, mean, covariance)
    for row in range(2):
        weight = np.exp(log_weight[row].numpy())
        weight /= weight.sum()
        centre = sum(w * m for w, m in zip(weight, mean.numpy(), strict=True))
        second = sum(
            w * (c + np.outer(m, m))
            for w, m, c in zip(weight, mean.numpy(), covariance.numpy(), strict=True)
        )
        np.testing.assert_allclose(found_mean[row], centre, rtol=1e-12)
        np.testing.assert_allclose(found[row], second - np.outer(centre, centre), rtol=1e-9)


@pytest.mark.parametrize("walking", [1, 2, 4])
def test_a_random_walk_of_the_first_parameters_adds_its_variance_to_them_alone(
    walking: int,
) -> None:
    precision = definite(2, 4)
    variance = torch.tensor([0.3, 0.0, 2.0, 1e-3][:walking], dtype=torch.float64)
    walked = random_walk(precision, variance).numpy()
    for k in range(2):
        covariance = np.linalg.inv(precision[k].numpy())
        covariance[range(walking), range(walking)] += variance.numpy()
        np.testing.assert_allclose(np.linalg.inv(walked[k]), covariance, rtol=1e-8, atol=1e-12)
