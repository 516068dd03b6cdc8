# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A law at given values as an effect of the simulation."""

import dataclasses
from collections.abc import Callable

import torch
from torch import Tensor

from terramechanics.effects.law import Law, Readings
from terramechanics.simulation.plant import ContactInputs, Effect, Payload, Situation
from terramechanics.simulation.sample import Sample
from terramechanics.vehicle.rover import Rover


class SimulatedEffect(Effect):
    """A law that acts with ``values`` [batch or 1, V], which may change from step to step."""

    def __init__(self, make: Callable[[Rover], Law], values: Tensor) -> None:
        self._make, self.values = make, values
        self._rover: Rover | None = None
        self._built: Law | None = None

    def begin(self, rover: Rover, batch: int) -> None:
        """Make the law anew, without a memory of other simulations."""
        del batch
        self._rover, self._built = rover, self._make(rover)

    def _law(self, rover: Rover) -> Law:
        if self._built is None or self._rover is not rover:
            self.begin(rover, 0)
        return self._built or self._make(rover)

    def _of(self, where: Situation) -> Tensor:
        return self.values if self.values.shape[0] == 1 else self.values[where.episode]

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """Change the inputs of the stress integrals by the law."""
        law = self._law(where.rover)
        if where.passes is None:
            return law.contact(contact, self._of(where), where.rate)
        order, law.order = law.order, where.passes  # in a turn that is not the order of the axles
        try:
            return law.contact(contact, self._of(where), where.rate)
        finally:
            law.order = order

    @property
    def keeps_ruts(self) -> bool:
        """Whether the law needs the ruts of the wheels before."""
        return self._built is not None and self._built.keeps_ruts

    def stresses(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """Change the forces of the contact law by another law's, at the strength of the ground."""
        law = self._law(where.rover)
        if type(law).stresses is Law.stresses:
            return forces
        return _at_strength(law.stresses(_known(forces), contact, self._of(where)), contact)

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """Add the law's force to ``forces`` [..., rows, axles, 3 or 4]."""
        law = self._law(where.rover)
        if type(law).under_load is not Law.under_load:
            forces = _at_strength(law.under_load(_known(forces), contact, self._of(where)), contact)
        added = law.added_force(contact, self._of(where))
        if added is None:
            return forces
        none = torch.zeros_like(added.traction)
        lateral = none if added.lateral is None else added.lateral
        parts = [none, added.traction, added.torque, lateral][: forces.shape[-1]]
        alike = torch.broadcast_tensors(*parts)  # type: ignore[no-untyped-call]
        return forces + torch.stack(alike, dim=-1)

    def payload(self, where: Situation) -> Payload | None:
        """Place the law's mass where its moments have it."""
        added = self._law(where.rover).added_mass(self._of(where))
        if added is None:
            return None
        mass = added.mass.expand(where.velocity.shape[0], 1)
        arm = torch.where(mass == 0.0, 0.0, added.moment / mass)
        along, up = arm.unbind(1)
        body = where.rover
        return Payload(
            mass.squeeze(1), body.centre_of_mass_x + along, body.centre_of_mass_height + up
        )

    def friction(self, where: Situation) -> Tensor:
        """Return the torque that the drives lose, [rows, axles] [N m]."""
        return self._law(where.rover).drive_loss(where.rate, self._of(where))

    def sensed(self, sample: Sample) -> Sample:
        """Change the readings by the law."""
        if self._rover is None:
            raise ValueError("the simulation has not begun")
        gravity = self._rover.gravity
        true = Readings(
            sample.slip,
            torch.zeros_like(sample.slip),
            sample.sinkage,
            sample.torque,
            sample.pitch.unsqueeze(-1),
            sample.specific_force(gravity).unsqueeze(-1),
            sample.wheel_rate,
            sample.time,
        )
        batch, values = sample.slip.shape[0], self.values
        if values.shape[0] not in (1, batch):  # of rovers with several sides
            values = values.repeat_interleave(batch // values.shape[0], 0)
        seen = self._law(self._rover).reported(true, values)
        pitch = seen.pitch.squeeze(-1)
        return dataclasses.replace(
            sample,
            slip=seen.slip,
            sinkage=seen.sinkage,
            pitch=pitch,
            # A sample carries dv/dt, a sensor reads dv/dt + g sin ab.
            acceleration=seen.acceleration.squeeze(-1) - gravity * torch.sin(pitch),
        )


def _known(forces: Tensor) -> Tensor:
    """Return coefficients [..., 3] of ``forces`` that depend on no strength."""
    return torch.stack([torch.zeros_like(forces), torch.zeros_like(forces), forces], -1)


def _at_strength(coefficients: Tensor, contact: ContactInputs) -> Tensor:
    """Return the forces by ``coefficients`` [..., 3] at the strength of the ground."""
    by_strength = torch.matmul(coefficients[..., :2], contact.strength.unsqueeze(-1)).squeeze(-1)
    return by_strength + coefficients[..., 2]
