# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The contact law of the soil contact model (SCM) as integrals over a rigid wheel.

SCM keeps a grid of the ground: each node has a height, a pressure and a shear displacement (Krenn
and Hirzinger 2009, Tasora et al. 2019). Under a rigid wheel on level ground that moves steadily its
forces are integrals over the place x = r sin(theta), from theta_1 in front to -theta_2 behind::

    p = k d^n,  k = k_c / b + k_phi,  d = z - r (1 - cos)            pressure, along the normal
    j = j_0 + INT |1 - cos / (1 - i)| dx                             shear, of one node
    tau = (c + p tan(phi)) E,  E = -sgn(1 - cos / (1 - i)) (1 - exp(-j / K))
    N = b INT p dx
    T = b INT tau dx
    M = b INT (p r sin + tau r cos) dx

It differs from Wong and Reece (``stresses``) in four ways. Pressure has no share along the ground,
so that the ground does not resist by compaction. Pressure is largest below the axle: c1 and c2 have
no meaning. The rim's speed along the ground, v - r w cos, is summed up at a fixed place of the
ground while the wheel passes, which gives about 1 / (1 - i) of the displacement along the rim. And
the ground keeps what was done to it: a wheel that follows finds the :class:`Rut` of depth h and the
shear j_0 of the wheels before, touches the ground from z - h on, and presses it by its depth
below the surface that nobody had touched.

