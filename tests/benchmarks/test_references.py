# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The loops that speeds are compared with compute the same numbers as what they are compared to."""

import dataclasses

import numpy as np
import pytest
import torch

from benchmarks import numpy_rover
from benchmarks.numpy_training import Adam, loss_and_gradients
from benchmarks.simulation import same_drives
from benchmarks.training import model_of, random_data, tasks_of, weights_of
from terrain_estimator.learning.training import Recipe, _Learnt, _losses
from terramechanics.contact.sinkage import WheelGround
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground

ROVERS, STEPS, SEED = 2, 10, 5
TASKS = 4


def test_loops_over_rovers_and_wheels_drive_like_the_batched_simulation() -> None:
    generator = torch.Generator().manual_seed(SEED)
    ground = Ground.random_strength(load_soil("loose_sand"), ROVERS, generator)
    batched = simulate(
        load_rover("mars_rover"), ground, "S1", STEPS * TIME_STEP, generator, ROVERS
    ).sample
    for rover, series in enumerate(numpy_rover.fleet(*same_drives(ROVERS, STEPS, SEED), TIME_STEP)):
        for name, values in series.items():
            assert values == pytest.approx(
                getattr(batched, name)[rover].numpy(), rel=1e-6, abs=1e-9
            ), f"{name} of rover {rover}"
    assert np.ptp(batched.pitch.numpy()) > 0.01, "hills"


@pytest.mark.parametrize("slip", [-0.5, -0.08, 0.0, 0.2, 0.9])
def test_a_wheel_of_the_loops_has_the_forces_of_the_contact_model(slip: float) -> None:
    """Braked wheels among them, whose stresses have a kink."""
    rover, (track, *_), *_ = same_drives(1, 1, SEED)
    sinkage = torch.tensor([0.003, 0.02, 0.08], dtype=torch.float64)
    strength = torch.from_numpy(track.strength)
    wheel = WheelGround.of(rover, torch.from_numpy(track.soil), strength, numpy_rover.POINTS)
    expected = wheel.forces(torch.full_like(sinkage, slip), sinkage).numpy()
    for depth, forces in zip(sinkage.tolist(), expected, strict=True):
        assert numpy_rover.wheel_forces(rover, track, slip, depth) == pytest.approx(
            forces, rel=1e-6, abs=1e-6 * forces[0]
        )


def test_loops_over_tasks_and_blocks_have_the_loss_and_the_gradients_of_the_training_step() -> None:
    recipe = dataclasses.replace(Recipe(hidden=8), strength=0.0, positivity=0.0)
    model = model_of(recipe)
    model.net.requires_grad_(requires_grad=True)
    generator = torch.Generator().manual_seed(SEED)
    data = random_data(model, generator).of(torch.arange(TASKS))
    context = torch.randint(1, 30, (TASKS,), generator=generator)
    learnt = _Learnt(recipe.columns, data.target.shape[-1])
    with torch.no_grad():
        learnt.log_precision.add_(torch.randn(recipe.columns, generator=generator))
        learnt.log_noise.add_(torch.randn(data.target.shape[-1], generator=generator))
    weights = weights_of(model, learnt.log_precision, learnt.log_noise)
    loss, gradients = loss_and_gradients(weights, tasks_of(model, data), context.numpy())
    expected, _, _ = _losses(model, learnt, data, context, recipe)
    expected.backward()  # type: ignore[no-untyped-call]
    parameters = [*model.net.parameters(), learnt.log_precision, learnt.log_noise]
    assert loss == pytest.approx(expected.item(), rel=1e-10)
    for mine, parameter in zip(gradients, parameters, strict=True):
        assert parameter.grad is not None
        assert mine == pytest.approx(parameter.grad.numpy(), rel=1e-7, abs=1e-12)
    optimizer = torch.optim.Adam(parameters, lr=recipe.learning_rate)
    optimizer.step()
    nothing = [np.zeros_like(each) for each in weights]
    Adam([recipe.learning_rate] * len(weights), nothing, list(nothing)).step(weights, gradients)
    for mine, parameter in zip(weights, parameters, strict=True):
        assert mine == pytest.approx(parameter.detach().numpy(), rel=1e-9, abs=1e-9)
