# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The bank of hypotheses against its definitions, written as plain loops."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from torch import Tensor

from terrain_estimator.model.bank import (
    Bank,
    Solved,
    join,
    log_physical,
    merge,
    prune,
    siblings,
    take,
    weigh,
)
from terrain_estimator.model.block import Posterior, Solution
from terrain_estimator.model.gaussian import mixture


def vector(*values: float) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def normal(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def definite(count: int, size: int, seed: int = 0) -> Tensor:
    root = normal(count, size, size + 2, seed=seed)
    return root @ root.mT


def solved(count: int, size: int = 3, seed: int = 0) -> Solved:
    """Solved hypotheses whose numbers are all different."""
    posterior = Posterior(
        normal(count, size, seed=seed), definite(count, size, seed), normal(count, seed=seed + 1)
    )
    solution = Solution(posterior, normal(count, seed=seed + 2))
    return Solved(solution, torch.arange(float(count)), torch.arange(count))


def bank(mean: Tensor, precision: Tensor, log_weight: Tensor) -> Bank:
    """Return a bank of siblings."""
    count = log_weight.shape[0]
    covariance = torch.linalg.inv(precision)
    return Bank(mean, covariance, precision, log_weight, torch.ones(count), torch.zeros(count))


def test_siblings_share_age_and_kind() -> None:
    ages, kinds = [1.0, 1.0, 2.0, 1.0, 2.0], [0, 1, 0, 0, 0]
    found = siblings(torch.tensor(ages), torch.tensor(kinds))
    for i in range(5):
        for j in range(5):
            assert bool(found[i, j]) == (ages[i] == ages[j] and kinds[i] == kinds[j])


def test_joined_hypotheses_stand_one_behind_the_other_in_every_part() -> None:
    first, second = solved(2), solved(3, seed=7)
    both = join(first, second)
    for parts in (
        (first.solution.posterior, second.solution.posterior, both.solution.posterior),
        (first.solution[1:], second.solution[1:], both.solution[1:]),
        (first[1:], second[1:], both[1:]),
    ):
        for one, other, found in zip(*parts, strict=True):
            assert torch.equal(found[:2], one)
            assert torch.equal(found[2:], other)


def test_the_physical_mass_is_that_of_two_normal_variables_above_zero() -> None:
    mean, covariance = normal(4, 3), definite(4, 3)
    found = log_physical(mean, covariance)
    for k in range(4):
        deviations = np.sqrt(np.diag(covariance[k].numpy()))
        above = [float(stats.norm.logsf(0.0, float(mean[k, i]), deviations[i])) for i in range(2)]
        assert float(found[k]) == pytest.approx(sum(above), rel=1e-9)


def test_a_hypothesis_far_below_zero_keeps_a_finite_weight() -> None:
    found = float(log_physical(vector(-1e6, 1.0, 0.0)[None], torch.eye(3).double()[None])[0])
    assert found == pytest.approx(300.0 * math.log(0.1) + stats.norm.logcdf(1.0), rel=1e-9)


def test_a_weighed_bank_has_the_inverse_and_the_physical_weight_of_each_posterior() -> None:
    posterior = Posterior(normal(3, 4), definite(3, 4), normal(3, seed=5))
    found = weigh(posterior, vector(3, 4, 5), torch.tensor([0, 1, 2]))
    torch.testing.assert_close(
        found.covariance @ posterior.precision, torch.eye(4).double().expand(3, 4, 4)
    )
    expected = posterior.log_weight + log_physical(posterior.mean, found.covariance)
    assert torch.equal(found.weight, expected)
    assert torch.equal(found.mean, posterior.mean)
    assert found.age.tolist() == [3, 4, 5]
    assert found.kind.tolist() == [0, 1, 2]


def test_taken_hypotheses_are_the_chosen_ones_in_their_order() -> None:
    posterior = Posterior(normal(3, 4), definite(3, 4), normal(3, seed=5))
    whole = weigh(posterior, vector(3, 4, 5), torch.tensor([0, 1, 2]))
    for field, part in zip(whole, take(whole, torch.tensor([2, 0])), strict=True):
        assert torch.equal(part, torch.stack([field[2], field[0]]))


def test_a_weight_is_negligible_below_the_limit_alone() -> None:
    weight = vector(-3.0, -5.0, -5.0 - 1e-9, -9.0)
    before = bank(normal(4, 2), definite(4, 2), weight)
    after = prune(before, 2.0)
    assert after.weight.tolist() == [-3.0, -5.0, -math.inf, -math.inf]
    for field, same in zip(before, after, strict=True):
        assert field is before.weight or torch.equal(field, same)


def line(places: list[float], weights: list[float]) -> Bank:
    """Return siblings of unit variance on a line, with weights that need not sum to one."""
    count = len(places)
    return bank(vector(*places)[:, None], torch.ones(count, 1, 1).double(), vector(*weights).log())


@pytest.mark.parametrize("count", [2, 5, 16])
def test_a_chain_of_hypotheses_that_are_close_in_turn_becomes_one(count: int) -> None:
    places = [0.5 * k for k in range(count)]
    after = merge(line(places, [2.0**-k for k in range(count)]), 0.3)
    assert torch.isneginf(after.weight).tolist() == [False] + [True] * (count - 1)
    assert float(after.weight[0]) == pytest.approx(0.0, abs=1e-12)


def test_distance_is_measured_in_the_deviations_of_the_heavier() -> None:
    precision = vector(100.0, 1.0)[:, None, None]
    heavy_is_sharp = bank(vector(0.0, 0.3)[:, None], precision, vector(0.6, 0.4).log())
    assert torch.isfinite(merge(heavy_is_sharp, 0.3).weight).all()
    heavy_is_wide = bank(vector(0.0, 0.3)[:, None], precision.flip(0), vector(0.6, 0.4).log())
    assert torch.isneginf(merge(heavy_is_wide, 0.3).weight[1])


def test_the_limit_of_the_distance_is_not_close() -> None:
    for limit, merged in ((0.25, False), (0.2500001, True)):
        after = merge(line([0.0, 0.5], [0.6, 0.4]), limit)
        assert bool(torch.isneginf(after.weight[1])) == merged


def test_a_lone_hypothesis_and_a_bank_of_strangers_stay_as_they_are() -> None:
    for before in (line([1.0], [7.0]), line([0.0, 9.0, 20.0], [4.0, 2.0, 1.0])):
        for field, same in zip(before, merge(before, 0.3), strict=True):
            assert torch.equal(field, same)


def test_two_clusters_become_two_and_what_stands_alone_keeps_its_share() -> None:
    before = line([0.0, 9.0, 0.3, 9.2, 20.0], [5.0, 4.0, 3.0, 2.0, 1.0])
    after = merge(before, 0.3)
    np.testing.assert_allclose(
        after.weight.exp(), np.array([8.0, 6.0, 0.0, 0.0, 1.0]) / 15.0, rtol=1e-12
    )
    np.testing.assert_allclose(
        after.mean[[0, 1, 4], 0], [0.9 / 8.0, (36.0 + 18.4) / 6.0, 20.0], rtol=1e-12
    )
    spread = [5 * 3 / 64 * 0.09, 4 * 2 / 36 * 0.04, 0.0]
    np.testing.assert_allclose(after.covariance[[0, 1, 4], 0, 0], np.add(1.0, spread), rtol=1e-12)
    torch.testing.assert_close(after.precision, 1.0 / after.covariance)


@given(
    places=st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=8),
    seed=st.integers(0, 1000),
)
def test_no_merger_changes_the_moments_of_the_whole(places: list[float], seed: int) -> None:
    """In two dimensions, with precisions and weights of all kinds."""
    count = len(places)
    weights = normal(count, seed=seed).sort(descending=True)[0]
    mean = torch.stack([vector(*places), normal(count, seed=seed + 1)], 1)
    before = bank(mean, definite(count, 2, seed) + torch.eye(2).double(), weights)
    after = merge(before, 2.0)
    for one, other in zip(
        mixture(before.weight, before.mean, before.covariance),
        mixture(after.weight, after.mean, after.covariance),
        strict=True,
    ):
        torch.testing.assert_close(one, other)
