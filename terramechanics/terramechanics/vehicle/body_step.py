# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One implicit time step of a rover with any number of wheels.

Unknown are the depths of all wheels in the ground and the velocity at the end of the step: v_x,
v_y of the centre of mass and the yaw rate. Equations are the balances and the closure of
chassis.py. As in equilibrium.py forces hold over the step and belong to its end velocity::

    m (v - v_0) / dt + m s omega x v = SUM F + m g         I (omega - omega_0) / dt = SUM M_z

v_0 is the velocity at the start, turned into the body's frame at the end, and s = 0. In a steady
state s = 1 instead: the body's frame turns on and v stays.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from terramechanics.contact.rolling import WheelMotion, compiled_rolling_forces
from terramechanics.contact.sinkage import DEEPEST, SHALLOWEST
from terramechanics.numerics.roots import Rows, damped_newton, quasi_newton
from terramechanics.simulation.body_plant import WheelEffects
from terramechanics.vehicle.chassis import FREE, Chassis, Stance

SMALL = 1e-6
"""[1] Step of the differences in a Jacobian, of the logarithm of sinkage and of the speeds."""
SHALLOW = 1e-2
"""[1] Depth in units of the radius above which the unknown is nearly its logarithm."""
FASTEST = 10.0
"""[1] Bound of the velocities that are looked for, in units of the fastest wheel."""


GIVE = 0.01
"""[1] What a support gives more per weight and step of SOFTER, in units of the radius."""
SOFTER = (256.0, 128.0, 64.0, 32.0, 16.0, 8.0, 4.0, 2.8, 2.0, 1.4, 1.0)
"""[1] How much softer equations a search takes, one after the other, until it is there."""
Method = Callable[[Rows, Rows, Tensor, tuple[Tensor, Tensor]], tuple[Tensor, Tensor]]


@dataclass(frozen=True, slots=True)
class BodyContacts:
    """Contacts of the wheels in one step [batch, wheels], and where they are ``solved`` [batch]."""

    motion: WheelMotion
    depth: Tensor  # [m] in the ground, negative where a wheel is lifted
    forces: Tensor  # [batch, wheels, 4] N, T [N], M [N m], Y [N] of each wheel
    velocity: Tensor  # [batch, 3] v_x, v_y [m/s] and yaw rate [rad/s] at the end of the step
    solved: Tensor


