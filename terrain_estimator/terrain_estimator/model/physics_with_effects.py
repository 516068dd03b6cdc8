# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Physics with named effects as further parameters beside c and tan phi.

Each value of an effect, its size and the others, is a parameter in prior deviations, like a soil
constant. The rows are evaluated anew at the posterior's values in every block; their change with
each value is a difference of whole rows.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.effect_rows import EffectRows, Observed
from terrain_estimator.model.effect_values import NEAR, ValuePrior, with_changes
from terrain_estimator.model.packing import PackedView, view_of
from terrain_estimator.model.physics import Physics, SoilRows
from terrain_estimator.model.physics_by_law import PhysicsByLaw
from terrain_estimator.model.physics_by_wheel import PhysicsByWheel
from terrain_estimator.model.physics_on_varying_ground import PhysicsOnVaryingGround
from terrain_estimator.model.rows import ContactModel, Rows, values_alone
from terrain_estimator.model.wheels_with_effects import WheelsWithEffects
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.suspension import along_body


class PhysicsWithEffects(nn.Module):
    """Physics whose rows have named effects in them; its packed observations hold the wheel rates.

    It has the methods of :class:`~terrain_estimator.model.physics.Physics` that the model calls.
    """

    def __init__(self, nominal: Physics, effect_rows: EffectRows, values: ValuePrior) -> None:
        """Take the physics without effects, the rows with them, and the prior of their values."""
        super().__init__()
        self.nominal, self.effect_rows, self.values = nominal, effect_rows, values
        self.axles, self.gravity = nominal.axles, nominal.gravity
        self.known_soils, self.uncertain_constants = (
            nominal.known_soils,
            nominal.uncertain_constants,
        )
        self.effect_values = values.mean.shape[0]
        self.near = NEAR

    def constants_of(self, chosen: Tensor, deviations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the constants of the ``chosen`` soil, as the nominal physics does."""
        return self.nominal.constants_of(chosen, deviations)

    def usable(self, view: PackedView, leading: Tensor) -> Tensor:
        """Return the usable wheels, as the nominal physics does; each sinkage has to be known."""
        return self.nominal.usable(view, leading) & torch.isfinite(view.sinkage)

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
        spread = self.values.sd**2 * variance
        return self.effect_rows.size_moments(value, spread)

    def within(self, deviations: Tensor) -> Tensor:
        """Return the ``deviations`` [M + V] with sizes inside their ranges."""
        return self.values.within(deviations, self.uncertain_constants)

    def values_at(self, deviations: Tensor) -> Tensor:
        """Return the values [1, V] of ``deviations`` [M + V] of constants and effects."""
        return self.values.from_deviations(deviations, self.uncertain_constants)

    def rows(
        self,
        packed: Tensor,
        contact: ContactModel,
        deviations: Tensor,
        theta: Tensor,
        chosen: Tensor,
    ) -> Rows:
        """Return the rows of observations [n, P], expanded where the ``chosen`` [R] agree best.

        ``theta`` [3] is (c [kPa], tan phi, 1). The changes by the effects' values follow those by
        the constants; ``deviations`` [M + V] are of both.
        """
        values, alone = self.values_at(deviations), values_alone(contact)
        rate = view_of(packed, self.axles).wheel_rate
        strength = theta[:2] * self.nominal.column_unit[:2]
        observed, none = Observed(packed, rate), torch.zeros_like(packed)
        straight = self.effect_rows.rows(observed, none, alone, values, strength)
        plain = self.effect_rows.corrected(observed, values)
        loaded = self.effect_rows.loaded(alone, values)
        agreed = agreement(straight, plain, loaded, theta, chosen)
        correction = agreed.inputs - plain
        rows = self.effect_rows.rows(observed, correction, contact, values, strength, agreed.doubt)
        every, n = self.values.varied(values), packed.shape[0]
        many = every.shape[0]
        varied = self.effect_rows.rows(
            Observed(packed.repeat(many, 1), rate.repeat(many, 1)),
            correction.repeat(many, 1),
            alone,
            every.repeat_interleave(n, 0),
            strength,
            agreed.doubt.repeat(many, 1, 1),
        )
        return with_changes(rows, varied)

    def average(
        self, packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the rows of a block [n, P] on a soil; arguments as of the nominal physics.

        ``expansion`` [2 + M + V] holds the deviations of the effects' values, too.
        """
        deviations = self.within(expansion[2:])
        contact = self.nominal.contact(soil, deviations)
        theta = torch.cat([expansion[:2], torch.ones_like(expansion[:1])])
        rows = self.rows(packed, contact, deviations, theta, chosen)
        return self.nominal.averaged(rows, packed, learnt, deviations, chosen)

    def has_moved(self, packed: Tensor, before: Tensor, after: Tensor) -> Tensor:
        """Return whether an effect or a soil constant moved so far that other rows are needed.

        That is a bool []; ``before`` and ``after`` are as ``expansion`` in :meth:`average`.
        """
        del packed
        first = self.uncertain_constants
        moved = (self.within(after[2:])[first:] - self.within(before[2:])[first:]).abs().amax()
        return (moved >= self.near) | self.nominal.constants_moved(before, after)

    def drive_row(
        self, view: PackedView, constants: Tensor, varied: Tensor, deviations: Tensor
    ) -> Tensor:
        """Return the velocity row of one observation and its changes by constants and effects.

        A wrong pitch changes the weight along the slope; that is in the row's constant.
        """
        here = self.values_at(self.within(deviations))
        sets = constants + varied
        values = torch.cat([here.expand(sets.shape[0], -1), self.values.varied(here)])
        sets = torch.cat([sets, sets[:1].expand(here.shape[1], -1)]).unsqueeze(1)
        packed = view.packed.expand(values.shape[0], -1)
        before = view_of(packed, self.axles)
        observed = Observed(packed, before.wheel_rate)
        plain = view_of(self.effect_rows.corrected(observed, values), self.axles)
        contact = self.nominal.contact_of(constants, varied)
        # No law of a model reads c and tan phi.
        ruts = self.effect_rows.ruts(plain.slip, plain.sinkage, None, contact)
        inputs = ContactInputs(
            plain.slip, plain.sinkage, sets, torch.zeros_like(sets[..., :2]), None, None, ruts
        )
        forces = self.effect_rows.forces(inputs, before.wheel_rate, contact, values)
        forces = forces * self.nominal.column_unit
        along = along_body(plain.contact_angle).unsqueeze(-1)
        scale = self.effect_rows.loaded(contact, values).body_scale[..., :1]
        row = (along * forces).sum([1, 2]) * scale
        weight = self.gravity * (torch.sin(before.pitch) - torch.sin(plain.pitch))
        row = torch.cat([row[:, :2], (row[:, 2] + weight).unsqueeze(1)], 1)
        return torch.cat([row[:1], 1e3 * (row[1:] - row[0])])


AnyPhysics = (
    Physics
    | PhysicsByLaw
    | PhysicsByWheel
    | PhysicsOnVaryingGround
    | PhysicsWithEffects
    | WheelsWithEffects
)
"""What a model may have as its physics."""


def nominal_of(physics: AnyPhysics) -> Physics:
    """Return the physics of rover and soils, without what another physics adds."""
    return physics if isinstance(physics, Physics) else physics.nominal
