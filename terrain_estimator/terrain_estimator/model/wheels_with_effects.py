# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Physics of single wheels with named effects as further parameters, as ``physics_with_effects``.

The rows are evaluated anew at the posterior's values in every block; their change with each value
is a difference of whole rows.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.model.body_motion import body_motion, safe_motion
from terrain_estimator.model.effect_values import NEAR, ValuePrior, with_changes
from terrain_estimator.model.effects_by_wheel import EffectsByWheel
from terrain_estimator.model.packing import PackedView, view_of
from terrain_estimator.model.physics import SoilRows
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.rows import ContactModel, Rows, values_alone
from terrain_estimator.model.rows_beside import of_slopes
from terramechanics.contact.rolling import WheelMotion
from terramechanics.vehicle.wheel_balances import motion_across


class WheelsWithEffects(nn.Module):
    """Physics of single wheels whose rows have named effects in them.

    It has the methods of :class:`~terrain_estimator.model.physics.Physics` that the model calls.
    """

    def __init__(
        self, by_wheel: PhysicsByWheel, effects: EffectsByWheel, values: ValuePrior
    ) -> None:
        """Take the physics, whose forces are the ``effects``, and the prior of their values."""
        super().__init__()
        self.by_wheel, self.nominal = by_wheel, by_wheel.nominal
        self.effects, self.values = effects, values
        self.axles, self.gravity = by_wheel.axles, by_wheel.gravity
        self.known_soils, self.uncertain_constants = (
            by_wheel.known_soils,
            by_wheel.uncertain_constants,
        )
        self.effect_values = values.mean.shape[0]
        self.near = NEAR

    def constants_of(self, chosen: Tensor, deviations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the constants of the ``chosen`` soil, as the nominal physics does."""
        return self.by_wheel.constants_of(chosen, deviations)

    def usable(self, view: PackedView, leading: Tensor) -> Tensor:
        """Return the usable wheels, as without effects; each sinkage has to be known."""
        return self.by_wheel.usable(view, leading) & torch.isfinite(view.sinkage)

    def balanced(
        self, view: PackedView, constants: Tensor, varied: Tensor, strength: Tensor
    ) -> PackedView:
        """Return the observation as it is: these forces are not solved for a missing sinkage."""
        del constants, varied, strength
        return view

    def effect_sizes(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return mean and variance of the size of each of J effects in SI units [J, 2].

        ``mean`` and ``variance`` [V] are those of the values, in prior deviations.
        """
        value = self.values.mean + self.values.sd * mean
        return self.effects.rows.size_moments(value, self.values.sd**2 * variance)

    def rows(
        self,
        packed: Tensor,
        likely: Tensor,
        contact: ContactModel,
        values: Tensor,
        doubt: Tensor,
    ) -> Rows:
        """Return the rows of a block [n, P] that has no effects on sensors and drives any more."""
        frame = self.by_wheel.frame(packed, contact)
        rows = self.by_wheel.rows(frame, likely, contact, doubt, values)
        motion = safe_motion(body_motion(frame.measured), frame.usable)
        return of_slopes(self.by_wheel.body(), rows, frame, motion, self.nominal.moment_variance)

    def average(
        self, packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the rows of a block [n, P] on a soil; arguments as of the nominal physics.

        ``expansion`` [2 + M + V] holds the deviations of the effects' values, too.
        """
        first = self.uncertain_constants
        deviations = self.values.within(expansion[2:], first)
        contact = self.nominal.contact(soil, deviations)
        alone, values = values_alone(contact), self.values.from_deviations(deviations, first)
        theta = torch.cat([expansion[:2], torch.ones_like(expansion[:1])])
        plain = self.effects.corrected(packed, values)
        frame = self.by_wheel.frame(plain, alone)
        none = torch.zeros_like(frame.usable)
        agreed = self.by_wheel.agreed(frame, plain, alone, theta, chosen, none, values)
        moved = agreed.inputs - plain
        rows = self.rows(plain, agreed.inputs, contact, values, agreed.doubt)
        every = self.values.varied(values)
        for k in range(every.shape[0]):
            own = every[k : k + 1]
            read = self.effects.corrected(packed, own)
            varied = self.rows(read, read + moved, alone, own, agreed.doubt)
            rows = with_changes(rows, varied)
        return self.by_wheel.averaged(rows, frame, learnt, deviations, chosen)

    def has_moved(self, packed: Tensor, before: Tensor, after: Tensor) -> Tensor:
        """Return whether an effect or a soil constant moved so far that other rows are needed.

        That is a bool []; ``before`` and ``after`` are as ``expansion`` in :meth:`average`.
        """
        del packed
        first = self.uncertain_constants
        here, there = self.values.within(before[2:], first), self.values.within(after[2:], first)
        moved = (there[first:] - here[first:]).abs().amax() >= self.near
        return moved | self.by_wheel.nominal.constants_moved(before, after)

    def drive_row(
        self, view: PackedView, constants: Tensor, varied: Tensor, deviations: Tensor
    ) -> Tensor:
        """Return the velocity row of one observation and its changes by constants and effects.

        A wrong pitch changes the weight along the slope; that is in the row's constant.
        """
        first = self.uncertain_constants
        here = self.values.from_deviations(self.values.within(deviations, first), first)
        sets = constants + varied
        values = torch.cat([here.expand(sets.shape[0], -1), self.values.varied(here)])
        sets = torch.cat([sets, sets[:1].expand(here.shape[1], -1)]).unsqueeze(1)
        packed = view.packed.expand(values.shape[0], -1)
        plain = view_of(self.effects.corrected(packed, values), self.axles)
        motion = body_motion(plain)
        rim, along, across = motion_across(
            plain.slip, motion.rim, motion.steering, self.by_wheel.hub_velocity(motion)
        )
        contact = self.nominal.contact_of(constants, varied)
        forces = self.effects(
            WheelMotion(rim, along, across), motion.rim, plain.sinkage, sets, contact, values
        )
        sine, cosine = torch.sin(plain.contact_angle), torch.cos(plain.contact_angle)
        left, ahead = torch.sin(motion.steering), torch.cos(motion.steering)
        lever = torch.stack([-sine * ahead, cosine * ahead, torch.zeros_like(sine), -left], -1)
        row = (lever.unsqueeze(-1) * forces).sum([1, 2]) * (
            contact.column_unit * contact.body_scale[0]
        )
        weight = self.gravity * (torch.sin(view.pitch) - torch.sin(plain.pitch))
        row = torch.cat([row[:, :2], (row[:, 2] + weight).unsqueeze(1)], 1)
        return torch.cat([row[:1], 1e3 * (row[1:] - row[:1])])
