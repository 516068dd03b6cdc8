# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Innovations of the rows: against a prediction written out by hand, and white on honest drives."""

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.block import BlockRows
from terrain_estimator.model.innovation import CARRIED, linearised, misses, without_carried
from terrain_estimator.model.model_file import load_model
from tests.terrain_estimator.drives import drive_observations

ROWS, FIRST, CONSTANTS = 5, 3, 2
SIZE = FIRST + CONSTANTS + 1  # c, tan phi, bias, two constants, velocity
KEPT = [row for row in range(ROWS) if row != CARRIED]


def random_rows(generator: torch.Generator) -> BlockRows:
    """A block in which every part is at work."""

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    linear = normal(ROWS, SIZE + 1)
    linear[:, FIRST : FIRST + CONSTANTS] = 0.0
    linear[KEPT, -1] = 0.0
    sources = 0.3 * normal(3, ROWS, 7)
    gram = torch.einsum("aqs,brs->abqr", sources, sources)
    return BlockRows(
        linear=linear,
        offset=normal(ROWS),
        nuisance=normal(3, ROWS * CONSTANTS),
        expansion=normal(CONSTANTS),
        gram=gram.reshape(3, -1),
        target=normal(ROWS),
        variance=torch.full((ROWS,), 0.1, dtype=torch.float64),
        present=torch.ones(ROWS, dtype=torch.float64),
    )


def residual_of(rows: BlockRows, mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """Written out from what BlockRows says of its parts."""
    theta = [mean[0], mean[1], 1.0]
    shift = mean[FIRST : FIRST + CONSTANTS] - rows.expansion.numpy()
    predicted = rows.offset.numpy() + rows.linear.numpy()[:, :SIZE] @ mean
    for a in range(3):
        predicted = predicted + theta[a] * rows.nuisance[a].view(ROWS, CONSTANTS).numpy() @ shift
    return np.asarray((rows.target.numpy() - predicted)[KEPT])


def noise_of(rows: BlockRows, mean: NDArray[np.float64]) -> NDArray[np.float64]:
    theta = np.array([mean[0], mean[1], 1.0])
    gram = rows.gram.view(3, 3, ROWS, ROWS).numpy()
    noise = np.einsum("a,b,abqr->qr", theta, theta, gram) + np.diag(rows.variance.numpy())
    return np.asarray(noise[np.ix_(KEPT, KEPT)])


@pytest.fixture(params=range(5))
def case(request: pytest.FixtureRequest) -> tuple[BlockRows, Tensor, Tensor]:
    """Return rows, and a mean and covariance of the parameters."""
    generator = torch.Generator().manual_seed(request.param)
    rows = random_rows(generator)
    mean = torch.randn(SIZE, generator=generator, dtype=torch.float64)
    root = torch.randn(SIZE, SIZE, generator=generator, dtype=torch.float64)
    return rows, mean, root @ root.T


def jacobian_of(rows: BlockRows, mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """Central differences: exact but for rounding, as the rows are bilinear."""
    steps = 1e-3 * np.eye(SIZE)
    changes = [residual_of(rows, mean + step) - residual_of(rows, mean - step) for step in steps]
    return -np.stack(changes, 1) / 2e-3


def test_residual_noise_and_jacobian_are_those_written_out(
    case: tuple[BlockRows, Tensor, Tensor],
) -> None:
    rows, mean, _ = case
    found = linearised(without_carried(rows), mean, FIRST)
    np.testing.assert_allclose(found.residual, residual_of(rows, mean.numpy()), atol=1e-12)
    np.testing.assert_allclose(found.noise, noise_of(rows, mean.numpy()), atol=1e-12)
    np.testing.assert_allclose(found.jacobian, jacobian_of(rows, mean.numpy()), atol=1e-9)


def test_misses_have_unit_variance_under_the_prediction(
    case: tuple[BlockRows, Tensor, Tensor],
) -> None:
    rows, mean, covariance = case
    residual, jacobian = residual_of(rows, mean.numpy()), jacobian_of(rows, mean.numpy())
    spread = noise_of(rows, mean.numpy()) + jacobian @ covariance.numpy() @ jacobian.T
    weight = np.linalg.inv(spread)
    found = misses(rows, mean, covariance, FIRST)
    np.testing.assert_allclose(found.single, weight @ residual / np.sqrt(np.diagonal(weight)))
    np.testing.assert_allclose(found.white, np.linalg.solve(np.linalg.cholesky(spread), residual))
    assert found.white.square().sum().item() == pytest.approx(residual @ weight @ residual)


def test_a_row_that_was_not_there_has_no_miss(case: tuple[BlockRows, Tensor, Tensor]) -> None:
    rows, mean, covariance = case
    absent = KEPT[2]
    present = rows.present.clone()
    present[absent] = 0.0
    found = misses(rows._replace(present=present), mean, covariance, FIRST)
    for each in found:
        assert torch.isnan(each).tolist() == [row == absent for row in KEPT]


DRIVES, SECONDS = 6, 40


def test_on_honest_drives_the_misses_are_white() -> None:
    """6 drives, 234 seconds, 8 rows; sums of squares, limits at 99.9 %.

    White within a row from second to second, and between the rows of a second.
    """
    model = load_model()
    whites = []
    for seed in range(DRIVES):
        estimator = Estimator(model, CoreConfig())
        before = None
        for observation in drive_observations(
            model.rover, model.metadata.soils[0], float(SECONDS), 900 + seed
        ):
            estimator.update(observation)
            fits = estimator.save()["pending"]
            if len(fits) and (before is None or not np.array_equal(fits[-1], before)):
                before = fits[-1]
                whites.append(before[-len(model.rows) :])
    white = np.array(whites)
    assert len(white) >= DRIVES * (SECONDS - 2)
    count = white.size
    assert abs((white**2).mean() - 1.0) < 3.3 * np.sqrt(2.0 / count)
    correlation = np.corrcoef(white, rowvar=False) - np.eye(white.shape[1])
    pairs = white.shape[1] * (white.shape[1] - 1) / 2
    assert (correlation**2).sum() / 2.0 * len(white) < pairs + 3.3 * np.sqrt(2.0 * pairs)
    assert abs((white[1:] * white[:-1]).mean()) < 3.3 / np.sqrt(count)
