# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one run by wheel under a hypothesis, by those that exported models have.

They are ``model/physics_by_wheel``'s. What an effect does is what the simulator of rovers that turn
does (``terramechanics.simulation.body_plant``): each side of the rover is to an effect on sensors
and drives what a planar rover is, and an effect in the contact sees the slip along the heading.

All seconds of a run are evaluated at once. So the banks of the ground, which are sources of noise,
have the deviation that the contact angles of the whole run give, not those of each second.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn

from terrain_estimator.discovery.hypotheses.rows import (
    Expansion,
    HypothesisRows,
    LinearizationPoint,
    Nominal,
    observed_of,
)
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.body_motion import block_slopes, body_motion, safe_motion
from terrain_estimator.model.effect_rows import readings_of, with_readings
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.model.rows import ContactModel, Frame, Rows, values_alone
from terrain_estimator.model.rows_beside import pulled_beside, velocity_beside, weighted_by
from terramechanics.contact.rolling import WheelMotion, rolling_forces
from terramechanics.effects.law import Law, Readings, with_torque
from terramechanics.effects.sensing import OdometryScale
from terramechanics.simulation.body_plant import effect_inputs
from terramechanics.vehicle.suspension import shifted_centre
from terramechanics.vehicle.wheel_places import WIDEST_SLIP


class ForcesWithEffects(nn.Module):
    """The forces of wheels that roll, with effects in the contact."""

    def __init__(self, laws: Sequence[Law], values: Sequence[Tensor], strength: Tensor) -> None:
        """``values`` [1, V] are those of each law, ``strength`` [2] is c [Pa] and tan phi."""
        super().__init__()
        self._laws = cast("list[Law]", nn.ModuleList(laws))
        self._values, self._strength = values, strength

    def forward(
        self,
        motion: WheelMotion,
        rim: Tensor,
        sinkage: Tensor,
        constants: Tensor,
        contact: ContactModel,
    ) -> Tensor:
        """Return what :class:`RollingForces` does, [..., n, W, 4, 3]."""
        inputs, way = effect_inputs(motion, sinkage, constants, self._strength), motion.rim
        each = list(zip(self._laws, self._values, strict=True))
        for law, own in each:
            inputs = law.contact(inputs, own, rim / contact.radius)
        forces = rolling_forces(
            motion, inputs.sinkage, inputs.constants, contact.radius, contact.width, contact.nodes,
            inputs.exit_angle,
        )  # fmt: skip
        for law, own in each:
            added = law.added_force(inputs, own)
            if added is not None:
                none = torch.zeros_like(forces[..., 0, 0])
                side = none if added.lateral is None else added.lateral + none
                parts = [none, added.traction * way + none, added.torque * way + none, side]
                known = torch.zeros_like(forces[..., :2])
                forces = forces + torch.cat([known, torch.stack(parts, -1).unsqueeze(-1)], -1)
        return forces


@dataclass(frozen=True, slots=True)
class WheelChanges:
    """The change of n observations' rows for one prior deviation of each of M soil constants."""

    values: Tensor  # [M, n, R] at c and tan phi
    noise: Tensor  # [M, n, R, E]

    def at(self, error: Tensor) -> Tensor:
        """Return the changes [M, n, R] at inputs with the ``error`` [n, E] of each source."""
        return self.values + (self.noise @ error.unsqueeze(-1)).squeeze(-1)


