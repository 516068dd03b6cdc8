# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows under named effects, for exported models and for the search alike.

Nothing is linearised in the size of an effect: the rows are evaluated with the effect at a given
size. The effect of a sensor or of a drive is undone on the packed observations; an effect in the
contact or on the body acts in the forces. The laws are those of terramechanics.effects.
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn

from terrain_estimator.model import packing
from terrain_estimator.model.packing import (
    view_of,
    with_acceleration,
    with_pitch,
    with_sinkage,
    with_slip_and_sd,
)
from terrain_estimator.model.rows import (
    ContactModel,
    Forces,
    Frame,
    Rows,
    frame_of,
    measured_forces,
    places,
    read_forces,
    rows_of_forces,
    varied_inputs,
    with_body,
)
from terramechanics.contact.ruts import REBOUND, ruts_now
from terramechanics.contact.scm import Rut
from terramechanics.contact.stresses import wheel_forces
from terramechanics.effects.law import Law, Readings, with_torque
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.suspension import Geometry, shifted_centre


class Observed(NamedTuple):
    """Packed observations and the signals that effects need besides them; A axles."""

    packed: Tensor  # [n, P]
    wheel_rate: Tensor  # [n, A] [rad/s]
    slip_rate: Tensor | None = None  # [n, A] [1/s], where the neighbours in time are there
    sinkage_rate: Tensor | None = None  # [n, A] [m/s], likewise
    rut: Rut | None = None  # [n, A] below each wheel, where the past is known


def readings_of(observed: Observed) -> Readings:
    """Return the sensor values that effects can change."""
    view = view_of(observed.packed, observed.wheel_rate.shape[-1])
    return Readings(
        slip=view.slip,
        slip_sd=view.slip_sd,
        sinkage=view.sinkage,
        torque=view.torque,
        pitch=view.pitch.unsqueeze(-1),
        acceleration=view.acceleration.unsqueeze(-1),
        wheel_rate=observed.wheel_rate,
        slip_rate=observed.slip_rate,
        sinkage_rate=observed.sinkage_rate,
    )


def with_readings(packed: Tensor, readings: Readings) -> Tensor:
    """Return packed observations [n, P] with other sensor values."""
    packed = with_slip_and_sd(packed, readings.slip, readings.slip_sd)
    packed = packing.with_torque(with_sinkage(packed, readings.sinkage), readings.torque)
    axles = readings.wheel_rate.shape[-1]
    packed = with_pitch(packed, readings.pitch.squeeze(-1), axles)
    return with_acceleration(packed, readings.acceleration.squeeze(-1), axles)


class StressIntegrals(nn.Module):
    """The stress integrals of wheels, by quadrature."""

    def forward(self, inputs: ContactInputs, contact: ContactModel) -> Tensor:
        """Return the coefficients of the forces, [..., n, A, 3, 3] as ``wheel_forces`` has them."""
        return wheel_forces(
            inputs.slip,
            inputs.sinkage,
            inputs.constants,
            contact.radius,
            contact.width,
            contact.nodes,
            inputs.exit_angle,
        )


