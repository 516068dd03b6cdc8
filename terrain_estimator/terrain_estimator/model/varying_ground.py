# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What ground that is not the same below every wheel adds to the noise of a block's rows.

Real ground changes by some percent within a rover's length. Below a wheel (or an axle) c, tan phi
and the stiffness (k_c and k_phi together) deviate from the ground's mean, each by a relative
deviation ``sd``. With the forces (N, T, M, ...) = c F_c + tan phi F_t + F_1 there, where the normal
stress makes F_1 and tan phi F_t, three sources of noise of unit variance move them by::

    sd c F_c,    sd tan phi F_t,    sd (tan phi F_t + F_1)

They are taken as independent from wheel to wheel and from block to block. Within a block they stay,
while the sources of its n observations count as independent: so each is larger by sqrt(n).

The c and tan phi of these products are those at which the rows are expanded. Noise in proportion to
the parameters would draw them up: without log det S in the posterior and the evidence
(``solution_of``), stronger ground would explain every misfit. docs/method.md has figures.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.model.rows import Rows


def ground_sources(levers: Tensor, forces: Tensor, theta: Tensor, sd: float) -> Tensor:
    """Return the changes [n, R, 3 W] of the rows of a block by the ground below each of W wheels.

    Args:
        levers: effect of each force of a wheel in a row [n, W, R, F].
        forces: of the wheels, columns c [kPa], tan phi, 1 [n, W, F, 3].
        theta: (c [kPa], tan phi, 1) [3].
        sd: relative deviation of the ground [1].
    """
    by_cohesion, by_friction, by_stress = ((levers @ forces) * theta).unbind(-1)
    moved = torch.cat([by_cohesion, by_friction, by_friction + by_stress], 1).transpose(1, 2)
    return (sd * torch.full_like(theta[0], levers.shape[0]).sqrt()) * moved


def with_sources(rows: Rows, moved: Tensor) -> Rows:
    """Return ``rows`` with the sources ``moved`` [n, R, S] of noise behind the others."""
    moved = nn.functional.pad(moved.unsqueeze(-1), [2, 0]).unsqueeze(0)
    moved = nn.functional.pad(moved, [0, 0, 0, 0, 0, 0, 0, 0, 0, rows.noise.shape[0] - 1])
    noise = torch.cat([rows.noise, moved], 3)
    return Rows(rows.features, noise, rows.target, rows.variance, rows.used, rows.taken)
