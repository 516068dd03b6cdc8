# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Pull of a rover that turns without steering on a plane slope: quasi-static equilibrium.

The wheels of the outer side turn at one rate, those of the inner side at another. Given are the
slip of the outer wheels and how tight the turn is; unknown are the depths of the wheels, the inner
rate and the lateral velocity. Equations are the balances and the closure of chassis.py but for the
force along x, which is the pull. Steady skid steering as in Yu, Chuy, Collins and Hollis (2010),
with the shear and pressure of ``rolling`` below each wheel.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from terramechanics.contact.stresses import quadrature
from terramechanics.numerics.roots import damped_newton, quasi_newton
from terramechanics.vehicle.body_step import SMALL, BodyStep, Method
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.climbing import Climb

SLOWEST = 1e-3
"""[1] Rim speed, in units of the outer rims', below which friction goes through zero smoothly."""
FASTEST = 4.0
"""[1] Bound of the inner rim's speed and of the lateral velocity, in units of the outer rims'."""
NEXT = 0.05
"""[1] Largest step from one turn to a tighter one that is sought from it."""
BOTH = (quasi_newton, damped_newton)
"""Methods in turn: the second is slow, and gets where the first does not."""
NO_PULL = -0.5
"""[weights] Pull in a turn that no rate of the inner wheels holds."""


@dataclass(frozen=True, slots=True)
class _Turn:
    """The equations of rovers that turn, [batch] each."""

    step: BodyStep
    along: Tensor  # v_x of the centre of mass, in units of the outer rims' speed
    yaw_rate: Tensor  # likewise, per m
    outer: Tensor  # [wheels] 1 where a wheel is on the outer side
    across: Tensor  # share of the weight across the slope [1]

    @classmethod
    def straight(
        cls,
        chassis: Chassis,
        constants: Tensor,
        strength: Tensor,
        slope: Tensor,
        slip: Tensor,
        points: int,
    ) -> "_Turn":
        """Set up rovers that drive straight on; arguments as those of :func:`turn`."""
        batch, wheels, nodes = len(slip), chassis.wheels, quadrature(points)
        level = torch.zeros(batch, wheels, dtype=torch.float64)
        still = torch.zeros(batch, 3, dtype=torch.float64)
        step = BodyStep.of(
            chassis,
            constants.unsqueeze(-2).expand(batch, wheels, 6),
            strength.unsqueeze(-2).expand(batch, wheels, 2),
            nodes, nodes, still, level + 1.0, level, still, 1.0, SLOWEST, steady=True,
        )  # fmt: skip
        # A turn to the left: the wheels on the right are outside.
        side = torch.tensor(chassis.wheel_y, dtype=torch.float64)
        outer = (side < 0.0).to(side.dtype)
        return cls(step, 1.0 - slip, torch.zeros_like(slip), outer, torch.cos(slope))

    def at(self, share: float, slip: Tensor) -> "_Turn":
        """Return the same in a turn of this share."""
        hub, half = 1.0 - slip, max(self.step.chassis.wheel_y)
        return replace(self, along=(1.0 - share) * hub, yaw_rate=share * hub / half)

    def rows(self, index: Tensor) -> "_Turn":
        return _Turn(
            self.step.rows(index),
            self.along[index],
            self.yaw_rate[index],
            self.outer,
            self.across[index],
        )

    def forces(self, unknown: Tensor) -> tuple[Tensor, Tensor]:
        """Return depths [batch, wheels] [m] and forces [batch, wheels, 4] [N], [N m].

        ``unknown`` [batch, wheels + 2] holds those of the depths, the inner rim's speed and v_y,
        both in units of the outer rims' speed.
        """
        step, wheels = self.step, self.step.chassis.wheels
        depth, (inner, left) = step.depth(unknown[:, :wheels]), unknown[:, wheels:].unbind(-1)
        rim = self.outer + (1.0 - self.outer) * inner.unsqueeze(-1)
        driven = replace(step, rim=rim)
        motion = driven.motion(torch.stack([self.along, left, self.yaw_rate], -1))
        return depth, driven.forces(motion, step.sinkage(depth), step.nodes)

    def balances(self, unknown: Tensor) -> tuple[Tensor, Tensor]:
        """Return balances [batch, 6 + J] in their units, and the closure [batch, W - 3 - J] [1].

        W wheels and J joints.
        """
        depth, forces = self.forces(unknown)
        chassis = self.step.chassis
        sums = torch.einsum("bhwf,bwf->bh", self.step.balances, forces)
        gap = depth + chassis.compliance * forces[..., 0]
        return sums, gap @ self.step.closure.T

    def residual(self, unknown: Tensor) -> Tensor:
        """Return what is not balanced [batch, wheels + 2]."""
        sums, closed = self.balances(unknown)
        weight = torch.zeros_like(sums)
        weight[:, 3] = self.across
        return torch.cat([(sums - weight)[:, 1:], closed], -1)

    def jacobian(self, unknown: Tensor) -> Tensor:
        """Return the derivatives of :meth:`residual` by differences."""
        here = self.residual(unknown)
        columns = []
        for k in range(unknown.shape[-1]):
            moved = unknown.clone()
            moved[:, k] += SMALL
            columns.append((self.residual(moved) - here) / SMALL)
        return torch.stack(columns, -1)