@dataclass(frozen=True, slots=True)
class BodyStep:
    """The equations of one time step under commanded rim speeds and steering angles."""

    chassis: Chassis
    constants: Tensor  # [batch, wheels, 6] in the order of CONSTANTS
    strength: Tensor  # [batch, wheels, 2] c [Pa] and tan(phi) [1]
    nodes: Tensor  # quadrature(points)
    coarse: Tensor  # quadrature with few points: good enough for a Jacobian
    gravity: Tensor  # [batch, 3] in the body's frame [m/s^2]
    rim: Tensor  # [batch, wheels] r w [m/s]
    steering: Tensor  # [batch, wheels] [rad], positive to the left
    velocity: Tensor  # [batch, 3] at the start, in the frame of the end
    duration: float  # [s]
    slowest: float  # [m/s] see rolling_forces
    steady: bool  # look for a steady state of the turn
    stance: Stance
    balances: Tensor  # [batch, 6 + J, wheels, 4] balance_matrix, in units of weight and reach
    hubs: Tensor  # [batch, wheels, 2, 3] motion_matrix
    closure: Tensor  # [wheels - 3 - J, wheels] closure, in units of the radius
    effects: WheelEffects | None = None

    @classmethod
    def of(
        cls,
        chassis: Chassis,
        constants: Tensor,
        strength: Tensor,
        nodes: Tensor,
        coarse: Tensor,
        gravity: Tensor,
        rim: Tensor,
        steering: Tensor,
        velocity: Tensor,
        duration: float,
        slowest: float,
        *,
        steady: bool,
        stance: Stance | None = None,
        effects: WheelEffects | None = None,
    ) -> "BodyStep":
        """Set up the step; arguments as the fields have them, the ``stance`` on a plane."""
        stance = stance or chassis.level_stance()
        return cls(
            chassis, constants, strength, nodes, coarse, gravity, rim, steering, velocity,
            duration, slowest, steady, stance,
            chassis.balance_matrix(steering, stance) / _scale(chassis)[:, None, None],
            chassis.motion_matrix(steering, stance),
            chassis.closure() / chassis.wheel_radius,
            effects,
        )  # fmt: skip

    def rows(self, index: Tensor) -> "BodyStep":
        """Return the equations of some of the episodes."""
        return replace(
            self,
            constants=self.constants[index],
            strength=self.strength[index],
            gravity=self.gravity[index],
            rim=self.rim[index],
            steering=self.steering[index],
            velocity=self.velocity[index],
            stance=self.stance.rows(index),
            balances=self.balances[index],
            hubs=self.hubs[index],
            effects=None if self.effects is None else self.effects.rows(index),
        )

    def motion(self, velocity: Tensor) -> WheelMotion:
        """Return the motion of the wheels at a ``velocity`` [batch, 3] of the body."""
        hubs = torch.einsum("...waf,...f->...wa", self.hubs, velocity)
        return WheelMotion(self.rim, hubs[..., 0], hubs[..., 1])

    def rolling(self) -> Tensor:
        """Return the velocity [batch, 3] at which wheels slip least, by least squares."""
        hubs = self.hubs.flatten(-3, -2)
        wanted = torch.stack([self.rim, torch.zeros_like(self.rim)], -1).flatten(-2)
        return (torch.linalg.pinv(hubs) @ wanted.unsqueeze(-1)).squeeze(-1)

    def forces(self, motion: WheelMotion, sinkage: Tensor, nodes: Tensor) -> Tensor:
        """Return N, T, M, Y of wheels [..., wheels, 4]."""
        if self.effects is not None:
            return self.effects.forces(
                motion, sinkage, self.constants, self.strength, nodes, self.slowest
            )
        rows = compiled_rolling_forces()(
            motion, sinkage, self.constants, self.chassis.wheel_radius, self.chassis.wheel_width,
            nodes, None, self.slowest,
        )  # fmt: skip
        strength = self.strength.unsqueeze(-1)
        return torch.matmul(rows[..., :2], strength).squeeze(-1) + rows[..., 2]

    def softer(self, factor: float) -> "BodyStep":
        """Return equations with friction less steep at rest and supports that give more.

        ``factor`` is at least 1, which gives these equations; all forces have fine quadrature.
        """
        give = (factor - 1.0) * GIVE * self.chassis.wheel_radius / self.chassis.weight
        chassis = replace(self.chassis, compliance=self.chassis.compliance + give)
        return replace(self, chassis=chassis, slowest=self.slowest * factor, coarse=self.nodes)

    @property
    def unit(self) -> Tensor:
        """Return the unit of speed of each episode [batch, 1]: its fastest wheel or its body."""
        fastest = torch.maximum(self.rim.abs().amax(-1), self.velocity[:, :2].norm(dim=-1))
        return fastest.clamp(min=self.slowest).unsqueeze(-1)

    @property
    def units(self) -> Tensor:
        """Return the units of v_x, v_y and the yaw rate [batch, 3]."""
        return self.unit * torch.tensor([1.0, 1.0, 1.0 / self.chassis.reach], dtype=torch.float64)

    def depth(self, unknown: Tensor) -> Tensor:
        """Return the depth of the wheels [batch, wheels] [m] for their unknowns.

        Depth is negative below a wheel that is lifted. The unknown is nearly its logarithm.
        """
        return self._shallow * torch.sinh(unknown)

    def unknown_of(self, depth: Tensor) -> Tensor:
        """Return the unknowns of depths, the inverse of :meth:`depth`."""
        return torch.asinh(depth / self._shallow)

    def sinkage(self, depth: Tensor) -> Tensor:
        """Return the sinkages of depths; a lifted wheel has the least."""
        return depth.clamp(min=SHALLOWEST * self.chassis.wheel_radius)

    @property
    def _shallow(self) -> float:
        return SHALLOW * self.chassis.wheel_radius

    def limits(self) -> tuple[Tensor, Tensor]:
        """Return the least and the largest unknowns [wheels + 3].

        A wheel is lifted where the others bear the body.
        """
        radius, wheels = self.chassis.wheel_radius, self.chassis.wheels
        least = SHALLOWEST if self.closure.shape[0] == 0 else -DEEPEST
        ends = torch.tensor([least, DEEPEST], dtype=torch.float64) * radius
        low, high = self.unknown_of(ends).tolist()
        speeds = [FASTEST] * FREE
        return (
            torch.tensor([low] * wheels + [-each for each in speeds], dtype=torch.float64),
            torch.tensor([high] * wheels + speeds, dtype=torch.float64),
        )

    def residual(self, unknown: Tensor) -> Tensor:
        """Return imbalances [batch, wheels + 3] for the unknowns of depths and velocity."""
        wheels = self.chassis.wheels
        depth, velocity = self.depth(unknown[:, :wheels]), unknown[:, wheels:] * self.units
        forces = self.forces(self.motion(velocity), self.sinkage(depth), self.nodes)
        balance = torch.einsum("bhwf,bwf->bh", self.balances, forces) - self._target(velocity)
        gap = self.stance.gap + depth + self.chassis.compliance * forces[..., 0]
        closed = gap @ self.closure.T
        return torch.cat([balance, closed], -1)

    def jacobian(self, unknown: Tensor) -> Tensor:
        """Return the derivatives of :meth:`residual` [batch, wheels + 3, wheels + 3], coarsely."""
        chassis, wheels = self.chassis, self.chassis.wheels
        signed, velocity = self.depth(unknown[:, :wheels]), unknown[:, wheels:] * self.units
        depth = self.sinkage(signed)
        motion, step = self.motion(velocity), SMALL * self.unit
        zero = torch.zeros_like(depth)
        moved = WheelMotion(
            motion.rim,
            motion.along + torch.stack([zero, zero, zero + step, zero]),
            motion.across + torch.stack([zero, zero, zero, zero + step]),
        )
        depths = torch.stack([depth, depth * (1.0 + SMALL), depth, depth])
        forces = self.forces(moved, depths, self.coarse)
        by_unknown = self._shallow * torch.cosh(unknown[:, :wheels])
        share = torch.where(signed == depth, by_unknown / depth, 0.0).unsqueeze(-1)
        by_depth = (forces[1] - forces[0]) / SMALL * share
        by_speed = (forces[2:] - forces[0]) / step.unsqueeze(-1)  # [2, batch, wheels, 4]
        hubs = self.hubs * self.units[:, None, None]
        by_velocity = torch.einsum("abwf,bwam->bwfm", by_speed, hubs)

        balance = torch.cat(
            [
                torch.einsum("bhwf,bwf->bhw", self.balances, by_depth),
                torch.einsum("bhwf,bwfm->bhm", self.balances, by_velocity)
                - self._inertia(velocity),
            ],
            -1,
        )
        give = by_unknown + chassis.compliance * by_depth[..., 0]
        bend = chassis.compliance * by_velocity[..., 0, :]
        closed = torch.cat([self.closure * give.unsqueeze(-2), self.closure @ bend], -1)
        return torch.cat([balance, closed], -2)

    @property
    def _mass(self) -> Tensor:
        mass, inertia = self.chassis.mass, self.chassis.yaw_inertia
        return torch.tensor([mass, mass, inertia], dtype=torch.float64)

    def _target(self, velocity: Tensor) -> Tensor:
        """Return the sums of the balances [batch, 6 + J], in their units."""
        rate = (velocity - self.velocity) / self.duration
        if self.steady:
            turn = velocity[:, 2]
            along, left, _ = velocity.unbind(-1)
            rate = rate + torch.stack([-turn * left, turn * along, torch.zeros_like(turn)], -1)
        weight = self.chassis.mass * self.gravity
        planar = self._mass * rate - torch.nn.functional.pad(weight[:, :2], (0, 1))
        others = (0, FREE - 1 + len(self.chassis.joints))
        sums = torch.cat([planar, torch.nn.functional.pad(-weight[:, 2:], others)], -1)
        return sums / _scale(self.chassis)

    def _inertia(self, velocity: Tensor) -> Tensor:
        """Return the derivatives of the targets by the unknown velocity [batch, 6 + J, 3]."""
        rate = (self._mass / self.duration).diag().expand(velocity.shape[0], 3, 3)
        if self.steady:
            along, left, turn = velocity.unbind(-1)
            zero, mass = torch.zeros_like(turn), self.chassis.mass
            turned = torch.stack([zero, -turn, -left, turn, zero, along, zero, zero, zero], -1)
            rate = rate + mass * turned.view(-1, 3, 3)
        planar = rate * self.units.unsqueeze(-2) / _scale(self.chassis)[:FREE].unsqueeze(-1)
        return torch.nn.functional.pad(planar, (0, 0, 0, FREE + len(self.chassis.joints)))


