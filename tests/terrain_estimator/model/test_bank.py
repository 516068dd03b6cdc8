# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The bank of hypotheses: what is merged is kept by its moments, what is dropped did not count."""

import torch

from terrain_estimator.model.bank import Bank, merge, prune
from terrain_estimator.model.gaussian import mixture, random_walk

SIZE = 3


def bank(weights: list[float], shifts: list[float], ages: list[float], kinds: list[int]) -> Bank:
    """Hypotheses of one random precision, ``shifts`` deviations apart along the first axis."""
    matrix = torch.randn(
        SIZE, SIZE + 2, generator=torch.Generator().manual_seed(4), dtype=torch.float64
    )
    precision = (matrix @ matrix.T).expand(len(weights), SIZE, SIZE).clone()
    mean = torch.zeros(len(weights), SIZE, dtype=torch.float64)
    mean[:, 0] = torch.tensor(shifts, dtype=torch.float64) / precision[0, 0, 0].sqrt()
    log_weight = torch.tensor(weights, dtype=torch.float64).log()
    return Bank(
        mean,
        torch.linalg.inv(precision),
        precision,
        log_weight,
        torch.tensor(ages),
        torch.tensor(kinds),
    )


def test_merged_hypotheses_have_the_weight_and_the_moments_of_their_mixture() -> None:
    before = bank([0.5, 0.3, 0.2], [0.0, 0.3, 0.45], [5.0, 5.0, 5.0], [0, 0, 0])
    after = merge(before, 0.25)
    assert torch.isneginf(after.weight).tolist() == [False, True, True]
    mean, covariance = mixture(before.weight, before.mean, before.covariance)
    torch.testing.assert_close(after.mean[0], mean)
    torch.testing.assert_close(after.covariance[0], covariance)
    torch.testing.assert_close(torch.linalg.inv(after.precision[0]), covariance)
    torch.testing.assert_close(after.weight[0].exp(), torch.ones((), dtype=torch.float64))


def test_only_kin_that_are_close_are_merged() -> None:
    """The second is far, the third has another age, the fourth another kind."""
    before = bank([0.4, 0.3, 0.2, 0.1], [0.0, 5.0, 0.01, 0.01], [5.0, 5.0, 4.0, 5.0], [0, 0, 0, 1])
    after = merge(before, 0.25)
    for here, there in zip(before, after, strict=True):
        assert torch.equal(here, there)


def test_a_dead_hypothesis_takes_no_part_in_a_merger() -> None:
    before = bank([0.6, 0.4, 0.0], [0.0, 0.1, 0.0], [1.0, 1.0, 1.0], [0, 0, 0])
    after = merge(before, 0.25)
    alone = merge(Bank(*(field[:2] for field in before)), 0.25)
    for here, there in zip(alone, after, strict=True):
        torch.testing.assert_close(here, there[:2])
    assert torch.isneginf(after.weight[2])


def test_what_weighs_next_to_nothing_is_dropped() -> None:
    after = prune(bank([1.0, 1e-3, 1e-9], [0.0, 1.0, 2.0], [1.0] * 3, [0] * 3), 14.0)
    assert torch.isneginf(after.weight).tolist() == [False, False, True]


def test_a_random_walk_adds_its_variance_to_the_covariance() -> None:
    precision = bank([1.0, 1.0], [0.0, 1.0], [1.0] * 2, [0] * 2).precision
    for steps in ([0.3, 0.2], [0.0, 0.2], [0.0, 0.0]):
        step = torch.tensor(steps, dtype=torch.float64)
        expected = torch.linalg.inv(precision) + torch.diag(
            torch.cat([step, torch.zeros(1, dtype=torch.float64)])
        )
        torch.testing.assert_close(torch.linalg.inv(random_walk(precision, step)), expected)
