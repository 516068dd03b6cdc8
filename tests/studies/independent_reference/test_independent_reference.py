# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The posterior by the simulator's equations, beside cases whose answer is known."""

import ast
import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

import studies.independent_reference as package
from studies.independent_reference.drives import normal_draws
from studies.independent_reference.equations import Equations, Seen, excess, seen_of
from studies.independent_reference.instants import Instants, integrate, misfit, most_likely
from studies.independent_reference.posterior import (
    READINGS,
    Moments,
    log_velocities,
    moments,
    sample,
)
from terrain_estimator.learning.tasks import random_ground
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import TIME_STEP, Drive
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate

ROVERS = ("mars_rover", "paper_rover")
INSTANTS, PLAIN = 5, 20_000
"""Instants of the drives here, and plain draws of the inputs of each of two of them."""


def driven(name: str, factor: float) -> tuple[Equations, Drive, Seen, Tensor]:
    """Return a drive of some instants, what it shows with ``factor`` of the noise, its world."""
    rover, soil = load_rover(name), load_soil("loose_sand")
    generator = torch.Generator().manual_seed(4)
    ground = random_ground(soil, 1, generator, 0.0)
    duration = INSTANTS * TIME_STEP
    drive = simulate(rover, ground, "S1", duration, generator, 1)
    measured = measure_drive(rover, drive.sample, Noise(factor=factor), generator)
    world = torch.cat([ground.patches[0].strength, torch.zeros(1, 2, dtype=torch.float64)], 1)
    return Equations.of(rover, soil), drive, seen_of(measured, rover, 0, TIME_STEP), world


@pytest.mark.parametrize("name", ROVERS)
def test_at_the_true_inputs_the_equations_give_what_the_simulator_did(name: str) -> None:
    equations, drive, seen, world = driven(name, 0.0)
    likely = most_likely(equations, world, seen, torque=False)
    inputs = equations.at(seen, torch.zeros_like(likely.error))
    forces = equations.forces(world, inputs.slip, drive.sample.sinkage.log().unsqueeze(2))
    found = excess(equations.balances(world, seen, inputs), forces)[0, :, 0]
    torch.testing.assert_close(found[:, 0], drive.sample.acceleration[0], rtol=0.0, atol=1e-7)
    torch.testing.assert_close(found[:, 1:], torch.zeros_like(found[:, 1:]), rtol=0.0, atol=1e-7)
    torch.testing.assert_close(forces[0, :, 0, :, 2], drive.sample.ground_torque[0])
    torch.testing.assert_close(seen.torque[1:], drive.sample.ground_torque[0, 1:])
    assert (likely.log_depth.exp()[0, :, 0] / drive.sample.sinkage[0] - 1.0).abs().max() < 1e-6


@pytest.mark.parametrize("name", ROVERS)
def test_an_instant_is_integrated_as_by_plain_draws_from_the_inputs_prior(name: str) -> None:
    equations, _, seen, world = driven(name, 1.0)
    seen = Seen(*(each[1:3] for each in seen))
    # off the truth, so that sinkages and torques disagree with the inputs
    world = world * torch.tensor([[1.03, 0.99, 0.0, 0.0]]) + torch.tensor([[0.0, 0.0, 0.005, 0.01]])
    generator = torch.Generator().manual_seed(1)
    draws = normal_draws(2, 256, equations.inputs, generator)
    found = integrate(equations, world, seen, draws, torque=True)
    size = 1, 2, PLAIN, equations.inputs
    error = torch.randn(size, generator=generator, dtype=torch.float64)
    inputs = equations.at(seen, error)
    balance = equations.balances(world, seen, inputs)
    log_depth = settled(equations, world, seen, error)
    forces = equations.forces(world, inputs.slip, log_depth)
    log_weight = -0.5 * misfit(seen, log_depth.exp(), forces[..., 2], torque=True)
    plain = torch.logsumexp(log_weight, 2) - math.log(PLAIN)
    weight = torch.softmax(log_weight, 2)
    acceleration = excess(balance, forces)[..., 0]
    mean = (weight * acceleration).sum(2)
    variance = (weight * (acceleration - mean.unsqueeze(2)).square()).sum(2)
    effective = 1.0 / weight.square().sum(2)
    noise = 5.0 / effective.sqrt()
    assert float(effective.min()) > 80.0
    assert bool(((found.log_evidence - plain).abs() < noise).all())
    assert bool(((found.acceleration - mean).abs() < noise * variance.sqrt()).all())
    assert bool(((found.variance / variance - 1.0).abs() < 2.0 * noise).all())
    assert float(found.effective.min()) > 0.9
    assert float(found.imbalance) < 1e-5


