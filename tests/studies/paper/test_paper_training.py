# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's training: penalties against their definitions, and its result on simulated drives."""

import pytest
import torch

from studies.baselines.drives import closed_form_forces
from studies.baselines.features import FeatureSpan, LearntModel
from studies.paper.plants import TRAINING, PaperPlant, draw_drives, vehicle
from studies.paper.training import PaperRecipe, train
from terrain_estimator.learning.loss import Orthogonality, paper_penalty, shortfall
from terramechanics.presets import load_rover, load_soil

ROVER, SOIL, PLANT = load_rover("paper_rover"), load_soil("loose_sand"), PaperPlant.CLOSED_FORM
DRIVES = draw_drives(
    PLANT, ROVER, SOIL, TRAINING, 40.0, 12, torch.Generator().manual_seed(7)
).drives


def small_model(span: FeatureSpan = FeatureSpan.FREE) -> LearntModel:
    return LearntModel(
        vehicle(ROVER, PLANT), SOIL.constants(), closed_form_forces, columns=4, hidden=16, span=span
    )


def test_the_papers_penalty_is_its_equation_written_out() -> None:
    generator = torch.Generator().manual_seed(8)
    features = torch.randn(3, 5, 2, 4, generator=generator, dtype=torch.float64)
    total = 0.0
    for task in features:
        for row in range(2):
            second = (
                sum(
                    (torch.outer(phi, phi) for phi in task[:, row]),
                    torch.zeros(4, 4, dtype=torch.float64),
                )
                / 5
            )
            total += float(torch.linalg.norm(torch.eye(4, dtype=torch.float64) - second) ** 2)
    torch.testing.assert_close(paper_penalty(features), torch.tensor(total, dtype=torch.float64))


def test_orthonormal_features_cost_nothing() -> None:
    features = torch.eye(4, dtype=torch.float64).view(1, 4, 1, 4) * 2.0
    assert float(paper_penalty(features)) == 0.0


def test_only_negative_parameters_fall_short() -> None:
    """One row a parameter, unit noise, unit precision: the posterior mean is half the target."""
    features = torch.eye(2, dtype=torch.float64).unsqueeze(0)
    zero, one = torch.zeros(2, dtype=torch.float64), torch.ones(2, dtype=torch.float64)
    assert (
        float(shortfall(features, torch.tensor([[3.0, 5.0]], dtype=torch.float64), zero, one))
        == 0.0
    )
    assert float(
        shortfall(features, torch.tensor([[3.0, -5.0]], dtype=torch.float64), zero, one)
    ) == pytest.approx(2.5)


def test_the_same_seed_gives_the_same_model_and_training_lowers_the_loss() -> None:
    recipe = PaperRecipe(seed=3, iterations=80, batch=8)
    first, second = small_model(), small_model()
    losses = [progress.loss for progress in train(first, DRIVES, recipe)]
    assert losses == [progress.loss for progress in train(second, DRIVES, recipe)]
    for name, value in first.state_dict().items():
        assert torch.equal(value, second.state_dict()[name]), name
    assert sum(losses[-10:]) < sum(losses[:10])
    assert not any(parameter.requires_grad for parameter in first.parameters())


def test_the_whitened_penalty_turns_the_learnt_features_away_from_the_nominal_ones() -> None:
    penalties = []
    for strength in (0.0, 30.0):
        recipe = PaperRecipe(
            iterations=80, batch=8, strength=strength, orthogonality=Orthogonality.WHITENED
        )
        penalties.append(
            [progress.penalty for progress in train(small_model(), DRIVES, recipe)][-1]
        )
    assert penalties[1] < 0.5 * penalties[0], penalties


def test_projected_features_are_orthogonal_to_the_nominal_ones_over_the_training_drives() -> None:
    model = small_model(FeatureSpan.PROJECTED)
    list(train(model, DRIVES, PaperRecipe(iterations=20, batch=8)))
    features = model.features(DRIVES)[0].flatten(0, 1)
    cross = features[:, :2].T @ features[:, 2:]
    length = features.norm(dim=0)
    assert float((cross / (length[:2].unsqueeze(-1) * length[2:])).abs().max()) < 1e-10
