# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The algebra of the lifted statistic, on rows made up for it."""

import pytest
import torch
from torch import Tensor

from studies.recursion.blocks import LiftedRows
from studies.recursion.lift import BODY, CONSTANTS, FIRST, LIFTED, lift
from studies.recursion.readout import score_variance
from studies.recursion.statistic import (
    MOMENTS,
    OPEN_VARIANCE,
    Statistic,
    added,
    block_score,
    empty_statistic,
    noise_of,
    open_velocity,
    sources_of,
    velocity_after,
    weights_of,
)

DRAWS, Q, SOURCES, OBSERVATIONS, BLOCKS = 3000, 4, 3, 5, 3
KEPT = [*range(FIRST), LIFTED, LIFTED + 1]
"""Lifted parameters of the kept scores."""


class MadeUp:
    """Blocks with known columns and sources of noise."""

    def __init__(self, seed: int) -> None:
        """Draw columns, sources and the true parameters."""
        generator = torch.Generator().manual_seed(seed)

        def draw(*shape: int) -> Tensor:
            return torch.randn(*shape, generator=generator, dtype=torch.float64)

        self.generator = generator
        self.columns = 0.3 * draw(BLOCKS, Q, LIFTED + BODY)
        self.noise = 0.05 * draw(BLOCKS, Q, SOURCES, LIFTED)
        self.weights = 0.4 + 0.1 * draw(OBSERVATIONS, Q)
        self.overlap = self.weights.T @ self.weights
        self.covariance = torch.diag(torch.tensor([0.02, 0.01, 0.03, 0.02], dtype=torch.float64))
        self.place = 0.5 * draw(1, 2 + CONSTANTS + BODY)
        self.true = lift(self.place).psi
        self.velocity = 0.1 * draw(BLOCKS + 1)

    def rows(self, block: int, draws: int) -> LiftedRows:
        """Return a block with as many draws of its noise; without noise where ``draws`` is 0."""
        count = max(draws, 1)
        errors = torch.randn(
            count, OBSERVATIONS, SOURCES, generator=self.generator, dtype=torch.float64
        )
        own = torch.randn(count, Q, generator=self.generator, dtype=torch.float64)
        moved = torch.einsum("gne,nq,qep->gqp", errors, self.weights, self.noise[block])
        columns = self.columns[block].expand(count, -1, -1).clone()
        known = columns @ self.true[0]
        known[:, 0] += self.velocity[block]
        known[:, 1] += self.velocity[block] - self.velocity[block + 1]
        if draws:
            columns[..., :LIFTED] += moved
            known = known + own @ self.covariance.sqrt()
        return LiftedRows(
            columns=columns,
            target=known,
            noise=self.noise[block].expand(count, -1, -1, -1),
            overlap=self.overlap.expand(count, -1, -1),
            covariance=self.covariance.expand(count, -1, -1),
            present=torch.ones(count, Q, dtype=torch.float64),
        )


def accumulated(rows: list[LiftedRows], psi: Tensor, told: float) -> Statistic:
    """Return the statistic after some blocks, with weights at a fixed ``psi`` [1, P]."""
    draws = rows[0].target.shape[0]
    statistic, velocity, place = empty_statistic(draws), open_velocity(draws), psi.expand(draws, -1)
    for block in rows:
        weights = weights_of(sources_of(block), place, velocity, block.present)
        statistic = added(statistic, block_score(block, weights, velocity, place, told))
        velocity = velocity_after(block, weights, velocity)
    return statistic


def test_derivatives_of_the_lift_are_those_of_its_values() -> None:
    """Central differences agree to 1e-8."""
    k = torch.linspace(-1.0, 1.5, 2 + CONSTANTS + BODY, dtype=torch.float64).unsqueeze(0)
    steps = 1e-5 * torch.eye(k.shape[1], dtype=torch.float64)
    numeric = (lift(k + steps).psi - lift(k - steps).psi) / 2e-5
    assert (lift(k).jacobian[0].T - numeric).abs().max() < 1e-8


def test_the_statistic_is_the_direct_sum_with_all_velocities_eliminated() -> None:
    """Least squares over parameters and the velocities at the ends of all blocks at once."""
    made = MadeUp(1)
    rows = [made.rows(block, 1) for block in range(BLOCKS)]
    psi = lift(torch.full((1, 2 + CONSTANTS + BODY), 0.3, dtype=torch.float64)).psi
    found = accumulated(rows, psi, told=0.0)
    size, velocities = LIFTED + BODY, BLOCKS + 1
    normal = torch.zeros(size + velocities, size + velocities, dtype=torch.float64)
    right = torch.zeros(size + velocities, dtype=torch.float64)
    normal[size, size] = 1.0 / OPEN_VARIANCE
    for block, each in enumerate(rows):
        carried = torch.zeros(Q, velocities, dtype=torch.float64)
        carried[0, block] = carried[1, block] = 1.0
        carried[1, block + 1] = -1.0
        design = torch.cat([each.columns[0], carried], 1)
        weight = torch.linalg.inv(noise_of(sources_of(each), psi)[0])
        normal += design.T @ weight @ design
        right += design.T @ weight @ each.target[0]
    cross = torch.linalg.solve(normal[size:, size:], normal[size:, :size])
    information = normal[:size, :size] - normal[:size, size:] @ cross
    score = right[:size] - cross.T @ right[size:]
    scale = information.diagonal().sqrt()
    assert ((found.information[0] - information[KEPT]).abs() / scale).max() < 1e-8
    assert ((found.score[0] - score[KEPT]).abs() / scale[KEPT]).max() < 1e-8


@pytest.mark.parametrize("told", [0.0, 1.0])
def test_corrected_scores_have_mean_zero_at_the_truth(told: float) -> None:
    """No mean of 20 scores over 3000 draws is 4.5 standard errors from zero.

    Honest scores stay below with 99.99 %. Weights and instruments are taken far from the truth;
    without the correction the largest mean is more than 10 standard errors from zero.
    """
    made = MadeUp(2)
    psi = made.true * 1.3 + 0.1
    statistic = accumulated([made.rows(block, DRAWS) for block in range(BLOCKS)], psi, told)
    net = statistic.information - statistic.correction
    truth = made.true.T
    scores = statistic.score - (net @ truth).squeeze(2)
    assert largest_mean(scores) < 4.5
    if not told:
        assert largest_mean(statistic.score - (statistic.information @ truth).squeeze(2)) > 10.0


def largest_mean(scores: Tensor) -> float:
    """Return the largest mean [MOMENTS] over draws, in its standard errors."""
    error = scores.std(0) / DRAWS**0.5
    return float((scores.mean(0).abs() / error).max())


@pytest.mark.parametrize("told", [0.0, 1.0])
def test_the_predicted_variance_is_that_of_the_scores(told: float) -> None:
    """Over 3000 draws each standard deviation agrees to 7 %, 5 standard errors."""
    made = MadeUp(3)
    statistic = accumulated([made.rows(block, DRAWS) for block in range(BLOCKS)], made.true, told)
    net = statistic.information - statistic.correction
    scores = statistic.score - (net @ made.true.T).squeeze(2)
    predicted = score_variance(statistic, made.place.expand(DRAWS, -1)).mean(0)
    ratio = scores.std(0) / predicted.diagonal().sqrt()
    assert scores.shape == (DRAWS, MOMENTS)
    assert (ratio - 1.0).abs().max() < 0.07