def settled(equations: Equations, world: Tensor, seen: Seen, error: Tensor) -> Tensor:
    """Return the log sinkages [P, T, N, W] that balance, by Newton with a Jacobian of each own."""
    inputs = equations.at(seen, error)
    balance = equations.balances(world, seen, inputs)
    log_depth = seen.sinkage.log().unsqueeze(1).expand(*inputs.slip.shape).clone()
    for _ in range(6):
        here = equations.forces(world, inputs.slip, log_depth)
        beside = equations.forces(world, inputs.slip, log_depth + 1e-6)
        slope = torch.einsum("...bwf,...wf->...bw", balance.matrix, (beside - here) / 1e-6)
        step = torch.linalg.solve(slope[..., 1:, :], excess(balance, here)[..., 1:])
        log_depth = log_depth - step.clamp(-0.5, 0.5)
    return log_depth


def log_gaussian(away: Tensor, covariance: Tensor) -> Tensor:
    """Return the log density [...] of a Gaussian at ``away`` [..., D] from its mean."""
    root = torch.linalg.cholesky(covariance)
    white = torch.linalg.solve_triangular(root, away.unsqueeze(-1), upper=False).squeeze(-1)
    volume = root.diagonal().log().sum() + 0.5 * len(root) * math.log(2.0 * math.pi)
    return -0.5 * white.square().sum(-1) - volume


def test_velocities_are_weighed_by_their_joint_gaussian() -> None:
    generator = torch.Generator().manual_seed(2)
    _, _, seen, _ = driven("mars_rover", 1.0)
    acceleration, variance = torch.randn(
        2, 1, INSTANTS, generator=generator, dtype=torch.float64
    ).unbind(0)
    variance = 1e-3 * variance.exp()
    nothing = torch.zeros(1, INSTANTS, dtype=torch.float64)
    none = nothing[:, 0]
    found = Instants(nothing, acceleration, variance, nothing, none, none, none)
    sums = torch.ones(INSTANTS, INSTANTS, dtype=torch.float64).tril()
    sums[:, 0] = 0.0
    covariance = TIME_STEP**2 * sums @ torch.diag(variance[0]) @ sums.T
    covariance = covariance + torch.diag(seen.velocity_sd.square())
    # the first velocity alone says where the drive begins: the others relative to it
    apart = torch.diff(torch.eye(INSTANTS, dtype=torch.float64), dim=0)
    mean = apart @ (TIME_STEP * sums @ acceleration[0])
    expected = log_gaussian(apart @ seen.velocity - mean, apart @ covariance @ apart.T)
    torch.testing.assert_close(log_velocities(found, seen, TIME_STEP)[0], expected)


def test_narrow_oblique_gaussians_are_found_from_a_wide_start() -> None:
    """Their correlation is that of c and tan phi in a drive of 10 s, -0.998."""
    mean = torch.tensor([3.0, 1.0, 0.0, 0.0], dtype=torch.float64)
    root = torch.diag(torch.tensor([1.0, 0.06, 0.3, 0.2], dtype=torch.float64))
    root[1, 0] = -1.0
    covariance = root @ root.T
    # the densities of three readings, the last beside the others by a deviation and a half
    means = [mean, mean, mean + 1.5 * root[:, 0]]
    wide = 4.0 * covariance + torch.diag(torch.tensor([0.0, 0.0, 16.0, 16.0]))
    start = Moments(mean + 0.5 * root.sum(1), wide, 0.0)

    def density(worlds: Tensor) -> Tensor:
        return torch.stack([log_gaussian(worlds - each, covariance) for each in means], 1)

    weighted = sample(density, start, 256, 7)
    for reading in READINGS:
        found = moments(weighted, reading)
        away = torch.linalg.solve(root, found.mean - means[reading])
        assert float(away.abs().max()) < 0.1
        spread = torch.linalg.solve(root, torch.linalg.solve(root, found.covariance).T)
        assert float((torch.linalg.eigvalsh(spread).sqrt() - 1.0).abs().max()) < 0.15
        assert found.effective > 50.0


def test_the_integration_uses_no_row_of_the_estimator() -> None:
    """The prior's numbers are all that equations, instants and posterior share with it."""
    folder = Path(package.__file__).parent
    shared = set()
    for name in ("equations", "instants", "posterior"):
        for node in ast.walk(ast.parse((folder / f"{name}.py").read_bytes())):
            if isinstance(node, ast.ImportFrom) and node.module:
                shared.add(node.module)
    assert {each for each in shared if each.startswith("terrain_estimator")} == {
        "terrain_estimator.model.prior"
    }
