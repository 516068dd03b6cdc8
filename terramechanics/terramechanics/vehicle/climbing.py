# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pull of a rover on a plane slope: quasi-static equilibrium of all wheels at one slip."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from terramechanics.contact.sinkage import WheelGround
from terramechanics.terrain.soil import WONG_REECE
from terramechanics.vehicle.equilibrium import StepEquations, carried
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import level_pose

ROUNDS = 3
"""Iterations of loads and tractions; each leaves some per cent of the error before it."""


@dataclass(frozen=True, slots=True)
class Climb:
    """Rovers on slopes, all wheels of each at one slip; [batch] each."""

    # [N] sum of the wheels' traction along the slope, against m (dv/dt + g sin slope)
    pull: Tensor
    sinkage: Tensor  # [m] mean over the axles


def climb(
    rover: Rover,
    constants: Tensor,
    strength: Tensor,
    slope: Tensor,
    slip: Tensor,
    points: int = 6,
    law: str = WONG_REECE,
) -> Climb:
    """Return pull and sinkage on plane slopes with all wheels at ``slip`` [batch] [1].

    ``slope`` [batch] [rad] is positive uphill.

    ``constants`` [batch, 6] in the order of CONSTANTS, ``strength`` [batch, 2]: c [Pa], tan(phi)
    [1]. Loads follow from the balances of suspension.py, forces from the integrals of the contact
    ``law`` with ``points`` nodes a side, every wheel on fresh ground. Raises ConfigError for
    a rover that is not planar.
    """
    rover.check_planar()
    pose = replace(level_pose(rover, torch.zeros_like(slope)), pitch=slope)
    axles = (*slope.shape, rover.axles)
    wheel = WheelGround.of(
        rover,
        constants.unsqueeze(-2).expand(*axles, 6),
        strength.unsqueeze(-2).expand(*axles, 2),
        points,
        law=law,
    )
    step = StepEquations.of(rover, pose, wheel, wheel, torch.zeros_like(slope), duration=1.0)
    every = slip.unsqueeze(-1).expand(axles)
    depth = carried(
        step, every, torch.full(axles, 0.1 * rover.wheel_radius, dtype=slope.dtype), ROUNDS
    )
    return Climb(rover.wheels_per_axle * wheel.forces(every, depth)[..., 1].sum(-1), depth.mean(-1))
