# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The block solver on a linear case, where the answer is known in closed form."""

import numpy as np
import torch
from numpy.typing import NDArray

from terrain_estimator.model.block import BlockRows, Posterior, solve_block
from terrain_estimator.model.gaussian import drop

ROWS, SIZE = 4, 4  # parameters: c, tan phi, bias, velocity; a fifth is the velocity after the block
LONGEST = torch.tensor([1e9, 1e9], dtype=torch.float64)


def linear_block(seed: int) -> BlockRows:
    """Rows whose noise does not depend on theta: only the constant column has sources."""
    generator = torch.Generator().manual_seed(seed)
    linear = torch.randn(ROWS, SIZE + 1, generator=generator, dtype=torch.float64)
    sources = torch.randn(ROWS, 6, generator=generator, dtype=torch.float64) * 0.3
    gram = torch.zeros(3, 3, ROWS, ROWS, dtype=torch.float64)
    gram[2, 2] = sources @ sources.T
    return BlockRows(
        linear=linear,
        offset=torch.randn(ROWS, generator=generator, dtype=torch.float64),
        nuisance=torch.zeros(3, 0, dtype=torch.float64),
        expansion=torch.zeros(0, dtype=torch.float64),
        gram=gram.reshape(3, -1),
        target=torch.randn(ROWS, generator=generator, dtype=torch.float64),
        variance=torch.full((ROWS,), 0.1, dtype=torch.float64),
        present=torch.ones(ROWS, dtype=torch.float64),
    )


def noise_of(block: BlockRows) -> NDArray[np.float64]:
    return (block.gram.view(3, 3, ROWS, ROWS)[2, 2] + torch.diag(block.variance)).numpy()


def test_recursion_over_blocks_equals_the_batch_solution_and_a_textbook_kalman_filter() -> None:
    posterior = Posterior(
        torch.zeros(1, SIZE, dtype=torch.float64),
        torch.eye(SIZE, dtype=torch.float64)[None],
        torch.zeros(1, dtype=torch.float64),
    )
    blocks = [linear_block(seed) for seed in range(12)]
    velocities = len(blocks) + 1
    information, moment = np.zeros((3 + velocities, 3 + velocities)), np.zeros(3 + velocities)
    information[:4, :4] = np.eye(4)
    kalman_mean, kalman_covariance = np.zeros(4), np.eye(4)
    for index, block in enumerate(blocks):
        solved = solve_block(posterior, block, LONGEST).posterior
        posterior = Posterior(*drop(solved.mean, solved.precision, SIZE - 1), solved.log_weight)

        rows = np.zeros((ROWS, 3 + velocities))  # batch: every velocity is a parameter of its own
        rows[:, :3], rows[:, 3 + index : 5 + index] = (
            block.linear[:, :3].numpy(),
            block.linear[:, 3:].numpy(),
        )
        weight = np.linalg.inv(noise_of(block))
        information += rows.T @ weight @ rows
        moment += rows.T @ weight @ (block.target - block.offset).numpy()

        wide = np.zeros(
            (5, 5)
        )  # Kalman: the velocity after the block starts unknown, then the one before is forgotten
        wide[:4, :4], wide[4, 4] = kalman_covariance, 1e5
        h, prior = block.linear.numpy(), np.append(kalman_mean, 0.0)
        gain = wide @ h.T @ np.linalg.inv(h @ wide @ h.T + noise_of(block))
        updated = prior + gain @ ((block.target - block.offset).numpy() - h @ prior)
        rest = np.eye(5) - gain @ h
        covariance = rest @ wide @ rest.T + gain @ noise_of(block) @ gain.T  # Joseph's form
        kept = [0, 1, 2, 4]
        kalman_mean, kalman_covariance = updated[kept], covariance[np.ix_(kept, kept)]

    batch = np.linalg.solve(information, moment)
    last = [0, 1, 2, 3 + len(blocks)]
    np.testing.assert_allclose(posterior.mean[0], batch[last], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(
        torch.linalg.inv(posterior.precision[0]),
        np.linalg.inv(information)[np.ix_(last, last)],
        rtol=1e-8,
        atol=1e-12,
    )
    np.testing.assert_allclose(posterior.mean[0], kalman_mean, rtol=1e-3, atol=1e-4)


def test_log_weight_is_the_log_evidence_up_to_what_no_parameter_changes() -> None:
    """Two priors on the same data: log weights differ as the exact log evidences do."""
    block = linear_block(5)
    means = torch.tensor([[0.0, 0.0, 0.0, 0.0], [1.5, -1.0, 0.5, 0.2]], dtype=torch.float64)
    precision = torch.stack([torch.eye(4), 3.0 * torch.eye(4)]).to(torch.float64)
    found = solve_block(
        Posterior(means, precision, torch.zeros(2, dtype=torch.float64)), block, LONGEST
    ).posterior.log_weight
    expected = []
    for mean, p in zip(means, precision, strict=True):
        # marginalise the unknown velocity after the block with a very wide prior
        wide = torch.zeros(5, 5, dtype=torch.float64)
        wide[:4, :4], wide[4, 4] = torch.linalg.inv(p), 1e8
        covariance = block.linear @ wide @ block.linear.T + torch.from_numpy(noise_of(block))
        centre = block.offset + block.linear[:, :4] @ mean
        normal = torch.distributions.MultivariateNormal(centre, covariance)
        expected.append(normal.log_prob(block.target))  # type: ignore[no-untyped-call]
    assert abs(float((found[1] - found[0]) - (expected[1] - expected[0]))) < 1e-5


def test_uncertain_constants_are_estimated_where_the_rows_show_them() -> None:
    """Rows that are bilinear in theta and a constant, no noise: blocks recover all of them."""
    generator = torch.Generator().manual_seed(9)
    truth = torch.tensor(
        [1.2, 0.6, 0.8, 0.1, -0.2, 0.05, 0.3], dtype=torch.float64
    )  # c, tan phi, a constant, those that are FIXED
    start = torch.tensor([[0.8, 0.8, 0.0, 0.0, 0.0, 0.0, 0.0]], dtype=torch.float64)
    posterior = Posterior(
        start, 1e-4 * torch.eye(7, dtype=torch.float64)[None], torch.zeros(1, dtype=torch.float64)
    )
    for _ in range(8):
        linear = torch.randn(10, 8, generator=generator, dtype=torch.float64)
        linear[:, 2] = 0.0
        nuisance = 0.3 * torch.randn(3, 10, generator=generator, dtype=torch.float64)
        theta = torch.cat([truth[:2], torch.ones(1, dtype=torch.float64)])
        target = linear[:, :7] @ truth + linear[:, 7] * truth[6] + truth[2] * (theta @ nuisance)
        rows = BlockRows(
            linear=linear,
            offset=torch.zeros(10, dtype=torch.float64),
            nuisance=nuisance,
            expansion=torch.zeros(1, dtype=torch.float64),
            gram=torch.zeros(3, 2 * 3 * 100, dtype=torch.float64),
            target=target,
            variance=torch.full((10,), 1e-6, dtype=torch.float64),
            present=torch.ones(10, dtype=torch.float64),
        )
        solved = solve_block(posterior, rows, LONGEST).posterior
        posterior = Posterior(*drop(solved.mean, solved.precision, 6), solved.log_weight)
    np.testing.assert_allclose(posterior.mean[0], truth, atol=1e-3)
