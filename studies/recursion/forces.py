# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The lifted forces on one wheel, from tables over slip and sinkage.

Where they are expanded about constants that stay, the forces are fixed functions of slip and
sinkage alone: cubic splines of them cost 16 reads, and have exact derivatives.
"""

import math
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import spline_filter1d
from torch import Tensor

from studies.recursion.lift import MONOMIALS, taylor
from terrain_estimator.model.rows import ContactModel
from terramechanics.contact.stresses import wheel_forces

SLIP = (-0.65, 0.99, 165)
"""[1] First and last slip of the table, and the number of slips."""
SHALLOWEST = 1e-4
"""[m] Least sinkage of the table; the largest is 0.9 of the wheel's radius."""
SINKAGES = 171
_CHUNK = 600


class WheelForces(NamedTuple):
    """Lifted forces of n wheels (N, T, M; columns: monomials, each by c [kPa], tan phi, 1).

    The values are unbiased to second order in the noise of slip and sinkage: half the second
    derivatives times the variances are taken off.
    """

    values: Tensor  # [n, 3, LIFTED]
    by_slip: Tensor  # [n, 3, LIFTED] change for one standard deviation
    by_sinkage: Tensor  # [n, 3, LIFTED]


class ForceTable:
    """Splines of the lifted forces over slip and the logarithm of the sinkage."""

    def __init__(self, contact: ContactModel, deviations: Tensor) -> None:
        """Tabulate the forces; ``deviations`` [M, 6] are prior deviations of the constants."""
        deepest = math.log(0.9 * contact.radius)
        slip = torch.linspace(*SLIP, dtype=torch.float64)
        depth = torch.linspace(math.log(SHALLOWEST), deepest, SINKAGES, dtype=torch.float64)
        self._first = torch.stack([slip[0], depth[0]])
        self._step = torch.stack([slip[1] - slip[0], depth[1] - depth[0]])
        sets, weights = taylor(contact.constants, deviations)
        lifted = torch.zeros(slip.shape[0], SINKAGES, MONOMIALS, 9, dtype=torch.float64)
        for constants, weight in zip(sets, weights.T, strict=True):
            forces = wheel_forces(
                slip.unsqueeze(1),
                depth.exp(),
                constants,
                contact.radius,
                contact.width,
                contact.nodes,
            )
            each = (forces * contact.column_unit).flatten(2).unsqueeze(2)
            lifted += each * weight.unsqueeze(1)
        # [slips, sinkages, 3 (N, T, M), monomials, 3 (c, tan phi, 1)]
        ordered = lifted.unflatten(3, (3, 3)).transpose(2, 3).flatten(2).numpy()  # type: ignore[no-untyped-call]
        filtered = spline_filter1d(spline_filter1d(ordered, axis=0), axis=1)
        self._table = torch.from_numpy(np.ascontiguousarray(filtered)).flatten(0, 1)

    def at(self, slip: Tensor, slip_sd: Tensor, sinkage: Tensor, sinkage_sd: Tensor) -> WheelForces:
        """Return the lifted forces of n wheels, each argument [n]."""
        inputs = torch.stack([slip, slip_sd, sinkage, sinkage_sd])
        pieces = [self._chunk(*fields) for fields in torch.split(inputs, _CHUNK, 1)]
        read = torch.cat(pieces).unflatten(2, (3, -1))  # type: ignore[no-untyped-call]
        return WheelForces(*read.unbind(1))

    def _chunk(self, slip: Tensor, slip_sd: Tensor, sinkage: Tensor, sinkage_sd: Tensor) -> Tensor:
        """Return values and changes [n, 3, 3 LIFTED]."""
        deepest = 0.89 / 0.9 * math.exp(float(self._first[1] + self._step[1] * (SINKAGES - 3)))
        sinkage = sinkage.clamp(1.1 * SHALLOWEST, deepest)
        place = torch.stack([slip, sinkage.log()], 1)
        scaled = (place - self._first) / self._step
        whole = scaled.floor().long()
        whole = torch.minimum(whole.clamp(min=1), torch.tensor([SLIP[2] - 3, SINKAGES - 3]))
        x, dx, ddx = cubic(scaled - whole)
        near = torch.arange(-1, 3)
        corner = (whole[:, :1, None] + near[:, None]) * SINKAGES + whole[:, 1:, None] + near
        slip_step = (slip_sd / self._step[0]).unsqueeze(1)
        # z d/dz = d/dlog z, and z^2 d^2/dz^2 = d^2/dlog z^2 - d/dlog z
        relative = (sinkage_sd / sinkage).unsqueeze(1)
        by_log = dx[:, 1] / self._step[1]
        curved = ddx[:, 1] / self._step[1] ** 2 - by_log
        weights = torch.stack(
            [
                _outer(x[:, 0] - 0.5 * slip_step**2 * ddx[:, 0], x[:, 1])
                - _outer(x[:, 0], 0.5 * relative**2 * curved),
                _outer(slip_step * dx[:, 0], x[:, 1]),
                _outer(x[:, 0], relative * by_log),
            ],
            1,
        )
        return weights @ self._table[corner.flatten(1)]


def _outer(by_slip: Tensor, by_sinkage: Tensor) -> Tensor:
    return (by_slip.unsqueeze(2) * by_sinkage.unsqueeze(1)).flatten(1)


def cubic(t: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return weights of four neighbours of a uniform cubic B-spline [..., 4], at t in [0, 1].

    With them come their first and second derivatives.
    """
    s = 1.0 - t
    values = [s**3, 3 * t**3 - 6 * t**2 + 4, 3 * s**3 - 6 * s**2 + 4, t**3]
    slopes = [-3 * s**2, 9 * t**2 - 12 * t, 12 * s - 9 * s**2, 3 * t**2]
    bends = [6 * s, 18 * t - 12, 18 * s - 12, 6 * t]
    return (
        torch.stack(values, -1) / 6.0,
        torch.stack(slopes, -1) / 6.0,
        torch.stack(bends, -1) / 6.0,
    )
