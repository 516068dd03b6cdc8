# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Ground that is not the same below every axle: what it adds to the noise of a block's rows."""

import dataclasses
import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from studies.accuracy.scores import FROM_PRIOR, draw_drives
from studies.physics import physics_model
from terrain_estimator.learning.adding import Sized, with_effects
from terrain_estimator.learning.training import build_model
from terrain_estimator.model.block import row_noise
from terrain_estimator.model.packing import view_of, with_sinkage_and_sd
from terrain_estimator.model.physics import Physics
from terrain_estimator.model.physics_on_varying_ground import PhysicsOnVaryingGround
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.model.rows import ContactModel, frame_of, values_alone
from terrain_estimator.model.unmeasured import with_balanced_sinkage
from terramechanics.contact.stresses import wheel_forces
from terramechanics.presets import load_rover, load_soil

SOIL = load_soil("loose_sand")
SD = 0.03
EXACT = dataclasses.replace(DEFAULT_PRIOR, constants_sd=0.0)
ROVERS = ("mars_rover", "four_wheel_rover")


def one(name: str, *, sinkage: bool) -> tuple[Physics, Tensor, Tensor]:
    """Return the physics with exact constants, a block's exact observations, the true theta."""
    rover = load_rover(name)
    drives = draw_drives(rover, SOIL, "S1", 1, 0.0, 5, FROM_PRIOR, duration_s=3.0)
    packed, (cohesion, friction) = drives.tasks.true[0, 15:25], drives.tasks.strength[0].tolist()
    if not sinkage:
        missing = torch.full_like(view_of(packed, rover.axles).sinkage, math.nan)
        packed = with_sinkage_and_sd(packed, missing, missing)
    physics = build_model(rover, [SOIL], prior=EXACT).physics
    assert isinstance(physics, Physics)
    return physics, packed, torch.tensor([cohesion / 1e3, friction, 1.0], dtype=torch.float64)


def covariance(
    physics: Physics | PhysicsOnVaryingGround, packed: Tensor, theta: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the covariance [Q, Q] of a block's rows at ``theta`` [3], and which are there [Q]."""
    rows = len(nominal_of(physics).fixed_columns) - 1
    none = torch.zeros(packed.shape[0], rows, 0, dtype=torch.float64)
    found = physics.average(packed, none, 0, theta[:2], torch.ones(rows, dtype=torch.float64))
    return row_noise(found.rows, theta.unsqueeze(0))[1][0], found.rows.present


def weighed(contact: ContactModel, packed: Tensor, weights: Tensor, stiffer: Tensor) -> Tensor:
    """Return the means [R] of the rows where strength and stiffness below the axles differ.

    ``weights`` [A, 3] are (c, tan phi, 1) below each axle, ``stiffer`` [A] factors of k_c, k_phi.
    """
    frame = frame_of(packed, contact)
    constants = contact.constants.expand(1, len(stiffer), 6).clone()
    constants[..., 1:3] *= stiffer.view(1, -1, 1)
    at = frame.measured
    forces = wheel_forces(
        at.slip, at.sinkage, constants, contact.radius, contact.width, contact.nodes
    )
    acting = ((forces * contact.column_unit) @ weights.view(1, -1, 3, 1)).squeeze(-1)  # [n, A, 3]
    return (frame.levers.select(2, 0) @ acting.unsqueeze(-1)).squeeze(-1).sum(1).mean(0)


@pytest.mark.parametrize("name", ROVERS)
def test_the_rows_vary_as_those_of_other_ground_below_one_axle(name: str) -> None:
    """Means of exact rows: each deviation of one axle's ground is a source of the covariance."""
    physics, packed, theta = one(name, sinkage=True)
    even, there = covariance(physics, packed, theta)
    varying, _ = covariance(PhysicsOnVaryingGround(physics, SD), packed, theta)
    contact, axles = values_alone(physics.nominal_contact()), physics.axles
    alike, soft = theta.expand(axles, 3), torch.ones(axles, dtype=torch.float64)
    expected = torch.zeros_like(even[1:, 1:])
    for axle in range(axles):
        for deviation in range(3):
            weights, stiffer = alike.clone(), soft.clone()
            if deviation < 2:
                weights[axle, deviation] *= 1.0 + SD
            else:
                stiffer[axle] *= 1.0 + SD
            moved = weighed(contact, packed, weights, stiffer) - weighed(
                contact, packed, alike, soft
            )
            expected += moved.unsqueeze(1) * moved
    added = (varying - even)[1:, 1:]
    # The rows of the velocity weigh early observations more, see row_weights.
    kept = (there[1:] > 0.0).nonzero().squeeze(1)[1:]
    scale = expected.diagonal()[kept].sqrt()
    assert float(scale.min()) > 0.0
    error = (added - expected)[kept][:, kept] / (scale.unsqueeze(1) * scale)
    assert float(error.abs().max()) < 0.02


def test_without_sinkages_they_vary_about_the_balances() -> None:
    """The balances are spent: the sinkages make up for what the ground below an axle changes."""
    physics, packed, theta = one("mars_rover", sinkage=False)
    even, there = covariance(physics, packed, theta)
    varying, _ = covariance(PhysicsOnVaryingGround(physics, SD), packed, theta)
    contact = values_alone(physics.nominal_contact())
    alike = theta.expand(physics.axles, 3)
    soft = torch.ones(physics.axles, dtype=torch.float64)

    def solved(stiffer: Tensor) -> Tensor:
        constants = contact.constants.expand(1, physics.axles, 6).clone()
        constants[..., 1:3] *= stiffer.view(1, -1, 1)
        other = contact._replace(constants=constants)
        balanced = with_balanced_sinkage(packed, other, theta)
        return weighed(contact, balanced, alike, stiffer)

    expected = torch.zeros(len(there) - 1, dtype=torch.float64)
    for axle in range(physics.axles):
        stiffer = soft.clone()
        stiffer[axle] *= 1.0 + SD
        expected += (solved(stiffer) - solved(soft)) ** 2
    added = (varying - even)[1:, 1:].diagonal()
    kept = (there[1:] > 0.0).nonzero().squeeze(1)[1:]
    assert len(kept) == physics.axles  # the torques
    # the deviations of the stiffness make a part of the variance; those of c and tan phi the rest
    assert bool((expected[kept] < 1.02 * added[kept]).all())
    assert bool((expected[kept] > 0.1 * added[kept]).all())


def test_no_variation_is_even_ground() -> None:
    physics, packed, theta = one("mars_rover", sinkage=True)
    even, _ = covariance(physics, packed, theta)
    none, _ = covariance(PhysicsOnVaryingGround(physics, 0.0), packed, theta)
    scale = even.diagonal().sqrt()
    assert float(((none - even) / (scale.unsqueeze(1) * scale)).abs().max()) < 1e-12


def test_no_effect_is_added_to_such_a_model(tmp_path: Path) -> None:
    model = physics_model(load_rover("mars_rover"), [SOIL], tmp_path / "varying.pt", 0.02)
    assert model.metadata.prior.ground_variation == 0.02
    with pytest.raises(ConfigError, match=r"for ground that varies.*--ground-variation"):
        with_effects(model, [Sized.of_library("payload")])


def test_the_law_scm_has_even_ground() -> None:
    soil = dataclasses.replace(SOIL, law="scm", c2=0.0)
    prior = dataclasses.replace(DEFAULT_PRIOR, ground_variation=0.02)
    with pytest.raises(ConfigError, match=r"ground_variation 0\.02: with law scm"):
        build_model(load_rover("mars_rover"), [soil], prior=prior)
