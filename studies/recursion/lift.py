# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The lifted parameters psi: (c [kPa], tan phi, 1) times powers of the soil constants' deviations.

With the forces expanded to second order about fixed constants, a row is linear in psi, whatever is
learnt later about the constants.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terrain_estimator.model.physics import UNCERTAIN

CONSTANTS = len(UNCERTAIN)
_LINEAR = UNCERTAIN.index("k_phi")
PAIRS = [(i, j) for i in range(CONSTANTS) for j in range(i, CONSTANTS) if (i, j) != (_LINEAR,) * 2]
"""Second-order terms. Stresses are linear in the stiffness, so it has no square."""
MONOMIALS = 1 + CONSTANTS + len(PAIRS)
FIRST = 3 * (1 + CONSTANTS)
"""Lifted parameters of order zero and one in the constants; they stand first."""
LIFTED = 3 * MONOMIALS
BODY = 2
"""Mass and centre of mass, which stand behind the lifted parameters."""


class LiftedPoint(NamedTuple):
    """Values and derivatives of the lifted parameters at G points k = (c, tan phi, kappa, body)."""

    psi: Tensor  # [G, LIFTED + BODY]
    jacobian: Tensor  # [G, LIFTED + BODY, 2 + CONSTANTS + BODY]


def monomials(kappa: Tensor) -> tuple[Tensor, Tensor]:
    """Return the monomials [G, MONOMIALS] of deviations [G, M], and their derivatives [G, ., M]."""
    first, second = torch.tensor(PAIRS).T
    products = kappa[:, first] * kappa[:, second]
    values = torch.cat([torch.ones_like(kappa[:, :1]), kappa, products], 1)
    own = torch.eye(CONSTANTS, dtype=kappa.dtype)
    by_pair = own[first] * kappa[:, second].unsqueeze(2) + own[second] * kappa[:, first].unsqueeze(
        2
    )
    unit = torch.cat([torch.zeros_like(own[:1]), own]).expand(kappa.shape[0], -1, -1)
    return values, torch.cat([unit, by_pair], 1)


def lift(k: Tensor) -> LiftedPoint:
    """Return the lifted parameters at k [G, 2 + M + BODY]."""
    strength, kappa, body = k.split_with_sizes([2, CONSTANTS, BODY], 1)
    theta = torch.cat([strength, torch.ones_like(strength[:, :1])], 1)
    values, slopes = monomials(kappa)
    psi = torch.cat([(values.unsqueeze(2) * theta.unsqueeze(1)).flatten(1), body], 1)
    by_theta = torch.eye(3, 2, dtype=k.dtype) * values.view(-1, MONOMIALS, 1, 1)
    by_kappa = slopes.unsqueeze(2) * theta.view(-1, 1, 3, 1)
    jacobian = k.new_zeros(k.shape[0], LIFTED + BODY, k.shape[1])
    jacobian[:, :LIFTED, :2] = by_theta.flatten(1, 2)
    jacobian[:, :LIFTED, 2 : 2 + CONSTANTS] = by_kappa.flatten(1, 2)
    jacobian[:, LIFTED:, 2 + CONSTANTS :] = torch.eye(BODY, dtype=k.dtype)
    return LiftedPoint(psi, jacobian)


def taylor(constants: Tensor, deviations: Tensor) -> tuple[Tensor, Tensor]:
    """Return sets of constants [S, 6] and the weights [MONOMIALS, S] that give the coefficients.

    ``constants`` [6] are the nominal ones, ``deviations`` [M, 6] one prior deviation of each.
    """
    mixed = [pair for pair in PAIRS if pair[0] != pair[1]]
    ups, downs = range(1, 1 + CONSTANTS), range(1 + CONSTANTS, 1 + 2 * CONSTANTS)
    sets = [constants, *(constants + d for d in deviations), *(constants - d for d in deviations)]
    weights = torch.zeros(MONOMIALS, 1 + 2 * CONSTANTS + len(mixed), dtype=constants.dtype)
    weights[0, 0] = 1.0
    for i in range(CONSTANTS):
        weights[1 + i, ups[i]], weights[1 + i, downs[i]] = 0.5, -0.5
    for row, (i, j) in enumerate(PAIRS, 1 + CONSTANTS):
        if i == j:
            weights[row, [ups[i], downs[i], 0]] = weights.new_tensor([0.5, 0.5, -1.0])
        else:
            weights[row, [len(sets), ups[i], ups[j], 0]] = weights.new_tensor([1.0, -1, -1, 1])
            sets.append(constants + deviations[i] + deviations[j])
    return torch.stack(sets), weights