class EffectRows(nn.Module):
    """Rows of one rover under several laws; their values [n or 1, V] follow one another."""

    def __init__(
        self, laws: Sequence[Law], mass_kg: float, integrals: nn.Module | None = None
    ) -> None:
        """``integrals`` is called as :class:`StressIntegrals`, which it is by default."""
        super().__init__()
        self.laws = cast("list[Law]", nn.ModuleList(laws))
        self.counts, self.mass = [law.count for law in laws], mass_kg
        self.rebound = REBOUND
        self.integrals = StressIntegrals() if integrals is None else integrals
        own = bool(getattr(self.integrals, "keeps_ruts", False))
        self.keeps_ruts = own or any(law.keeps_ruts for law in laws)

    def size_moments(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return mean and variance [J, 2] of every size from those of the values [V]."""
        means, variances = (
            mean.split_with_sizes(self.counts),
            variance.split_with_sizes(self.counts),
        )
        return torch.stack(
            [law.size_moments(means[k][0], variances[k][0]) for k, law in enumerate(self.laws)]
        )

    def corrected(self, observed: Observed, values: Tensor) -> Tensor:
        """Return packed observations [n, P] without the effects on sensors and drives."""
        return with_readings(
            observed.packed, self.corrected_readings(readings_of(observed), values)
        )

    def corrected_readings(self, readings: Readings, values: Tensor) -> Readings:
        """Return sensor values without the effects on sensors and drives."""
        own = values.split_with_sizes(self.counts, 1)
        for k, law in enumerate(self.laws):
            readings = law.corrected(readings, own[k])
            loss = law.drive_loss(readings.wheel_rate, own[k])
            readings = with_torque(readings, readings.torque - loss)
        return readings

    def loaded(self, contact: ContactModel, values: Tensor) -> ContactModel:
        """Return the contact model with the mass that the effects add to the body."""
        own = values.split_with_sizes(self.counts, 1)
        for k, law in enumerate(self.laws):
            added = law.added_mass(own[k])
            if added is not None:
                total = (self.mass + added.mass).clamp(min=0.1 * self.mass)
                geometry = contact.geometry
                centre = shifted_centre(geometry.centre, added.moment, total).unsqueeze(1)
                moved = Geometry(
                    geometry.axle_x, centre, geometry.pivot, geometry.carried, geometry.radius
                )
                contact = with_body(contact, moved, contact.body_scale * self.mass / total)
        return contact

    def forces(
        self, inputs: ContactInputs, wheel_rate: Tensor, contact: ContactModel, values: Tensor
    ) -> Tensor:
        """Return :func:`wheel_forces` with the effects in them, [..., n, A, 3, 3]."""
        own = values.split_with_sizes(self.counts, 1)
        for k, law in enumerate(self.laws):
            inputs = law.contact(inputs, own[k], wheel_rate)
        forces = self.integrals(inputs, contact)
        for k, law in enumerate(self.laws):
            forces = law.stresses(forces, inputs, own[k])
        for k, law in enumerate(self.laws):
            forces = law.under_load(forces, inputs, own[k])
        traction, torque = torch.zeros_like(inputs.slip), torch.zeros_like(inputs.slip)
        for k, law in enumerate(self.laws):
            added = law.added_force(inputs, own[k])
            if added is not None:
                traction, torque = traction + added.traction, torque + added.torque
        sums = torch.stack([torch.zeros_like(traction), traction, torque], -1)
        return torch.cat([forces[..., :2], (forces[..., 2] + sums).unsqueeze(-1)], -1)

    def ruts(
        self, slip: Tensor, sinkage: Tensor, known: Rut | None, contact: ContactModel
    ) -> Rut | None:
        """Return the ruts [n, A] below the wheels where a law needs them, else None.

        Where the past is not known, they are as if the wheels before had always rolled as now.
        """
        if not self.keeps_ruts:
            return None
        if known is not None:
            return known
        return ruts_now(slip, sinkage, contact.radius, torch.full_like(sinkage, self.rebound))

    def measured(
        self,
        observed: Observed,
        input_correction: Tensor,
        contact: ContactModel,
        values: Tensor,
        strength: Tensor,
        doubt: Tensor | None = None,
    ) -> tuple[Frame, Forces]:
        """Return the frame of observations and the forces of their rows, see :meth:`rows`."""
        packed, loaded = self.corrected(observed, values), self.loaded(contact, values)
        frame = frame_of(packed, loaded)
        point = places(packed + input_correction, frame, loaded)
        varied = varied_inputs(point, loaded)
        inputs = ContactInputs(
            varied.slip, varied.sinkage, varied.constants, strength.view(1, 1, 2), None, None,
            self.ruts(point.slip, point.sinkage, observed.rut, loaded),
        )  # fmt: skip
        forces = self.forces(inputs, observed.wheel_rate, loaded, values)
        read = read_forces(forces, varied.scale, loaded, doubt)
        return frame, measured_forces(frame, point, read)

    def rows(
        self,
        observed: Observed,
        input_correction: Tensor,
        contact: ContactModel,
        values: Tensor,
        strength: Tensor,
        doubt: Tensor | None = None,
    ) -> Rows:
        """Return the rows of observations, expanded at corrected inputs.

        ``input_correction`` [n, P] leads from the inputs without the effects to those; ``doubt`` is
        that of :class:`Agreement`. ``strength`` [2] is c [Pa] and tan phi, for laws that need it.
        """
        frame, forces = self.measured(observed, input_correction, contact, values, strength, doubt)
        return rows_of_forces(frame, forces)
