# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One implicit time step: the slip and sinkage of every wheel that balance the rover.

Unknown are the sinkages of the axles and, with commanded wheel rates, the velocity at the end of the step; with commanded
torques the slips. Equations are the balances of suspension.py. Traction changes by its whole range within a few mm/s of
velocity, so the step is implicit: forces hold over the step and belong to its end velocity.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.contact import MAX_SLIP, MIN_SLIP
from terramechanics.rover import Rover
from terramechanics.sinkage import DEEPEST, SHALLOWEST, WheelGround, equilibrium_sinkage, slip_under_torque
from terramechanics.suspension import Pose, balance_matrix, balance_target, wheel_loads

TOLERANCE = 1e-10
"""[1] Largest imbalance, in units of the weight (of weight times wheelbase for moments)."""
Function = Callable[[Tensor, Tensor], Tensor]
MAX_ITERATIONS = 24
REFRESH = 5
"""Iterations between two Jacobians by differences; Broyden's update serves in between."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """What the wheels do in one step: [batch, axles] each, and whether the equations were solved [batch]."""

    slip: Tensor
    sinkage: Tensor
    forces: Tensor  # [batch, axles, 3] N, T [N], M [N m] of one wheel
    velocity: Tensor  # [batch] at the end of the step [m/s]
    solved: Tensor


@dataclass(frozen=True, slots=True)
class Step:
    """The equations of one time step, without the command."""

    rover: Rover
    pose: Pose
    wheel: WheelGround
    coarse: WheelGround  # the same with few quadrature points: good enough for a Jacobian
    matrix: Tensor  # [batch, 4, axles, 3] balance_matrix
    velocity: Tensor  # [batch] at the start of the step [m/s]
    duration: float  # [s]

    @classmethod
    def of(cls, rover: Rover, pose: Pose, wheel: WheelGround, coarse: WheelGround, velocity: Tensor, duration: float) -> "Step":
        """The step from ``velocity`` over ``duration`` in ``pose``."""
        return cls(rover, pose, wheel, coarse, balance_matrix(rover, pose), velocity, duration)

    def rows(self, index: Tensor) -> "Step":
        """The same for some of the episodes."""
        pose = Pose(*(getattr(self.pose, name)[index] for name in Pose.__slots__))
        wheel, coarse = self.wheel.rows(index), self.coarse.rows(index)
        return Step(self.rover, pose, wheel, coarse, self.matrix[index], self.velocity[index], self.duration)

    def imbalance(self, forces: Tensor, velocity: Tensor) -> Tensor:
        """Imbalances [batch, 4] in units of the weight and of weight times wheelbase."""
        target = balance_target(self.rover, self.pose.pitch, (velocity - self.velocity) / self.duration)
        balance = torch.einsum("...raf,...af->...r", self.matrix, forces)
        return (balance - target) / self.scale

    @property
    def scale(self) -> Tensor:
        """Units of the four balances."""
        weight, base = self.rover.weight, self.rover.axle_x[0] - self.rover.axle_x[-1]
        return torch.tensor([weight, weight, weight * base, weight * base], dtype=torch.float64)

    def sensitivities(self, slip: Tensor, sinkage: Tensor) -> tuple[Tensor, Tensor]:
        """Change of the balances with log(sinkage) and with slip of every axle, [batch, 4, axles] each."""
        small = 1e-6
        slips = torch.stack([slip, slip, slip + small])
        sinkages = torch.stack([sinkage, sinkage * (1.0 + small), sinkage])
        forces = self.coarse.forces(slips, sinkages)
        matrix = self.matrix / self.scale[:, None, None]
        by_depth = torch.einsum("...raf,...af->...ra", matrix, (forces[1] - forces[0]) / small)
        by_slip = torch.einsum("...raf,...af->...ra", matrix, (forces[2] - forces[0]) / small)
        return by_depth, by_slip


def slip_at(rover: Rover, velocity: Tensor, rate: Tensor) -> Tensor:
    """Slip i = 1 - v / (r w) of ``rate`` [batch, axles] [rad/s] at ``velocity`` [batch] [m/s]."""
    return 1.0 - velocity.unsqueeze(-1) / (rover.wheel_radius * rate)


def solve_rates(step: Step, rate: Tensor, sinkage: Tensor, velocity: Tensor) -> Contacts:
    """Contacts for commanded wheel rates [batch, axles] [rad/s], all positive; ``sinkage`` and ``velocity`` are the start."""
    speed = step.rover.wheel_radius * rate
    unit = speed.mean(-1)
    unknown = torch.cat([sinkage.log(), (velocity / unit).unsqueeze(-1)], dim=-1)

    def contacts(u: Tensor, index: Tensor) -> tuple[Step, Tensor, Tensor, Tensor]:
        end = u[:, -1] * unit[index]
        return step.rows(index), slip_at(step.rover, end, rate[index]), u[:, :-1].exp(), end

    def residual(u: Tensor, index: Tensor) -> Tensor:
        part, slip, depth, end = contacts(u, index)
        return part.imbalance(part.wheel.forces(_clamped(slip), depth), end)

    def jacobian(u: Tensor, index: Tensor) -> Tensor:
        part, slip, depth, _ = contacts(u, index)
        by_depth, by_slip = part.sensitivities(_clamped(slip), depth)
        inertia = step.rover.mass / step.duration / step.scale[0] * unit[index]
        moving = torch.where(slip == _clamped(slip), -unit[index].unsqueeze(-1) / speed[index], 0.0)
        by_velocity = (by_slip * moving.unsqueeze(-2)).sum(-1)
        by_velocity = by_velocity - inertia.unsqueeze(-1) * torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)
        return torch.cat([by_depth, by_velocity.unsqueeze(-1)], dim=-1)

    unknown, solved = _newton(residual, jacobian, unknown, _depth_limits(step, (-3.0, 3.0), 1))
    depth, end = unknown[:, :-1].exp(), unknown[:, -1] * unit
    left = (~solved).nonzero().squeeze(-1)
    if left.numel() > 0:
        depth[left], end[left], solved[left] = _search_rates(step.rows(left), rate[left])
    slip = _clamped(slip_at(step.rover, end, rate))
    return Contacts(slip, depth, step.wheel.forces(slip, depth), end, solved)


def solve_torques(step: Step, torque: Tensor, sinkage: Tensor, slip: Tensor) -> Contacts:
    """Contacts for commanded torques of one wheel [batch, axles] [N m]; ``sinkage`` and ``slip`` are the start."""
    unit = step.rover.weight * step.rover.wheel_radius / len(step.rover.wheels)
    axles = step.rover.axles

    def residual(u: Tensor, index: Tensor) -> Tensor:
        part = step.rows(index)
        forces = part.wheel.forces(u[:, axles:], u[:, :axles].exp())
        return torch.cat([part.imbalance(forces, part.velocity)[:, 1:], (forces[..., 2] - torque[index]) / unit], dim=-1)

    def jacobian(u: Tensor, index: Tensor) -> Tensor:
        part, slips, depth = step.rows(index), u[:, axles:], u[:, :axles].exp()
        by_depth, by_slip = part.sensitivities(slips, depth)
        small = 1e-6
        moved = torch.stack([part.coarse.forces(slips, depth * (1.0 + small)), part.coarse.forces(slips + small, depth)])
        change = (moved - part.coarse.forces(slips, depth))[..., 2] / small / unit
        balance = torch.cat([by_depth, by_slip], dim=-1)[:, 1:]
        return torch.cat([balance, torch.cat([change[0].diag_embed(), change[1].diag_embed()], dim=-1)], dim=-2)

    start = torch.cat([sinkage.log(), _clamped(slip)], dim=-1)
    unknown, solved = _newton(residual, jacobian, start, _depth_limits(step, (MIN_SLIP, MAX_SLIP), axles))
    depth, slips = unknown[:, :axles].exp(), unknown[:, axles:].clone()
    left = (~solved).nonzero().squeeze(-1)
    if left.numel() > 0:
        depth[left], slips[left], solved[left] = _search_torques(step.rows(left), torque[left])
    forces = step.wheel.forces(slips, depth)
    along = torch.einsum("...af,...af->...", step.matrix[:, 0], forces)
    acceleration = (along - step.rover.weight * torch.sin(step.pose.pitch)) / step.rover.mass
    return Contacts(slips, depth, forces, step.velocity + step.duration * acceleration, solved)


def _clamped(slip: Tensor) -> Tensor:
    """Slip inside the range of the contact model; beyond it the forces stay those of the range's end."""
    return slip.clamp(MIN_SLIP, MAX_SLIP)


