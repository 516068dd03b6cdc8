# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one run by wheel under a hypothesis, by those that exported models have.

They are those of ``model/physics_by_wheel`` and ``model/effects_by_wheel``.

All seconds of a run are evaluated at once. So the banks of the ground, which are sources of noise,
have the deviation that the contact angles of the whole run give, not those of each second.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.rows import (
    Expansion,
    LinearizationPoint,
    Nominal,
)
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.body_motion import block_slopes, body_motion, safe_motion
from terrain_estimator.model.effects_by_wheel import EffectsByWheel
from terrain_estimator.model.packing import view_of
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.model.rows import ContactModel, Frame, Rows, values_alone
from terrain_estimator.model.rows_beside import pulled_beside, velocity_beside, weighted_by
from terramechanics.effects.law import Law
from terramechanics.vehicle.suspension import shifted_centre


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
        self._nominal, self._packed = nominal.of(blocks), blocks.packed.flatten(0, 1)
        self._effects = EffectsByWheel(laws, nominal.rover)
        self._wheels, self._blocks = nominal.stations, blocks.packed.shape[0]
        steps = view_of(blocks.packed, self._wheels).step
        self._slopes = [torch.cat(parts) for parts in zip(*map(block_slopes, steps), strict=True)]

    def expansion(self, point: LinearizationPoint, chosen: Tensor) -> Expansion:
        """Return the inputs at which the ``chosen`` rows [R] agree best."""
        packed, physics = self._corrected(point), self._physics(point)
        contact = values_alone(self._contact(point, physics))
        frame, none = self._frame(physics, packed, contact), torch.zeros(1, 1, dtype=torch.bool)
        missing = none.expand(packed.shape[0], self._wheels)
        agreed = physics.agreed(
            frame, packed, contact, _theta(point), chosen, missing, _values(point)
        )
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
        rows = physics.rows(
            frame, packed + around.input_correction, contact, around.doubt, _values(point)
        )
        motion = safe_motion(body_motion(frame.measured), frame.usable)
        variance = physics.nominal.moment_variance
        return weighted_by(physics.body(), rows, frame, motion, variance, *self._slopes)

    def _corrected(self, point: LinearizationPoint) -> Tensor:
        """Return the packed observations [n, P] without the effects on sensors and drives."""
        return self._effects.corrected(self._packed, _values(point))

    def _physics(self, point: LinearizationPoint) -> PhysicsByWheel:
        """Return the physics with the effects in the contact and on the body."""
        nominal, values = self._nominal, _values(point)
        assert nominal.places is not None
        known = nominal.contact.constants.unsqueeze(0)
        physics = physics_by_wheel(
            nominal.rover, nominal.places, known, nominal.prior.constants_sd, self._effects
        )
        own = values.split_with_sizes(self._effects.counts, 1)
        for law, value in zip(self._effects.laws, own, strict=True):
            added = law.added_mass(value)
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


def _values(point: LinearizationPoint) -> Tensor:
    """Return the values of the effects [1, V]."""
    return torch.tensor([list(point.values)], dtype=torch.float64)