The ground springs back by a share of the sinkage, ``rebound``: behind the axle pressure falls
linearly with the height by which the ground rises, and the rut is as much shallower. A wheel that
follows presses the rut down again along the same line. For SCM's elastic stiffness k_e [Pa/m] the
share is k z^(n-1) / k_e. Rates (SCM's damping) do not enter.

N, T and M are affine in (c, tan(phi)). Of the soil constants the law has n, k_c, k_phi, K, and in
the place of c1 the rebound; c2 has no meaning.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terramechanics.contact.stresses import entry_angle


class Rut(NamedTuple):
    """What the wheels before did to the ground, [...] each; all zero is fresh ground."""

    depth: Tensor  # [m] deepest sinkage below the surface that nobody touched
    shear: Tensor  # [m] shear displacement


def shear_left(slip: Tensor, sinkage: Tensor, radius: float) -> Tensor:
    """Return the shear displacement [m] that a wheel adds to the ground by passing over it.

    ``sinkage`` [m] is that below the surface just ahead. Contact ends below the axle.
    """
    theta_1, turn = entry_angle(sinkage, radius), turning_angle(slip)
    return _sheared(theta_1, turn, slip, radius)


def turning_angle(slip: Tensor) -> Tensor:
    """Return acos(1 - i) [rad], inside of which the rim moves backwards; 0 where i <= 0.

    In front of it the rim of a driven wheel moves forwards with the wheel.
    """
    return 2.0 * torch.asin(torch.sqrt(0.5 * torch.clamp(slip, 0.0, 1.0)))


def _signed(theta: Tensor, slip: Tensor, radius: float) -> Tensor:
    """Return INT (1 - cos / (1 - i)) dx [m] from 0 to theta."""
    sine = torch.sin(theta)
    return radius * (sine - 0.5 * (theta + sine * torch.cos(theta)) / (1.0 - slip))


def _sheared(theta: Tensor, turn: Tensor, slip: Tensor, radius: float) -> Tensor:
    """Return INT |1 - cos / (1 - i)| dx [m] from 0 to theta, negative behind the axle."""
    angle = torch.abs(theta)
    inside = torch.minimum(angle, turn)
    whole = _signed(angle, slip, radius) - 2.0 * _signed(inside, slip, radius)
    return torch.sign(theta) * whole


def _sprung(height: Tensor, deepest: Tensor, spring: Tensor, n: Tensor) -> Tensor:
    """Return pressure over k at a height d where the ground was pressed ``deepest`` before."""
    left = 1.0 - (deepest - height) / torch.clamp(deepest * spring, min=1e-12)
    return torch.pow(deepest, n) * torch.clamp(left, 0.0, 1.0)


def scm_forces(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    rut: Rut | None = None,
) -> Tensor:
    """Return the coefficients of N, T [N] and M [N m] of one wheel, affine in (c [Pa], tan(phi)).

    Arguments and result as of :func:`terramechanics.contact.stresses.wheel_forces`, besides the
    ``rut`` of the wheels before, None on fresh ground. ``sinkage`` is measured from the surface
    that nobody touched. An ``exit_angle`` [rad] adds r (1 - cos) to the rebound. There is no side
    force.
    """
    spring = constants[..., 4]
    if exit_angle is not None:
        spring = spring + 2.0 * radius * torch.sin(0.5 * exit_angle) ** 2 / sinkage
    spring = torch.clamp(spring, 1e-6, 1.0)  # the end of the contact has to be found
    deepest, own = sinkage, sinkage
    if rut is not None:
        deepest = torch.maximum(sinkage, rut.depth)
        # No wheel that is carried floats above the rut.
        own = torch.maximum(sinkage - rut.depth * (1.0 - spring), 1e-3 * sinkage)
    theta_1, turn = entry_angle(own, radius), turning_angle(slip)
    risen = torch.clamp(sinkage - deepest * (1.0 - spring), min=0.0)
    below, rear = torch.zeros_like(theta_1), -entry_angle(risen, radius)
    kink, rear_kink = torch.minimum(turn, theta_1), torch.maximum(-turn, rear)
    ends = [theta_1, kink, below, rear_kink, rear]
    if rut is not None:
        pressed = torch.clamp(sinkage - rut.depth, min=0.0)
        bore = torch.minimum(entry_angle(pressed, radius), theta_1)
        ends = [
            theta_1, torch.maximum(bore, kink), torch.minimum(bore, kink), below, rear_kink, rear
        ]  # fmt: skip
    u, weight = nodes.view([2, -1] + [1] * theta_1.dim()).unbind(0)
    edges = torch.stack(ends).unsqueeze(1)
    length = edges[:-1] - edges[1:]
    theta = edges[:-1] - length * (u * u)  # [pieces, P, ...]
    sine, cosine = torch.sin(theta), torch.cos(theta)
    step = (2.0 * radius * width) * (length * (u * weight) * cosine)

    n, k_c, k_phi, shear_modulus = constants[..., :4].unbind(-1)
    down = entry_angle(sinkage, radius)
    height = (2.0 * radius) * torch.sin(0.5 * (down + theta)) * torch.sin(0.5 * (down - theta))
    height = torch.clamp(height, min=0.0)
    front = torch.pow(height, n)
    if rut is not None:
        front = torch.where(height < rut.depth, _sprung(height, rut.depth, spring, n), front)
    bearing = torch.where(theta < 0.0, _sprung(height, deepest, spring, n), front)
    normal = (k_c / width + k_phi) * bearing * step

    moved = _sheared(theta_1, turn, slip, radius) - _sheared(theta, turn, slip, radius)
    if rut is not None:
        moved = moved + rut.shear
    backwards = torch.abs(theta) < turn
    share = torch.expm1(-moved / shear_modulus)
    mobilised = torch.where(backwards, -share, share)
    return _rows(step * mobilised, normal * mobilised, normal, sine, cosine, radius)


def _rows(
    by_c: Tensor, by_friction: Tensor, normal: Tensor, sine: Tensor, cosine: Tensor, radius: float
) -> Tensor:
    """Sum forces along the ground by c and tan(phi), and along its normal, of all nodes."""
    zero = torch.zeros_like(normal[0, 0])
    arm = radius * cosine
    rows = [
        torch.stack([zero, zero, normal.sum([0, 1])]),
        torch.stack([by_c.sum([0, 1]), by_friction.sum([0, 1]), zero]),
        torch.stack(
            [
                (by_c * arm).sum([0, 1]),
                (by_friction * arm).sum([0, 1]),
                (normal * (radius * sine)).sum([0, 1]),
            ]
        ),
    ]
    return torch.stack(rows).movedim([0, 1], [-2, -1])