def _depth_limits(step: Step, others: tuple[float, float], count: int) -> tuple[Tensor, Tensor]:
    """Lowest and highest value of log(sinkage) of every axle, followed by ``count`` other unknowns."""
    radius, axles = step.rover.wheel_radius, step.rover.axles
    low = [math.log(SHALLOWEST * radius)] * axles + [others[0]] * count
    high = [math.log(DEEPEST * radius)] * axles + [others[1]] * count
    return torch.tensor(low, dtype=torch.float64), torch.tensor(high, dtype=torch.float64)


def _newton(residual: Function, jacobian: Function, start: Tensor, limits: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
    """Batched Newton with Broyden's update of the Jacobian; episodes drop out as they converge.

    Returns the unknowns [batch, m] and where they are solved [batch].
    """
    answer, solved = start.clamp(*limits), torch.zeros(start.shape[0], dtype=torch.bool)
    index = torch.arange(start.shape[0])
    u = answer
    value, slope = residual(u, index), jacobian(u, index)
    for iteration in range(1, MAX_ITERATIONS + 1):
        done = value.abs().amax(-1) < TOLERANCE
        if bool(done.any()):
            answer[index[done]], solved[index[done]] = u[done], True
            index, u, value, slope = index[~done], u[~done], value[~done], slope[~done]
        if index.numel() == 0:
            break
        move, broken = torch.linalg.solve_ex(slope, -value.unsqueeze(-1))
        move = torch.where((broken != 0)[:, None] | ~move.squeeze(-1).isfinite(), 0.0, move.squeeze(-1)).clamp(-0.5, 0.5)
        moved = (u + move).clamp(*limits)
        move = moved - u
        after = residual(moved, index)
        if iteration % REFRESH == 0:
            slope = jacobian(moved, index)
        else:
            missed = after - value - torch.einsum("...ij,...j->...i", slope, move)
            slope = slope + missed.unsqueeze(-1) * (move / (move**2).sum(-1, keepdim=True).clamp(min=1e-30)).unsqueeze(-2)
        u, value = moved, after
    answer[index] = u
    return answer, solved


def _search_rates(step: Step, rate: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What _newton could not solve: bisection for the end velocity, with the quasi-static sinkages of each trial.

    The net force falls with velocity, the inertial force rises, so there is one root.
    """
    top = step.rover.wheel_radius * rate.amax(-1)
    low, high = torch.minimum(step.velocity, torch.zeros_like(top)) - top, torch.maximum(step.velocity, 2.0 * top)
    for _ in range(60):
        end = (low + high) / 2.0
        slip = _clamped(slip_at(step.rover, end, rate))
        depth = _carried(step, slip, steps=8)
        pushes = step.imbalance(step.wheel.forces(slip, depth), end)[:, 0] > 0.0
        low, high = torch.where(pushes, end, low), torch.where(pushes, high, end)
    end = (low + high) / 2.0
    slip = _clamped(slip_at(step.rover, end, rate))
    depth = _carried(step, slip, steps=40)
    miss = step.imbalance(step.wheel.forces(slip, depth), end).abs().amax(-1)
    return depth, end, miss < 1e-6


def _search_torques(step: Step, torque: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """What _newton could not solve, wheel by wheel: loads from the statics, slip from the torque, until they agree."""
    traction = torch.zeros_like(torque)
    for _ in range(20):
        load = wheel_loads(step.rover, step.pose, traction, torque)
        slip, depth = slip_under_torque(step.wheel, torque, load)
        forces = step.wheel.forces(slip, depth)
        traction = (traction + forces[..., 1]) / 2.0
    balanced = step.imbalance(forces, step.velocity)[:, 1:].abs().amax(-1) < 1e-4
    driven = ((forces[..., 2] - torque).abs() < 1e-4 * step.rover.weight * step.rover.wheel_radius).all(-1)
    return depth, slip, balanced & driven


def _carried(step: Step, slip: Tensor, steps: int) -> Tensor:
    """Sinkages at which the wheels carry their loads at given slip: loads and tractions in turn."""
    traction, torque = torch.zeros_like(slip), torch.zeros_like(slip)
    depth = slip
    for _ in range(steps):
        depth = equilibrium_sinkage(step.wheel, slip, wheel_loads(step.rover, step.pose, traction, torque))
        forces = step.wheel.forces(slip, depth)
        traction, torque = forces[..., 1], forces[..., 2]
    return depth
