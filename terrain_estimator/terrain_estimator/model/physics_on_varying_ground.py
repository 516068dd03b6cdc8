# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Physics on ground that is not the same below every axle, see ``varying_ground``."""

import torch
from torch import Tensor, nn

from terrain_estimator.model.packing import PackedView
from terrain_estimator.model.physics import Physics, SoilRows
from terrain_estimator.model.rows import ContactModel, Rows, balances_of, frame_of, values_alone
from terrain_estimator.model.unmeasured import lacks_sinkage, with_balanced_sinkage
from terrain_estimator.model.varying_ground import ground_sources, with_sources
from terramechanics.contact.stresses import wheel_forces
from terramechanics.numerics.batching import any_of


class PhysicsOnVaryingGround(nn.Module):
    """Physics with more noise in its rows.

    It has the methods of :class:`~terrain_estimator.model.physics.Physics` that the model calls.
    """

    def __init__(self, nominal: Physics, sd: float) -> None:
        """Take the physics on even ground, and the ground's relative deviation ``sd`` [1]."""
        super().__init__()
        self.nominal, self.sd = nominal, sd
        self.axles, self.gravity = nominal.axles, nominal.gravity
        self.known_soils, self.uncertain_constants = (
            nominal.known_soils,
            nominal.uncertain_constants,
        )
        self.effect_values = 0

    def constants_of(self, chosen: Tensor, deviations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the constants of the ``chosen`` soil, as the nominal physics does."""
        return self.nominal.constants_of(chosen, deviations)

    def usable(self, view: PackedView, leading: Tensor) -> Tensor:
        """Return the usable wheels, as the nominal physics does."""
        return self.nominal.usable(view, leading)

    def balanced(
        self, view: PackedView, constants: Tensor, varied: Tensor, strength: Tensor
    ) -> PackedView:
        """Return one observation with its sinkages, as the nominal physics does."""
        return self.nominal.balanced(view, constants, varied, strength)

    def drive_row(
        self, view: PackedView, constants: Tensor, varied: Tensor, deviations: Tensor
    ) -> Tensor:
        """Return the velocity row of one observation, as the nominal physics does."""
        return self.nominal.drive_row(view, constants, varied, deviations)

    def average(
        self, packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the rows of a block [n, P] on a soil; arguments as of the nominal physics."""
        deviations = expansion[2:]
        contact = self.nominal.contact(soil, deviations)
        theta = torch.cat([expansion[:2], torch.ones_like(expansion[:1])])
        rows = self.nominal.rows(packed, contact, theta, chosen)
        rows = self.varying(rows, packed, contact, theta)
        return self.nominal.averaged(rows, packed, learnt, deviations, chosen)

    def varying(self, rows: Rows, packed: Tensor, contact: ContactModel, theta: Tensor) -> Rows:
        """Return the ``rows`` of a block [n, P] with 3 A sources of noise behind the others.

        ``theta`` [3] is (c [kPa], tan phi, 1). The forces are those of the measured slips and
        sinkages; where a sinkage is missing, of the one that the balances ask for.
        """
        if any_of(lacks_sinkage(packed, self.axles)):
            packed = with_balanced_sinkage(packed, values_alone(contact), theta)
        frame = frame_of(packed, contact)
        at = frame.measured
        forces = wheel_forces(
            at.slip, at.sinkage, contact.constants, contact.radius, contact.width, contact.nodes
        )
        forces = forces * contact.column_unit
        moved = ground_sources(frame.levers.select(2, 0), forces, theta, self.sd)
        if rows.taken.shape[2] > 0:
            moved = moved - rows.taken @ balances_of(moved, 1, self.axles)
        return with_sources(rows, moved)

    def has_moved(self, packed: Tensor, before: Tensor, after: Tensor) -> Tensor:
        """Return whether other rows are needed, as the nominal physics does."""
        return self.nominal.has_moved(packed, before, after)

    def effect_sizes(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return the moments [J, 2] of the sizes of J = 0 named effects."""
        return self.nominal.effect_sizes(mean, variance)
