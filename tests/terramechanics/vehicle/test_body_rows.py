# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rows that are affine in the strength, against what a simulated rover does."""

import torch

from terramechanics.contact.rolling import WheelMotion
from terramechanics.contact.stresses import quadrature
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.spatial import BodySimulation, Plane
from terramechanics.vehicle.body_rows import PLANAR, body_rows
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.steering import steered_command

SIX = Chassis.of(load_rover("mars_rover"), track=1.0, yaw_inertia=40.0)
SOIL = load_soil("loose_sand")


def test_rows_at_the_true_strength_are_the_motion_of_a_simulated_rover() -> None:
    """Of three soils of other strength, which accelerate in a turn on a slope."""
    strength = torch.tensor([[500.0, 0.5], [2000.0, 0.7], [4000.0, 0.3]], dtype=torch.float64)
    constants = SOIL.constants().expand(3, 6)
    simulation = BodySimulation(SIX, constants, strength, Plane(0.05, -0.08))
    twist = torch.tensor([0.15, 0.03, 0.2], dtype=torch.float64).expand(3, 3)
    rim, steering = steered_command(SIX, twist)
    simulation.step(rim, steering)
    before = simulation.velocity
    sample = simulation.step(1.2 * rim, steering)
    rows = body_rows(
        SIX,
        WheelMotion(sample.rim, sample.along, sample.across),
        sample.sinkage,
        steering,
        constants.unsqueeze(1),
        quadrature(12),
    )
    assert rows.shape == (3, 6 + 3 + 6, 3)
    found = (rows[..., :2] @ strength.unsqueeze(-1)).squeeze(-1) + rows[..., 2]
    angle = before[:, 2] * simulation.time_step
    along, left = before[:, 0], before[:, 1]
    turned = [
        torch.cos(angle) * along + torch.sin(angle) * left,
        torch.cos(angle) * left - torch.sin(angle) * along,
        before[:, 2],
    ]
    rate = (sample.velocity - torch.stack(turned, -1)) / simulation.time_step
    weight = SIX.mass * sample.gravity
    small = 1e-9 * SIX.weight
    assert (found[:, 0] - SIX.mass * rate[:, 0] + weight[:, 0]).abs().max() < small
    assert (found[:, 1] - SIX.mass * rate[:, 1] + weight[:, 1]).abs().max() < small
    assert (found[:, 2] - SIX.yaw_inertia * rate[:, 2]).abs().max() < small
    assert (found[:, PLANAR] + weight[:, 2]).abs().max() < small
    assert found[:, PLANAR + 1 : 9].abs().max() < small
    torch.testing.assert_close(found[:, 9:], sample.forces[..., 2], rtol=1e-9, atol=0.0)
