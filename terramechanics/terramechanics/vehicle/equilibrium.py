# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One implicit time step: the slip and sinkage of every wheel that balance the rover.

Unknown are the sinkages of the axles and, with commanded wheel rates, the velocity at the end of
the step; with commanded torques the slips. Equations are the balances of suspension.py. Traction
changes by its whole range within a few mm/s of velocity, so the step is implicit: forces hold over
the step and belong to its end velocity.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.contact.sinkage import (
    DEEPEST,
    SHALLOWEST,
    WheelGround,
    equilibrium_sinkage,
    slip_under_torque,
)
from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP
from terramechanics.numerics.roots import Rows, bracketed_root, quasi_newton
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import (
    BodyLoad,
    Pose,
    balance_matrix,
    balance_target,
    wheel_loads,
)

Search = Callable[[Tensor], Tensor]
"""Unknowns [rows, m] of the episodes with the given indices [rows]."""
NEARLY = 1e-6
"""[1] Share of weight times radius by which a commanded torque may be missed."""
SEARCHES = 20
"""Velocities that a search tries."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """Contacts of the wheels in one step [batch, axles], and where they are ``solved`` [batch]."""

    slip: Tensor
    sinkage: Tensor
    forces: Tensor  # [batch, axles, 3] N, T [N], M [N m] of one wheel
    velocity: Tensor  # [batch] at the end of the step [m/s]
    solved: Tensor
    # [batch, axles] the commanded slip is in the range of the model
    obeyed: Tensor


@dataclass(frozen=True, slots=True)
class StepEquations:
    """The equations of one time step, without the command."""

    rover: Rover
    pose: Pose
    wheel: WheelGround
    coarse: WheelGround  # the same with few quadrature points: good enough for a Jacobian
    body: BodyLoad
    matrix: Tensor  # [batch, B, axles, 3] balance_matrix, B = 3 + joints balances
    velocity: Tensor  # [batch] at the start of the step [m/s]
    duration: float  # [s]

    @classmethod
    def of(
        cls,
        rover: Rover,
        pose: Pose,
        wheel: WheelGround,
        coarse: WheelGround,
        velocity: Tensor,
        duration: float,
        body: BodyLoad | None = None,
    ) -> "StepEquations":
        """Set up the step from ``velocity`` over ``duration`` in ``pose``.

        ``body`` is by default that of the rover.
        """
        body = body or BodyLoad.of(rover)
        return cls(
            rover, pose, wheel, coarse, body, balance_matrix(rover, pose, body), velocity, duration
        )

    def rows(self, index: Tensor) -> "StepEquations":
        """Return the equations of some of the episodes."""
        pose = Pose(*(getattr(self.pose, name)[index] for name in Pose.__slots__))
        wheel, coarse = self.wheel.rows(index), self.coarse.rows(index)
        return StepEquations(
            self.rover,
            pose,
            wheel,
            coarse,
            self.body.rows(index),
            self.matrix[index],
            self.velocity[index],
            self.duration,
        )

    def imbalance(self, forces: Tensor, velocity: Tensor) -> Tensor:
        """Return the imbalances [batch, B] in units of the weight and of weight times wheelbase."""
        acceleration = (velocity - self.velocity) / self.duration
        target = balance_target(self.body, self.pose.pitch, acceleration, self.joints)
        balance = torch.einsum("...raf,...af->...r", self.matrix, forces)
        return (balance - target) / self.scale

    @property
    def joints(self) -> int:
        """Return the number of joints."""
        return len(self.rover.suspension)

    @property
    def scale(self) -> Tensor:
        """Return the units of the balances, [B]."""
        weight, base = self.rover.weight, self.rover.axle_x[0] - self.rover.axle_x[-1]
        units = [weight] * 2 + [weight * base] * (1 + self.joints)
        return torch.tensor(units, dtype=torch.float64)

    def sensitivities(self, slip: Tensor, sinkage: Tensor) -> tuple[Tensor, Tensor]:
        """Return the derivatives by log(sinkage) and slip of every axle, [batch, B, axles] each."""
        small = 1e-6
        slips = torch.stack([slip, slip, slip + small])
        sinkages = torch.stack([sinkage, sinkage * (1.0 + small), sinkage])
        forces = self.coarse.forces(slips, sinkages)
        matrix = self.matrix / self.scale[:, None, None]
        by_depth = torch.einsum("...raf,...af->...ra", matrix, (forces[1] - forces[0]) / small)
        by_slip = torch.einsum("...raf,...af->...ra", matrix, (forces[2] - forces[0]) / small)
        return by_depth, by_slip


def slip_at(rover: Rover, velocity: Tensor, rate: Tensor) -> Tensor:
    """Return slip 1 - v / (r w) at ``rate`` w [batch, axles] [rad/s], ``velocity`` v [batch]."""
    return rover.slip(velocity.unsqueeze(-1), rate)


def solve_rates(step: StepEquations, rate: Tensor, sinkage: Tensor, velocity: Tensor) -> Contacts:
    """Solve the contacts for commanded wheel rates [batch, axles] [rad/s], all positive.

    ``sinkage`` and ``velocity`` are the start.
    """
    speed = step.rover.wheel_radius * rate
    unit = speed.mean(-1)
    unknown = torch.cat([sinkage.log(), (velocity / unit).unsqueeze(-1)], dim=-1)
    forces = sinkage.new_empty(*sinkage.shape, 3)

    def contacts(u: Tensor, index: Tensor) -> tuple[StepEquations, Tensor, Tensor, Tensor]:
        end = u[:, -1] * unit[index]
        return step.rows(index), slip_at(step.rover, end, rate[index]), u[:, :-1].exp(), end

    def residual(u: Tensor, index: Tensor) -> Tensor:
        part, slip, depth, end = contacts(u, index)
        forces[index] = part.wheel.forces(_clamped(slip), depth)
        return part.imbalance(forces[index], end)

    def jacobian(u: Tensor, index: Tensor) -> Tensor:
        part, slip, depth, _ = contacts(u, index)
        by_depth, by_slip = part.sensitivities(_clamped(slip), depth)
        inertia = part.body.mass / step.duration / step.scale[0] * unit[index]
        moving = torch.where(slip == _clamped(slip), -unit[index].unsqueeze(-1) / speed[index], 0.0)
        by_velocity = (by_slip * moving.unsqueeze(-2)).sum(-1)
        along = torch.eye(1, by_velocity.shape[-1], dtype=torch.float64)
        by_velocity = by_velocity - inertia.unsqueeze(-1) * along
        return torch.cat([by_depth, by_velocity.unsqueeze(-1)], dim=-1)

    def search(index: Tensor) -> Tensor:
        depth, end = _search_rates(step.rows(index), rate[index], sinkage[index])
        return torch.cat([depth.log(), (end / unit[index]).unsqueeze(-1)], dim=-1)

    unknown, solved = _solve(
        residual, jacobian, unknown, _depth_limits(step, (-3.0, 3.0), 1), search
    )
    depth, end = unknown[:, :-1].exp(), unknown[:, -1] * unit
    wanted = slip_at(step.rover, end, rate)
    slip = _clamped(wanted)
    lost = (~solved).nonzero().squeeze(-1)
    if lost.numel() > 0:
        forces[lost] = step.wheel.rows(lost).forces(slip[lost], depth[lost])
    return Contacts(slip, depth, forces, end, solved, slip == wanted)


def solve_torques(step: StepEquations, torque: Tensor, sinkage: Tensor, slip: Tensor) -> Contacts:
    """Solve the contacts for commanded torques of one wheel [batch, axles] [N m].

    ``sinkage`` and ``slip`` are the start.
    """
    unit = step.rover.weight * step.rover.wheel_radius / len(step.rover.wheels)
    axles = step.rover.axles

    def saturated(slips: Tensor, missing: Tensor) -> Tensor:
        """Return the wheels at the end of the range of slip that do not reach their torque."""
        return ((slips >= MAX_SLIP) & (missing < 0.0)) | ((slips <= MIN_SLIP) & (missing > 0.0))

    def residual(u: Tensor, index: Tensor) -> Tensor:
        part, slips = step.rows(index), u[:, axles:]
        forces = part.wheel.forces(slips, u[:, :axles].exp())
        missing = (forces[..., 2] - torque[index]) / unit
        missing = torch.where(saturated(slips, missing), 0.0, missing)
        return torch.cat([part.imbalance(forces, part.velocity)[:, 1:], missing], dim=-1)

    def jacobian(u: Tensor, index: Tensor) -> Tensor:
        part, slips, depth = step.rows(index), u[:, axles:], u[:, :axles].exp()
        by_depth, by_slip = part.sensitivities(slips, depth)
        small = 1e-6
        moved = torch.stack(
            [
                part.coarse.forces(slips, depth * (1.0 + small)),
                part.coarse.forces(slips + small, depth),
            ]
        )
        change = (moved - part.coarse.forces(slips, depth))[..., 2] / small / unit
        balance = torch.cat([by_depth, by_slip], dim=-1)[:, 1:]
        return torch.cat(
            [balance, torch.cat([change[0].diag_embed(), change[1].diag_embed()], dim=-1)], dim=-2
        )

    def search(index: Tensor) -> Tensor:
        depth, slips = _search_torques(step.rows(index), torque[index], sinkage[index])
        return torch.cat([depth.log(), slips], dim=-1)

    start = torch.cat([sinkage.log(), _clamped(slip)], dim=-1)
    unknown, solved = _solve(
        residual, jacobian, start, _depth_limits(step, (MIN_SLIP, MAX_SLIP), axles), search
    )
    depth, slips = unknown[:, :axles].exp(), unknown[:, axles:]
    forces = step.wheel.forces(slips, depth)
    along = torch.einsum("...af,...af->...", step.matrix[:, 0], forces)
    still = torch.zeros_like(step.velocity)
    at_rest = balance_target(step.body, step.pose.pitch, still, step.joints)[..., 0]
    acceleration = (along - at_rest) / step.body.mass
    obeyed = (forces[..., 2] - torque).abs() < NEARLY * unit
    return Contacts(
        slips, depth, forces, step.velocity + step.duration * acceleration, solved, obeyed
    )


def _clamped(slip: Tensor) -> Tensor:
    """Clamp slip to the range of the contact model, beyond which the forces stay constant."""
    return slip.clamp(MIN_SLIP, MAX_SLIP)


def _depth_limits(
    step: StepEquations, others: tuple[float, float], count: int
) -> tuple[Tensor, Tensor]:
    """Return the limits of log(sinkage) of every axle, followed by ``count`` other unknowns."""
    radius, axles = step.rover.wheel_radius, step.rover.axles
    low = [math.log(SHALLOWEST * radius)] * axles + [others[0]] * count
    high = [math.log(DEEPEST * radius)] * axles + [others[1]] * count
    return torch.tensor(low, dtype=torch.float64), torch.tensor(high, dtype=torch.float64)


def _solve(
    residual: Rows, jacobian: Rows, start: Tensor, limits: tuple[Tensor, Tensor], search: Search
) -> tuple[Tensor, Tensor]:
    """Solve by quasi_newton, and where it fails once more from a slow ``search``."""
    unknown, solved = quasi_newton(residual, jacobian, start, limits)
    left = (~solved).nonzero().squeeze(-1)
    if left.numel() > 0:
        found = search(left)
        again, solved[left] = quasi_newton(
            lambda u, rows: residual(u, left[rows]),
            lambda u, rows: jacobian(u, left[rows]),
            found,
            limits,
        )
        unknown[left] = torch.where(solved[left].unsqueeze(-1), again, found)
    return unknown, solved


def _search_rates(step: StepEquations, rate: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
    """Search for the end velocity, with the quasi-static sinkages of each trial.

    The net force falls with velocity, the inertial force rises, so there is one root. A wheel that
    would have to be pulled down has no solution.
    """
    top = step.rover.wheel_radius * rate.amax(-1)
    depth = start

    def braking(end: Tensor) -> Tensor:
        nonlocal depth
        depth = carried(step, _clamped(slip_at(step.rover, end, rate)), depth, rounds=3)
        slip = _clamped(slip_at(step.rover, end, rate))
        return -step.imbalance(step.wheel.forces(slip, depth), end)[:, 0]

    low, high = (
        torch.minimum(step.velocity, torch.zeros_like(top)) - top,
        torch.maximum(step.velocity, 2.0 * top),
    )
    end = bracketed_root(braking, low, high, tolerance=1e-9, evaluations=SEARCHES)
    return carried(step, _clamped(slip_at(step.rover, end, rate)), depth, rounds=10), end


def _search_torques(step: StepEquations, torque: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
    """Search for sinkage and slip wheel by wheel: loads from statics, slip from torque, in turn."""
    traction, slip, depth = torch.zeros_like(torque), torch.zeros_like(torque), start
    for _ in range(4):
        load = wheel_loads(step.rover, step.pose, traction, torque, step.body)
        slip, depth = slip_under_torque(step.wheel, torque, load, depth)
        traction = step.wheel.forces(slip, depth)[..., 1]
    return depth, slip


def carried(step: StepEquations, slip: Tensor, start: Tensor, rounds: int) -> Tensor:
    """Return the sinkages [batch, axles] [m] that carry the loads at ``slip``.

    Loads and tractions are computed in turn.
    """
    depth = start
    for _ in range(rounds):
        forces = step.wheel.forces(slip, depth)
        load = wheel_loads(step.rover, step.pose, forces[..., 1], forces[..., 2], step.body)
        before, depth = depth, equilibrium_sinkage(step.wheel, slip, load, depth)
        if bool(((depth - before).abs() < 1e-9 * depth).all()):
            break
    return depth
