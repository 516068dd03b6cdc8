# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The bound of a drive whose samples share noise, against one dense covariance."""

import torch

from studies.lateral import PRIOR_SD, bound, twists


def test_elimination_sample_by_sample_is_the_bound_of_the_dense_covariance() -> None:
    generator = torch.Generator().manual_seed(7)
    count, size, rows = 6, 5, (0, 2, 3)

    def drawn(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    features = drawn(count, 1, size, 2) * torch.tensor([1e-3, 1.0], dtype=torch.float64)
    shared = 0.1 + drawn(size)
    spread = drawn(count, 1, size, size)
    alone = spread @ spread.mT + (2.0 * shared).diag()
    link = (-shared).diag().unsqueeze(0)
    found = bound([(features[k], alone[k], link) for k in range(count)], rows)

    chosen = torch.tensor(rows)
    dense = torch.zeros(3 * count, 3 * count, dtype=torch.float64)
    for k in range(count):
        own = slice(3 * k, 3 * k + 3)
        dense[own, own] = alone[k, 0][chosen][:, chosen]
    for k in range(count - 1):
        here, after = slice(3 * k, 3 * k + 3), slice(3 * k + 3, 3 * k + 6)
        dense[here, after] = dense[after, here] = (-shared[chosen]).diag()
    column = features[:, 0][:, chosen].reshape(-1, 2)
    prior = torch.diag(torch.tensor(PRIOR_SD, dtype=torch.float64) ** -2.0)
    expected = torch.linalg.inv(prior + column.T @ torch.linalg.solve(dense, column))
    torch.testing.assert_close(found[0], expected.diagonal().sqrt(), rtol=1e-10, atol=0.0)


def test_drives_straight_ahead_and_with_turns_differ_in_the_yaw_rate_alone() -> None:
    straight, turning = (twists(size, torch.Generator().manual_seed(1)) for size in (0.0, 0.6))
    assert torch.equal(straight[..., :2], turning[..., :2])
    assert not straight[..., 2].any()
    assert 0.3 < float(turning[..., 2].abs().max()) <= 0.6
    assert bool((straight[..., 0] > 0.08).all())
