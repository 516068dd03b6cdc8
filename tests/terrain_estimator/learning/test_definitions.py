# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tasks, their regressions and the terms of the loss, by definition and by statistics."""

import math

import numpy as np
import pytest
import torch
from scipy import stats
from torch import Tensor

from terrain_estimator.learning.departures import HIDDEN, Family, largest_sizes, random_plant
from terrain_estimator.learning.loss import (
    log_marginal,
    negative_log_predictive,
    overlap,
    paper_penalty,
    shortfall,
)
from terrain_estimator.learning.regression import Regression, distinct_rows, regression
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.learning.tasks import (
    BENCHMARK,
    CONSTANTS_SPREAD,
    PAPER,
    Tasks,
    draw_tasks,
    random_ground,
    uniform,
)
from terrain_estimator.model.packed_observation import (
    BLOCK,
    PACKED_SCALAR_FIELDS,
    PACKED_WHEEL_FIELDS,
)
from terrain_estimator.model.row_names import row_names
from terramechanics.effects import EFFECTS
from terramechanics.effects.simulated import SimulatedEffect
from terramechanics.presets import load_rover, load_soil

ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
A = ROVER.axles


def randn(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


# loss


def test_the_log_marginal_is_a_multivariate_normal_density() -> None:
    """y ~ N(Phi mean, Phi P^-1 Phi' + I), each task by itself."""
    features, target, mean = randn(3, 7, 2), randn(3, 7, seed=1), randn(2, seed=2)
    precision = torch.tensor([0.5, 2.0], dtype=torch.float64)
    found = log_marginal(features, target, torch.ones_like(target), mean, precision)
    for task in range(3):
        phi = features[task].numpy()
        covariance = phi @ np.diag(1.0 / precision.numpy()) @ phi.T + np.eye(7)
        expected = stats.multivariate_normal(phi @ mean.numpy(), covariance).logpdf(target[task])
        assert float(found[task]) == pytest.approx(expected, rel=1e-10)


def test_the_loss_is_the_density_of_what_follows_the_context_by_row() -> None:
    """-[log p(all) - log p(context)] / rows, the cost of the units of the rest added."""
    features, target = randn(2, 4, 3, 2), randn(2, 4, 3, seed=1)
    valid = torch.tensor([[1.0, 1.0, 1.0, 1.0], [1.0, 0.0, 1.0, 1.0]], dtype=torch.float64)
    context, cost = torch.tensor([1, 2]), randn(2, 4, seed=3)
    mean, precision = randn(2, seed=2), torch.tensor([0.5, 2.0], dtype=torch.float64)
    gained, lost, rows = 0.0, 0.0, 0
    for task, given in enumerate(context.tolist()):
        whole = [block for block in range(4) if valid[task, block]]
        before = [block for block in whole if block < given]
        for blocks, sign in ((whole, 1.0), (before, -1.0)):
            flat = features[task, blocks].reshape(1, -1, 2)
            values = target[task, blocks].reshape(1, -1)
            ones = torch.ones_like(values)
            gained += sign * float(log_marginal(flat, values, ones, mean, precision)[0])
        rest = [block for block in whole if block >= given]
        lost += float(cost[task, rest].sum())
        rows += 3 * len(rest)
    arguments = (features, target, valid, context, mean, precision)
    assert float(negative_log_predictive(*arguments)) == pytest.approx(-gained / rows)
    assert float(negative_log_predictive(*arguments, cost)) == pytest.approx((lost - gained) / rows)
    nothing = (features, target, valid, torch.tensor([4, 4]), mean, precision)
    assert float(negative_log_predictive(*nothing)) == pytest.approx(0.0, abs=1e-9)


def test_the_papers_penalty_vanishes_for_orthonormal_features_alone() -> None:
    steps = torch.eye(3, dtype=torch.float64) * math.sqrt(3.0)
    features = steps.view(1, 3, 1, 3).expand(2, 3, 2, 3)
    assert float(paper_penalty(features)) == pytest.approx(0.0, abs=1e-20)
    assert float(paper_penalty(0.0 * features)) == pytest.approx(2 * 2 * 3.0)
    drawn = randn(2, 5, 3, 4)
    expected = 0.0
    for task in range(2):
        for row in range(3):
            second = sum(np.outer(phi, phi) for phi in drawn[task, :, row].numpy()) / 5.0
            expected += float(((np.eye(4) - second) ** 2).sum())
    assert float(paper_penalty(drawn)) == pytest.approx(expected)


def test_the_shortfall_is_how_far_the_posterior_means_lie_below_zero() -> None:
    features, target = randn(3, 6, 3), randn(3, 6, seed=1)
    mean = torch.tensor([0.1, -0.4, 0.2], dtype=torch.float64)
    precision = torch.tensor([0.5, 2.0, 1.0], dtype=torch.float64)
    below = []
    for task in range(3):
        phi = features[task].numpy()
        gathered = phi.T @ phi + np.diag(precision.numpy())
        pull = phi.T @ target[task].numpy() + precision.numpy() * mean.numpy()
        estimate = np.linalg.solve(gathered, pull)
        below.append(np.maximum(-estimate[:2], 0.0).sum())
    assert max(below) > 0.0
    assert float(shortfall(features, target, mean, precision)) == pytest.approx(np.mean(below))


def test_blocks_that_are_not_valid_add_nothing_to_the_overlap() -> None:
    nominal, learnt = randn(2, 5, 3, 2), randn(2, 5, 3, 2, seed=1)
    valid = torch.ones(2, 5, dtype=torch.float64)
    valid[:, 3:] = 0.0
    short = overlap(nominal[:, :3], learnt[:, :3], valid[:, :3])
    torch.testing.assert_close(overlap(nominal, learnt, valid), short)
    torch.testing.assert_close(overlap(nominal, 7.0 * learnt, valid), short)
    assert float(overlap(nominal, nominal[..., :1], valid)) > 0.5


# tasks


def test_a_union_of_intervals_is_filled_by_length_without_its_gaps() -> None:
    intervals = ((0.0, 1.0), (5.0, 8.0))
    share = torch.tensor([0.0, 0.125, 0.2499, 0.25, 0.5, 1.0], dtype=torch.float64)
    found = uniform(intervals, share).tolist()
    assert found == pytest.approx([0.0, 0.5, 0.9996, 5.0, 6.0, 8.0])
    assert uniform(((2.0, 4.0),), share).tolist() == pytest.approx([2, 2.25, 2.4998, 2.5, 3, 4])


@pytest.mark.parametrize("spread", [0.0, CONSTANTS_SPREAD])
def test_a_random_ground_keeps_to_its_ranges(spread: float) -> None:
    """2000 drives; the ends of the constants' spread are approached within 1 %."""
    ground = random_ground(SOIL, 2000, torch.Generator().manual_seed(1), spread, PAPER).patches[0]
    share = ground.constants / SOIL.constants() - 1.0
    assert float(share.abs().max()) <= spread + 1e-12
    assert float(share.amax(0).min()) >= 0.99 * spread - 1e-12
    assert float(share.amin(0).max()) <= -0.99 * spread + 1e-12
    cohesion, angle = ground.strength[:, 0], torch.rad2deg(torch.atan(ground.strength[:, 1]))
    for values, intervals in (
        (cohesion, ((500.0, 700.0), (1300.0, 5000.0))),
        (angle, ((0.0, 20.0), (45.0, 60.0))),
    ):
        inside = [(values >= low - 1e-9) & (values <= high + 1e-9) for low, high in intervals]
        assert bool((inside[0] | inside[1]).all())
        length = [high - low for low, high in intervals]
        expected = length[0] / sum(length)
        assert float(inside[0].double().mean()) == pytest.approx(expected, abs=0.05)
    assert BENCHMARK.cohesion == ((500.0, 5000.0),)


@pytest.fixture(name="tasks", scope="module")
def drawn() -> Tasks:
    """40 drives of 4 s, exact constants."""
    generator = torch.Generator().manual_seed(2)
    return draw_tasks(ROVER, SOIL, "S1", 4.0, 40, generator, spread=0.0)


def test_what_is_true_of_a_task_has_the_deviations_of_what_is_measured(tasks: Tasks) -> None:
    """And differs from it by about one of them."""
    for index, name in enumerate(PACKED_WHEEL_FIELDS):
        place = slice(index * A, (index + 1) * A)
        if name.endswith("_sd"):
            assert torch.equal(tasks.true[..., place], tasks.measured[..., place])
            continue
        spread = tasks.measured[..., (index + 1) * A : (index + 2) * A]
        share = ((tasks.measured - tasks.true)[..., place] / spread)[tasks.usable]
        assert float(share.std()) == pytest.approx(1.0, abs=0.05), name
    for name in ("velocity_sd", "pitch_sd", "acceleration_sd"):
        scalar = 8 * A + PACKED_SCALAR_FIELDS.index(name)
        assert torch.equal(tasks.true[..., scalar], tasks.measured[..., scalar])


def test_split_tasks_joined_again_are_the_tasks(tasks: Tasks) -> None:
    parts = tasks.split(16)
    assert [part.strength.shape[0] for part in parts] == [16, 16, 8]
    again = Tasks.joined(parts)
    for name in Tasks.__slots__:
        torch.testing.assert_close(getattr(again, name), getattr(tasks, name), equal_nan=True)


# regressions


def test_a_regression_leaves_noise_of_the_covariance_that_it_claims(tasks: Tasks) -> None:
    """At the true strength the whitened residuals are standard normal: 40 drives of 4 blocks and 7
    rows, about 1100 values, whose mean square is 1 within 4 standard errors (0.17)."""
    model = physics_alone(ROVER, SOIL, exact=True)
    found = regression(model, tasks, torch.Generator().manual_seed(3))
    assert found.nominal.shape == (40, 40 // BLOCK, A + 4, 2)
    theta = tasks.strength / torch.tensor([1000.0, 1.0], dtype=torch.float64)
    residual = found.target - torch.einsum("tbqc,tc->tbq", found.nominal, theta)
    factor = torch.linalg.cholesky(found.covariance)
    white = torch.linalg.solve_triangular(factor, residual.unsqueeze(-1), upper=False).squeeze(-1)
    there = white[found.valid > 0.0]
    assert there.numel() > 500
    assert abs(float(there.square().mean()) - 1.0) < 4.0 * math.sqrt(2.0 / there.numel())
    assert abs(float(there.mean())) < 4.0 / math.sqrt(there.numel())


def test_a_block_with_an_unusable_observation_is_left_out_with_harmless_numbers(
    tasks: Tasks,
) -> None:
    usable = tasks.usable.clone()
    usable[0, BLOCK + 3] = False
    lamed = Tasks(tasks.measured[:2], tasks.true[:2], tasks.strength[:2], usable[:2])
    found = regression(
        physics_alone(ROVER, SOIL, exact=True), lamed, torch.Generator().manual_seed(3)
    )
    assert float(found.valid[0, 1]) == 0.0
    assert not found.nominal[0, 1].any()
    assert not found.target[0, 1].any()
    assert torch.equal(found.covariance[0, 1], torch.eye(A + 4, dtype=torch.float64))
    inputs = tasks.measured[1, :BLOCK].mean(0)
    torch.testing.assert_close(found.inputs[1, 0], inputs)
    chosen = found.of(torch.tensor([1]))
    assert torch.equal(chosen.target, found.target[1:])
    both = Regression.join([found.of(torch.tensor([0])), chosen])
    assert torch.equal(both.covariance, found.covariance)


def test_the_net_learns_from_every_row_but_the_accelerometers() -> None:
    names = row_names(A)
    assert [names[place] for place in distinct_rows(A)] == [
        name for name in names if name != "acceleration"
    ]


# plants


@pytest.mark.parametrize("family", Family)
def test_each_effect_acts_in_its_share_of_the_drives_with_sizes_in_its_range(
    family: Family,
) -> None:
    """4000 drives: a share of 0.4 within 4 standard errors, 0.031."""
    ranges = largest_sizes(family, ROVER)
    plant = random_plant(family, ROVER, 4000, HIDDEN, torch.Generator().manual_seed(5))
    assert plant is not None
    assert len(plant.effects) == len(ranges)
    for effect, (name, (low, high)) in zip(plant.effects, ranges.items(), strict=True):
        assert isinstance(effect, SimulatedEffect)
        own = effect.values[:, 0].tolist()
        size = torch.tensor(
            [EFFECTS[name].law.size_of(value) for value in own], dtype=torch.float64
        )
        assert not effect.values[:, 1:].any()
        assert abs(float((size != 0.0).double().mean()) - HIDDEN) < 0.031
        assert low <= float(size.min()) <= low + 0.01 * (high - low) or low == 0.0
        assert high - 0.01 * (high - low) <= float(size.max()) <= high


def test_the_two_families_share_no_effect_and_none_acts_where_the_share_is_zero() -> None:
    learnt, foreign = (set(largest_sizes(family, ROVER)) for family in Family)
    assert not learnt & foreign
    assert random_plant(Family.LEARNT, ROVER, 3, 0.0, torch.Generator()) is None