def turn(
    chassis: Chassis,
    constants: Tensor,
    strength: Tensor,
    slope: Tensor,
    slip: Tensor,
    shares: Sequence[float],
    points: int = 6,
) -> Climb:
    """Return pull and sinkage [shares, batch] in ever tighter turns, the outer wheels at ``slip``.

    ``shares`` [1], ascending, say how much of the outer hubs' speed is turning, |w| b / (v + |w| b)
    at a yaw rate w and half a track b: 0 straight on, 0.5 about the inner wheels, 1 on the spot.
    ``slope`` [batch] [rad] is positive uphill, ``slip`` [batch] [1], ``constants`` [batch, 6] in
    the order of CONSTANTS, ``strength`` [batch, 2]: c [Pa], tan(phi) [1].

    The pull is the sum of the wheels' forces along the body, against m g sin slope. A turn that no
    rate of the inner wheels holds has a pull of NO_PULL weights across the slope. No inertia: the
    turn is slow. The slope across is zero.
    """
    equations = _Turn.straight(chassis, constants, strength, slope, slip, points)
    low, high = equations.step.limits()
    wheels, bound = chassis.wheels, torch.full((2,), FASTEST, dtype=torch.float64)
    limits = torch.cat([low[:wheels], -bound]), torch.cat([high[:wheels], bound])
    deep = torch.full((len(slip), wheels), 0.1 * chassis.wheel_radius, dtype=torch.float64)
    still = torch.zeros_like(slip)
    unknown = torch.cat(
        [equations.step.unknown_of(deep), torch.stack([still + 1.0, still], -1)], -1
    )
    way = _way(shares)
    turns = [equations.at(share, slip) for share in way]
    tried = [_solved(turns[0], unknown, limits, *BOTH)]
    for share, here in zip(way[1:], turns[1:], strict=True):
        methods = BOTH if share in {*shares} else BOTH[:1]
        tried.append(_solved(here, tried[-1][0], limits, *methods))
    # What is not reached from straight on may be from the spot, from there, or from the rover
    # beside it in the batch, which a table makes a similar one.
    for at in range(len(way) - 2, -1, -1):
        _retry(turns[at], tried[at], tried[at + 1], limits)
    for at, share in enumerate(way):
        _retry(turns[at], tried[at], tried[max(at - 1, 0)], limits)
        for beside in (1, -1) if share in {*shares} else ():
            unknown, solved = tried[at]
            _retry(turns[at], tried[at], (unknown.roll(beside, 0), solved.roll(beside)), limits)
    pulls, depths = [], []
    for at in (way.index(share) for share in shares):
        here, (unknown, solved) = turns[at], tried[at]
        sums, _ = here.balances(unknown)
        pulls.append(chassis.weight * torch.where(solved, sums[:, 0], NO_PULL * here.across))
        depths.append(here.step.sinkage(here.step.depth(unknown[:, :wheels])).mean(-1))
    return Climb(torch.stack(pulls), torch.stack(depths))


def _retry(
    equations: _Turn,
    tried: tuple[Tensor, Tensor],
    other: tuple[Tensor, Tensor],
    limits: tuple[Tensor, Tensor],
) -> None:
    """Solve in place what is unsolved, from unknowns that solve another turn."""
    unknown, solved = tried
    left = (~solved & other[1]).nonzero().squeeze(-1)
    if left.numel() > 0:
        found = _solved(equations.rows(left), other[0][left], limits, *BOTH)
        unknown[left], solved[left] = found


def _way(shares: Sequence[float]) -> list[float]:
    """Return the shares from 0 on, with others between, so that no step is longer than NEXT."""
    way = [0.0]
    for share in shares:
        steps = max(1, math.ceil((share - way[-1]) / NEXT - 1e-9))
        way += np.linspace(way[-1], share, steps + 1)[1:].tolist() if share > way[-1] else []
    return way


def _solved(
    equations: _Turn, start: Tensor, limits: tuple[Tensor, Tensor], *methods: Method
) -> tuple[Tensor, Tensor]:
    """Return the unknowns, those of the start where there is no solution, and where there is."""
    unknown, solved = start.clone(), torch.zeros(len(start), dtype=torch.bool)
    for method in methods:
        left = (~solved).nonzero().squeeze(-1)
        if left.numel() == 0:
            break
        part = equations.rows(left)
        found, there = method(
            lambda u, rows, part=part: part.rows(rows).residual(u),  # type: ignore[misc]
            lambda u, rows, part=part: part.rows(rows).jacobian(u),  # type: ignore[misc]
            start[left],
            limits,
        )
        unknown[left[there]], solved[left] = found[there], there
    return unknown, solved
