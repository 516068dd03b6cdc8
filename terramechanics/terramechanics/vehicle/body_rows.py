# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the wheels do to a body, as functions of the soil's strength that are affine in it.

For given motion, sinkage and soil constants every balance of chassis.py and every wheel torque is
affine in (c, tan(phi)), as the forces of rolling.py are: that is what an estimator regresses on.
"""

import torch
from torch import Tensor

from terramechanics.contact.rolling import WheelMotion, compiled_rolling_forces
from terramechanics.vehicle.chassis import Chassis, Stance

PLANAR = 3
"""Rows of the forces along x and y and of the yaw moment, which come before all others."""


def body_rows(
    chassis: Chassis,
    motion: WheelMotion,
    sinkage: Tensor,
    steering: Tensor,
    constants: Tensor,
    nodes: Tensor,
    slowest: float = 0.0,
    stance: Stance | None = None,
) -> Tensor:
    """Return the coefficients of balances and torques [..., 6 + J + wheels, 3].

    ``motion``, ``sinkage`` [m] and ``steering`` [rad] are [..., wheels], ``constants`` spread to
    [..., wheels, 6] in the order of CONSTANTS; ``nodes`` and ``slowest`` as in rolling_forces. The
    ``stance`` is that of a plane by default.
    Columns: c [Pa], tan(phi) [1], 1. Rows: forces along x and y [N] and yaw moment [N m], force
    along z [N], moments nose-up and left side up and those of the joints [N m], then the torque M
    of every wheel [N m].

    The first three are m (dv/dt + omega x v - g) along the body and I domega/dt; the fourth is the
    weight across the plane, the other moments are zero (:meth:`Chassis.balance_matrix`).
    """
    forces = compiled_rolling_forces()(
        motion, sinkage, constants, chassis.wheel_radius, chassis.wheel_width, nodes, None, slowest
    )
    sums = torch.einsum("...hwf,...wfk->...hk", chassis.balance_matrix(steering, stance), forces)
    return torch.cat([sums, forces[..., 2, :]], -2)