class WheelRows:
    """The rows of one run by wheel under one hypothesis, at any point.

    It has the methods of :class:`HypothesisRows` that the equations call.
    """

    def __init__(self, nominal: Nominal, blocks: Blocks, laws: Sequence[Law]) -> None:
        """Prepare what does not depend on the point; ``laws`` are those of the hypothesis."""
        self._nominal, self._observed = nominal.of(blocks), observed_of(blocks)
        self._laws, self._counts = [of_wheels(law) for law in laws], [law.count for law in laws]
        self._wheels, self._blocks = nominal.stations, blocks.packed.shape[0]
        steps = view_of(blocks.packed, self._wheels).step
        self._slopes = [torch.cat(parts) for parts in zip(*map(block_slopes, steps), strict=True)]

    def expansion(self, point: LinearizationPoint, chosen: Tensor) -> Expansion:
        """Return the inputs at which the ``chosen`` rows [R] agree best."""
        packed, physics = self._corrected(point), self._physics(point)
        contact = values_alone(self._contact(point, physics))
        frame, none = self._frame(physics, packed, contact), torch.zeros(1, 1, dtype=torch.bool)
        missing = none.expand(packed.shape[0], self._wheels)
        agreed = physics.agreed(frame, packed, contact, _theta(point), chosen, missing)
        return Expansion(agreed.inputs - packed, agreed.doubt)

    def rows(self, point: LinearizationPoint, around: Expansion) -> Rows:
        """Return the expanded rows."""
        return self._evaluated(point, around, alone=True)

    def corrected(self, point: LinearizationPoint, around: Expansion, error: Tensor) -> Tensor:
        """Return rows less targets [n, R] at inputs with the ``error`` [n, E] of each source."""
        rows, theta = self.rows(point, around), _theta(point)
        moved = ((rows.noise[0] @ theta) @ error.unsqueeze(-1)).squeeze(-1)
        return rows.features[0] @ theta + moved - rows.target

    def rows_and_changes(
        self, point: LinearizationPoint, around: Expansion
    ) -> tuple[Rows, WheelChanges]:
        """Return the expanded rows and their changes by the soil constants."""
        rows, theta = self._evaluated(point, around, alone=False), _theta(point)
        return rows, WheelChanges(rows.features[1:] @ theta, rows.noise[1:] @ theta)

    def _evaluated(self, point: LinearizationPoint, around: Expansion, *, alone: bool) -> Rows:
        packed, physics = self._corrected(point), self._physics(point)
        contact = self._contact(point, physics)
        contact = values_alone(contact) if alone else contact
        frame = self._frame(physics, packed, contact)
        rows = physics.rows(frame, packed + around.input_correction, contact, around.doubt)
        motion = safe_motion(body_motion(frame.measured), frame.usable)
        variance = physics.nominal.moment_variance
        return weighted_by(physics.body(), rows, frame, motion, variance, *self._slopes)

    def _corrected(self, point: LinearizationPoint) -> Tensor:
        """Return the packed observations [n, P] without the effects on sensors and drives."""
        sides = self._nominal.rover.wheels_per_axle
        readings = folded(readings_of(self._observed), sides)
        for law, own in zip(self._laws, self._values(point), strict=True):
            readings = law.corrected(readings, own)
            loss = law.drive_loss(readings.wheel_rate, own)
            readings = with_torque(readings, readings.torque - loss)
        return with_readings(self._observed.packed, unfolded(readings, sides))

    def _physics(self, point: LinearizationPoint) -> PhysicsByWheel:
        """Return the physics with the effects in the contact and on the body."""
        nominal, values = self._nominal, self._values(point)
        strength = point.theta * nominal.contact.column_unit[:2]
        forces = ForcesWithEffects(self._laws, values, strength)
        assert nominal.places is not None
        known = nominal.contact.constants.unsqueeze(0)
        physics = physics_by_wheel(
            nominal.rover, nominal.places, known, nominal.prior.constants_sd, forces
        )
        for law, own in zip(self._laws, values, strict=True):
            added = law.added_mass(own)
            if added is not None:
                _load(physics, nominal.rover.mass, added.mass, added.moment)
        return physics

    def _contact(self, point: LinearizationPoint, physics: PhysicsByWheel) -> ContactModel:
        return physics.nominal.contact(0, point.kappa)

    def _frame(self, physics: PhysicsByWheel, packed: Tensor, contact: ContactModel) -> Frame:
        """Return the frame of all blocks, whose last two rows have the slopes of their block."""
        frame, (slope, _) = physics.frame(packed, contact), self._slopes
        motion, body = safe_motion(body_motion(frame.measured), frame.usable), physics.body()

        def of_blocks(values: Tensor) -> Tensor:
            mean = values.view(self._blocks, -1).mean(1, keepdim=True)
            return mean.expand(-1, packed.shape[0] // self._blocks).flatten()

        lateral = of_blocks(slope * velocity_beside(body, motion))
        lateral = lateral + pulled_beside(body, frame.measured, motion)
        turning = of_blocks(slope * motion.yaw_rate) * body.yaw_inertia
        there = frame.used[:, 0].view(self._blocks, -1).amin(1, keepdim=True)
        there = there.expand(-1, packed.shape[0] // self._blocks).reshape(-1, 1).expand(-1, 2)
        beside = torch.stack([lateral, turning], 1)
        return frame._replace(
            target=torch.cat([frame.target[:, :-2], beside], 1),
            used=torch.cat([frame.used[:, :-2], there], 1),
        )

    def _values(self, point: LinearizationPoint) -> list[Tensor]:
        values = torch.tensor([list(point.values)], dtype=torch.float64)
        return list(values.split_with_sizes(self._counts, 1)) if self._counts else []


def rows_of(nominal: Nominal, blocks: Blocks, laws: Sequence[Law]) -> HypothesisRows | WheelRows:
    """Return the rows of a run under a hypothesis of these ``laws``, by axle or by wheel."""
    kind = HypothesisRows if nominal.places is None else WheelRows
    return kind(nominal, blocks, laws)


def of_wheels(law: Law) -> Law:
    """Return a law for single wheels, whose slips reach further than those of a planar rover."""
    if isinstance(law, OdometryScale):
        law.lowest, law.highest = -WIDEST_SLIP, WIDEST_SLIP
    return law


def folded(readings: Readings, sides: int) -> Readings:
    """Return the readings of n rovers with wheels on ``sides`` as those of n sides planar rovers.

    Wheels are in ``wheel_order``, so that those of an axle follow each other.
    """

    def by_side(values: Tensor | None) -> Tensor | None:
        if values is None:
            return None
        if values.shape[1] == 1:
            return values.repeat_interleave(sides, 0)
        return values.unflatten(1, (-1, sides)).transpose(1, 2).flatten(0, 1)  # type: ignore[no-untyped-call]

    return Readings(*(by_side(each) for each in readings))  # type: ignore[arg-type]


def unfolded(readings: Readings, sides: int) -> Readings:
    """Return readings as they were before :func:`folded`."""

    def by_wheel(values: Tensor | None) -> Tensor | None:
        if values is None:
            return None
        if values.shape[1] == 1:
            return values[::sides]
        return values.unflatten(0, (-1, sides)).transpose(1, 2).flatten(1, 2)  # type: ignore[no-untyped-call]

    return Readings(*(by_wheel(each) for each in readings))  # type: ignore[arg-type]


def _load(physics: PhysicsByWheel, mass: float, added: Tensor, moment: Tensor) -> None:
    """Add a mass [1, 1] [kg] with its moment [1, 2] [kg m] to a rover of ``mass`` [kg]."""
    total, nominal = (mass + added).clamp(min=0.1 * mass), physics.nominal
    share = mass / total.squeeze()
    nominal.centre = shifted_centre(nominal.centre, moment.squeeze(0), total.squeeze())
    nominal.body_scale = nominal.body_scale * share
    physics.yaw_inertia = physics.yaw_inertia * share


def _theta(point: LinearizationPoint) -> Tensor:
    """Return (c [kPa], tan phi, 1), [3]."""
    return torch.cat([point.theta, torch.ones_like(point.theta[:1])])
