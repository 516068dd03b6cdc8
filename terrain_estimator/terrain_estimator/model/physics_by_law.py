# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Physics on soils whose contact law is not that of Wong and Reece.

The law is chosen where the model is built, so that a scripted module holds one law only.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.packing import PackedView
from terrain_estimator.model.physics import Physics, SoilRows
from terrain_estimator.model.rows import (
    ContactModel,
    Frame,
    Rows,
    frame_of,
    measured_forces,
    places,
    read_forces,
    rows_of_forces,
    values_alone,
    varied_inputs,
)
from terramechanics.contact.ruts import REBOUND, ruts_now
from terramechanics.contact.scm import Rut, scm_forces
from terramechanics.contact.stresses import wheel_forces_linear_stress
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.suspension import along_body


class ScmStresses(nn.Module):
    """The contact law scm, in the place of the stress integrals of Wong and Reece.

    A model sees one instant: the ruts are as if the wheels before had always rolled as now.
    """

    def __init__(self) -> None:
        super().__init__()
        self.keeps_ruts, self.rebound = True, REBOUND

    def ruts(self, slip: Tensor, sinkage: Tensor, radius: float) -> Rut:
        """Return the ruts [..., A] below the wheels, the front axle first."""
        return ruts_now(slip, sinkage, radius, torch.full_like(sinkage, self.rebound))

    def forward(self, inputs: ContactInputs, contact: ContactModel) -> Tensor:
        """Return the coefficients of the forces, [..., n, A, 3, 3]."""
        return scm_forces(
            inputs.slip, inputs.sinkage, inputs.constants, contact.radius, contact.width,
            contact.nodes, inputs.exit_angle, inputs.rut,
        )  # fmt: skip


class LinearStresses(nn.Module):
    """The contact law linear_stress, the paper's closed form; every wheel is on fresh ground."""

    def ruts(self, slip: Tensor, sinkage: Tensor, radius: float) -> Rut:
        """Return fresh ground [..., A]."""
        del slip, radius
        return Rut(torch.zeros_like(sinkage), torch.zeros_like(sinkage))

    def forward(self, inputs: ContactInputs, contact: ContactModel) -> Tensor:
        """Return the coefficients of the forces, [..., n, A, 3, 3]."""
        return wheel_forces_linear_stress(
            inputs.slip, inputs.sinkage, inputs.constants, contact.radius, contact.width
        )


class PhysicsByLaw(nn.Module):
    """Physics whose forces are those of another contact law.

    It has the methods of :class:`~terrain_estimator.model.physics.Physics` that the model calls.
    """

    def __init__(self, nominal: Physics, stresses: ScmStresses | LinearStresses) -> None:
        """Take the physics of rover and soils, and the contact law."""
        super().__init__()
        self.nominal, self.stresses = nominal, stresses
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
        """Return the usable wheels, as the nominal physics does; each sinkage has to be known."""
        return self.nominal.usable(view, leading) & torch.isfinite(view.sinkage)

    def balanced(
        self, view: PackedView, constants: Tensor, varied: Tensor, strength: Tensor
    ) -> PackedView:
        """Return the observation as it is: these forces are not solved for a missing sinkage."""
        del constants, varied, strength
        return view

    def rows_at(
        self, frame: Frame, likely: Tensor, contact: ContactModel, doubt: Tensor | None
    ) -> Rows:
        """Return the rows in a frame, expanded at ``likely`` [n, P], less the excess of doubt."""
        place = places(likely, frame, contact)
        where = varied_inputs(place, contact)
        ruts = self.stresses.ruts(place.slip, place.sinkage, contact.radius)
        none = torch.zeros_like(where.constants[..., :2])
        inputs = ContactInputs(where.slip, where.sinkage, where.constants, none, None, None, ruts)
        read = read_forces(self.stresses(inputs, contact), where.scale, contact, doubt)
        return rows_of_forces(frame, measured_forces(frame, place, read))

    def average(
        self, packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Return the rows of a block [n, P] on a soil; arguments as of the nominal physics."""
        deviations = expansion[2:]
        contact = self.nominal.contact(soil, deviations)
        theta = torch.cat([expansion[:2], torch.ones_like(expansion[:1])])
        frame = frame_of(packed, contact)
        straight = self.rows_at(frame, packed, values_alone(contact), None)
        agreed = agreement(straight, packed, contact, theta, chosen)
        rows = self.rows_at(frame, agreed.inputs, contact, agreed.doubt)
        return self.nominal.averaged(rows, packed, learnt, deviations, chosen)

    def drive_row(
        self, view: PackedView, constants: Tensor, varied: Tensor, deviations: Tensor
    ) -> Tensor:
        """Return the velocity row of one observation and its changes, as rows.drive_row does."""
        del deviations
        contact = self.nominal.contact_of(constants, varied)
        sets = (constants + varied).unsqueeze(1)
        ruts = self.stresses.ruts(view.slip, view.sinkage, contact.radius)
        none = torch.zeros_like(sets[..., :2])
        inputs = ContactInputs(view.slip, view.sinkage, sets, none, None, None, ruts)
        along = along_body(view.contact_angle).unsqueeze(-1)
        row = (along * self.stresses(inputs, contact)).sum([1, 2]) * (
            contact.column_unit * contact.body_scale[0]
        )
        return torch.cat([row[:1], 1e3 * (row[1:] - row[:1])])

    def has_moved(self, packed: Tensor, before: Tensor, after: Tensor) -> Tensor:
        """Return False []: the rows of a block [n, P] are evaluated once."""
        del packed, after
        return torch.zeros_like(before[0], dtype=torch.bool)

    def effect_sizes(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return the moments [J, 2] of the sizes of J = 0 named effects."""
        return self.nominal.effect_sizes(mean, variance)
