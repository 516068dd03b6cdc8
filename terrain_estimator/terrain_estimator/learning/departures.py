# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Plants that depart from the physics of the rows by effects of random size.

The net is trained and judged on them. There are two families that share no effect. A net that was
trained on the first is judged on both; the second stands for effects that were not modelled.
"""

import math
from collections.abc import Mapping
from enum import Enum

import torch

from terramechanics.effects import make_effect
from terramechanics.simulation.plant import Plant
from terramechanics.vehicle.rover import Rover

HIDDEN = 0.4
"""[1] Share of the drives in which each effect of a family acts."""


class Family(Enum):
    """Family of effects that a plant may have."""

    LEARNT = "seen in training"
    FOREIGN = "not seen in training"


def largest_sizes(family: Family, rover: Rover) -> Mapping[str, tuple[float, float]]:
    """Return the ranges of the effects of a family, in their units.

    At its ends each effect outweighs the sensors' noise on this rover.
    """
    torque = 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)
    rate = 0.2 / rover.wheel_radius
    load = rover.weight / len(rover.wheels)
    sinkage = 60.0 * rover.sinkage_noise_floor
    tilt = math.radians(1.0)
    learnt = {
        "slope_bias": (-tilt, tilt),
        "drive_drag": (0.0, 0.15 * torque / rate),
        "slip_sinkage": (0.0, 0.4),
        "multipass": (0.0, 0.5),
        "odometry_scale": (-0.05, 0.05),
        "sinkage_bias": (-sinkage / 6.0, sinkage / 6.0),
    }
    foreign = {
        "bulldozing": (0.0, 0.08 * load / sinkage**2),
        "payload": (-0.1 * rover.mass, 0.15 * rover.mass),
        "grousers": (0.0, 0.12 * load),
        "rate_dependence": (-0.3, 0.3),
        "exit_angle": (0.0, 0.5),
        "coulomb_drag": (0.0, 0.15 * torque),
    }
    return learnt if family is Family.LEARNT else foreign


def random_plant(
    family: Family, rover: Rover, batch: int, share: float, generator: torch.Generator
) -> Plant | None:
    """Draw a plant in which every effect of the family acts in a ``share`` [1] of the episodes.

    Sizes are uniform over their ranges. None for a share of 0.
    """
    if share == 0.0:
        return None
    effects = []
    for name, (low, high) in largest_sizes(family, rover).items():
        there, place = torch.rand(2, batch, generator=generator, dtype=torch.float64).unbind(0)
        effects.append(
            make_effect(name, torch.where(there < share, low + (high - low) * place, 0.0))
        )
    return Plant(effects)
