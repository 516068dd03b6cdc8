# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Finite differences of the forces between wheel and ground, over slip, sinkage and soil constants."""

from typing import NamedTuple

import torch
from torch import Tensor


class Stencil(NamedTuple):
    """At which K = 2 + 3 C inputs forces are evaluated, and how changes are read from them: see :func:`stencil`."""

    moves: Tensor  # [K, 2] deviations by which slip and sinkage are moved
    constants: Tensor  # [K] int: which of the C sets of soil constants
    weights: Tensor  # [3, C, K] of the evaluations in the values and in their changes by slip and by sinkage


def stencil(uncertain: int) -> Stencil:
    """Finite differences over slip, sinkage and M = ``uncertain`` soil constants, each varied by a thousandth of its deviation.

    With the constants as given both sides are taken: a central difference over plus and minus one deviation averages a curved law over
    the spread of its input. For the changes by the constants one side is enough.
    """
    sets = 1 + uncertain
    moves = torch.tensor([[0.0, -1.0], [-1.0, 0.0], *([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]] * sets)], dtype=torch.float64)
    one_sided = torch.zeros(3, sets, 2 + 3 * sets, dtype=torch.float64)
    for k in range(sets):
        value = 2 + 3 * k
        one_sided[:, k, value] = torch.tensor([1.0, -1.0, -1.0])
        one_sided[1, k, value + 1] = one_sided[2, k, value + 2] = 1.0
    weights = 1e3 * (one_sided - one_sided[:, :1])
    weights[0, 0, 2] = 1.0
    weights[1, 0, [3, 1]] = weights[2, 0, [4, 0]] = torch.tensor([0.5, -0.5], dtype=torch.float64)
    return Stencil(moves, torch.tensor([0, 0, *(k for k in range(sets) for _ in range(3))]), weights)
