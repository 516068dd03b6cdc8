# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Training: reproducible from its seed, and its net explains what the physics misses."""

import dataclasses

import pytest
import torch

from terrain_estimator.learning.generation import Order, chunks, draw_chunk, generate
from terrain_estimator.learning.loss import Orthogonality
from terrain_estimator.learning.regression import Regression
from terrain_estimator.learning.tasks import PAPER
from terrain_estimator.learning.training import Recipe, build_model, train
from terrain_estimator.model.palpaca import PAlpaca
from terramechanics.presets import load_rover, load_soil

SMALL = Recipe(seed=3, iterations=60, batch=8, columns=2, hidden=8)
ORDER = Order(
    load_rover("mars_rover"), load_soil("loose_sand"), drives=24, seed=3, duration_s=12.0, share=0.4
)


@pytest.fixture(scope="module")
def data() -> Regression:
    return generate(ORDER)


def trained(data: Regression, recipe: Recipe) -> tuple[PAlpaca, list[float], list[float]]:
    model = build_model(ORDER.rover, [ORDER.soil], recipe.columns, recipe.hidden)
    history = list(train(model, data, recipe))
    return (
        model,
        [progress.loss for progress in history],
        [progress.overlap for progress in history],
    )


def test_the_same_seed_gives_the_same_model_and_training_lowers_the_loss(data: Regression) -> None:
    first, losses, _ = trained(data, SMALL)
    second, again, _ = trained(data, SMALL)
    assert losses == again
    for name, value in first.state_dict().items():
        assert torch.equal(value, second.state_dict()[name]), name
    assert sum(losses[-10:]) < 0.5 * sum(losses[:10])
    assert not any(parameter.requires_grad for parameter in first.parameters())


def test_the_prior_of_the_net_is_learnt_and_narrowed_for_use(data: Regression) -> None:
    bold, cautious = (
        trained(data, dataclasses.replace(SMALL, caution=factor))[0].hypotheses.net_precision
        for factor in (1.0, 10.0)
    )
    torch.testing.assert_close(cautious, 100.0 * bold)
    assert not torch.any(bold == 1.0)


@pytest.mark.parametrize("kind", list(Orthogonality))
def test_every_orthogonality_penalty_trains_and_those_that_bite_lower_the_overlap(
    data: Regression, kind: Orthogonality
) -> None:
    free = trained(data, dataclasses.replace(SMALL, strength=0.0))[2]
    bound = trained(data, dataclasses.replace(SMALL, orthogonality=kind, strength=30.0))[2]
    if kind is Orthogonality.PAPER:
        assert bound[-1] != free[-1]
    else:
        assert sum(bound[-10:]) < 0.5 * sum(free[-10:])


def test_the_data_do_not_depend_on_who_draws_which_chunk_first(data: Regression) -> None:
    order = chunks(ORDER)
    assert [chunk.size for chunk in order] == [20, 4]
    backwards = [draw_chunk(chunk) for chunk in reversed(order)]
    joined = Regression.join(backwards[::-1])
    for field in dataclasses.fields(Regression):
        assert torch.equal(getattr(joined, field.name), getattr(data, field.name)), field.name
    other = draw_chunk(dataclasses.replace(order[1], order=dataclasses.replace(ORDER, seed=4)))
    assert not torch.equal(other.target, backwards[0].target)


def test_blocks_outside_the_models_range_leave_no_nan_in_the_data() -> None:
    """The paper's training range has ground on which a rover gets stuck."""
    drawn = generate(dataclasses.replace(ORDER, drives=20, strength=PAPER))
    assert 0.0 < float(drawn.valid.mean()) < 1.0
    for field in dataclasses.fields(Regression):
        assert torch.isfinite(getattr(drawn, field.name)).all(), field.name