def _scale(chassis: Chassis) -> Tensor:
    """Return the units of the balances [6 + J]: weight, and weight times reach."""
    weight, moment = chassis.weight, chassis.weight * chassis.reach
    joints = [moment] * len(chassis.joints)
    return torch.tensor(
        [weight, weight, moment, weight, moment, moment, *joints], dtype=torch.float64
    )


def solve_body(step: BodyStep, start: Tensor, velocity: Tensor) -> BodyContacts:
    """Solve the contacts from depths ``start`` [batch, wheels] [m] and ``velocity`` [batch, 3].

    Where there is no solution, ``solved`` is false and the contacts are the last ones tried.
    """
    limits = step.limits()
    depth, end, solved = _solved(step, quasi_newton, start, velocity, limits)
    left = (~solved).nonzero().squeeze(-1)
    if left.numel() > 0:
        depth[left], end[left], solved[left] = _approached(
            step.rows(left), start[left], velocity[left], limits
        )
    motion = step.motion(end)
    sunk = step.sinkage(depth)
    return BodyContacts(motion, depth, step.forces(motion, sunk, step.nodes), end, solved)


def _solved(
    step: BodyStep, method: Method, depth: Tensor, velocity: Tensor, limits: tuple[Tensor, Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """Return depth, velocity and whether they are a solution, by one of the methods of roots."""
    wheels, units = step.chassis.wheels, step.units
    unknown, solved = method(
        lambda u, rows: step.rows(rows).residual(u),
        lambda u, rows: step.rows(rows).jacobian(u),
        torch.cat([step.unknown_of(depth), velocity / units], -1),
        limits,
    )
    return step.depth(unknown[:, :wheels]), unknown[:, wheels:] * units, solved


def _approached(
    step: BodyStep, start: Tensor, velocity: Tensor, limits: tuple[Tensor, Tensor]
) -> tuple[Tensor, Tensor, Tensor]:
    """Solve step by step, as :func:`_solved`: friction goes through zero ever more steeply.

    Where wheels lock, traction changes by its whole range within K slowest / r, and no method finds
    that from afar. A body that two wheels bear nearly alone rocks: supports that give find the
    others. Where it fails from the last velocity, as after a sudden command to back out, it
    starts from wheels that roll, and from rest.
    """
    depth, end = start.clone(), velocity.clone()
    solved = torch.zeros_like(velocity[:, 0], dtype=torch.bool)
    for guess in (velocity, step.rolling(), torch.zeros_like(velocity)):
        left = (~solved).nonzero().squeeze(-1)
        if left.numel() == 0:
            break
        deep, fast, part = start[left], guess[left], step.rows(left)
        for factor in SOFTER:
            softer = part.softer(factor)
            deep, fast, found = _solved(softer, damped_newton, deep, fast, limits)
            solved[left] = found
        depth[left], end[left] = deep, fast
    return depth, end, solved
