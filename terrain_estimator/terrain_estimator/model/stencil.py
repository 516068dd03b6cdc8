# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Finite differences of the forces on a wheel, over slip, sinkage and soil constants."""

from typing import NamedTuple

import torch
from torch import Tensor

OWN = 6
"""Number of inputs with the soil constants as given; they stand first."""


class Stencil(NamedTuple):
    """K = 3 + 3 C inputs at which forces are evaluated, and the weights that give changes."""

    moves: Tensor  # [K, 2] deviations by which slip and sinkage are moved
    constants: Tensor  # [K] int: which of the C sets of soil constants
    weights: Tensor  # [3, C, K] in the values and in their changes by slip and by sinkage
    # in half the second differences by slip and by sinkage, and in the mixed one
    curvature: Tensor  # [3, K]


def stencil(uncertain: int) -> Stencil:
    """Return finite differences over slip, sinkage and M = ``uncertain`` soil constants.

    Each constant is varied by a thousandth of its deviation.
    With the constants as given both sides are taken: a central difference over plus and minus one
    deviation averages a curved law over the spread of its input. For the changes by the constants
    one side is enough.
    """
    sets = 1 + uncertain
    own = [
        [0.0, -1.0],
        [-1.0, 0.0],
        [0.0, 0.0],
        [1.0, 0.0],
        [0.0, 1.0],
        [1.0, 1.0],
    ]  # OWN of them, with the constants as given
    moves = torch.tensor([*own, *(own[2:5] * uncertain)], dtype=torch.float64)
    one_sided = torch.zeros(3, sets, 3 + 3 * sets, dtype=torch.float64)
    for k in range(sets):
        value = 3 + 3 * k if k else 2
        one_sided[:, k, value] = torch.tensor([1.0, -1.0, -1.0])
        one_sided[1, k, value + 1] = one_sided[2, k, value + 2] = 1.0
    weights = 1e3 * (one_sided - one_sided[:, :1])
    weights[0, 0, 2] = 1.0
    weights[1, 0, [3, 1]] = weights[2, 0, [4, 0]] = torch.tensor([0.5, -0.5], dtype=torch.float64)
    curvature = torch.zeros(3, 3 + 3 * sets, dtype=torch.float64)
    curvature[0, [3, 1, 2]] = curvature[1, [4, 0, 2]] = torch.tensor(
        [0.5, 0.5, -1.0], dtype=torch.float64
    )
    curvature[2, [5, 3, 4, 2]] = torch.tensor([1.0, -1.0, -1.0, 1.0], dtype=torch.float64)
    return Stencil(
        moves,
        torch.tensor([0] * OWN + [k for k in range(1, sets) for _ in range(3)]),
        weights,
        curvature,
    )
