# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training: reproducible from its seed, and its net explains what the physics misses."""

import torch

from terrain_estimator.learning.training import Recipe, build_model, train
from terrain_estimator.palpaca import PAlpaca
from terramechanics.rover import load_rover
from terramechanics.soil import load_soil

SMALL = Recipe(seed=3, iterations=60, tasks=24, batch=8, duration_s=12.0, columns=2, hidden=8)


def trained(recipe: Recipe) -> tuple[PAlpaca, list[float]]:
    rover, soil = load_rover("mars_rover"), load_soil("loose_sand")
    model = build_model(rover, soil, recipe.columns, recipe.hidden)
    return model, [progress.loss for progress in train(model, rover, soil, recipe)]


def test_the_same_seed_gives_the_same_model_and_training_lowers_the_loss() -> None:
    first, losses = trained(SMALL)
    second, again = trained(SMALL)
    assert losses == again
    for name, value in first.state_dict().items():
        assert torch.equal(value, second.state_dict()[name]), name
    assert sum(losses[-10:]) / 10 < sum(losses[:10]) / 10
    assert not any(parameter.requires_grad for parameter in first.parameters())
