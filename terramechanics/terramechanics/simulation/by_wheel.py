# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of rovers that turn as samples with a value for each wheel, which sensors measure."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from terramechanics.simulation.sample import TIME_STEP, Sample
from terramechanics.simulation.spatial import BodySample
from terramechanics.vehicle.rover import Rover


def sample_by_wheel(rover: Rover, driven: Sequence[BodySample], order: Sequence[int]) -> Sample:
    """Return the true values [batch, time, wheels] of drives, of which these are the steps.

    ``order`` [wheels] has each wheel's place in them. Steps last TIME_STEP, and start at rest. What
    no sensor measures is NaN or zero.
    """

    def stacked(name: str) -> Tensor:
        return torch.stack([getattr(sample, name) for sample in driven], 1)

    def wheels(name: str) -> Tensor:
        return stacked(name)[:, :, order]

    velocity, slip, forces = stacked("velocity"), wheels("slip"), wheels("forces")
    before = torch.cat([torch.zeros_like(velocity[:, :1]), velocity[:, :-1]], 1)
    turned = velocity[..., 2] * TIME_STEP
    ahead = torch.cos(turned) * before[..., 0] + torch.sin(turned) * before[..., 1]
    level, never = torch.zeros_like(turned), torch.zeros_like(turned, dtype=torch.bool)
    bogies = 2 * len(rover.suspension)  # left and right, before the differential
    bogie = stacked("joints")[..., :bogies].mean(-1) if bogies else level
    return Sample(
        time=stacked("time"),
        position=stacked("position")[..., 0],
        height=level,
        velocity=velocity[..., 0],
        acceleration=(velocity[..., 0] - ahead) / TIME_STEP,
        pitch=stacked("pitch"),
        bogie_angle=bogie,
        stuck=never,
        standing=never,
        slip=slip,
        sinkage=wheels("sinkage"),
        contact=torch.zeros_like(slip),
        contact_angle=wheels("contact_angle"),
        wheel_rate=wheels("rim") / rover.wheel_radius,
        torque=wheels("torque"),
        normal=forces[..., 0],
        traction=forces[..., 1],
        ground_torque=forces[..., 2],
        valid=torch.isfinite(slip),
        constants=torch.full((*slip.shape, 6), math.nan, dtype=torch.float64),
        strength=torch.full((*slip.shape, 2), math.nan, dtype=torch.float64),
    )
