# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of the vehicle: its drives and its mass."""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP, quadrature
from terramechanics.effects.laws import dry_torque, viscous_torque
from terramechanics.simulation.plant import ContactInputs, Effect, Payload, Situation, Size
from terramechanics.vehicle.rover import Rover

REAR = 2
"""Axle that fails unless another is named."""
NODES = quadrature()
"""For the torque that decides how a failed wheel slips."""
ROUNDS = 20
LARGEST_MOVE = 0.2
"""[1] Bound of one change of slip."""
SETTLED = 1e-9
"""[1] Newton's move below which the next would change nothing."""


@dataclass
class DriveDrag(Effect):
    """The motor gives size w more than the wheel needs: viscous friction of gears and seals. [N m s/rad]."""

    size: Size

    def friction(self, where: Situation) -> Tensor:
        """See Effect."""
        return viscous_torque(where.of(self.size), where.rate)


@dataclass
class CoulombDrag(Effect):
    """The motor gives size sgn(w) more than the wheel needs: dry friction of bearings and gears. [N m]."""

    size: Size

    def friction(self, where: Situation) -> Tensor:
        """See Effect."""
        return dry_torque(where.of(self.size), where.rate)


@dataclass
class ExtraMass(Effect):
    """size more mass at the centre of mass. [kg]."""

    size: Size

    def payload(self, where: Situation) -> Payload:
        """See Effect."""
        mass = where.of(self.size).reshape(-1).expand(where.velocity.shape)
        body = where.rover
        return Payload(
            mass,
            torch.full_like(mass, body.centre_of_mass_x),
            torch.full_like(mass, body.centre_of_mass_height),
        )


@dataclass
class FailedWheel(Effect):
    """The coupling of one axle's motors passes on only (1 - size) of the torque that its encoder's slip calls for. [1].

    With 1 the wheels roll freely while motor and encoder turn as commanded, so that the slip that
    is reported is not the rim's. The rim's slip is the one at which the ground takes the torque
    that is left, at the same sinkage. A planar wheel stands for the pair on its axle. A locked
    wheel is not modelled: it is dragged below MIN_SLIP.
    """

    size: Size
    axle: int = REAR
    _lag: Tensor = field(
        default_factory=lambda: torch.zeros(0), init=False, repr=False
    )  # slip lost when last asked for

    def begin(self, rover: Rover, batch: int) -> None:
        """See Effect."""
        del rover
        self._lag = torch.zeros(batch, 1, dtype=torch.float64)

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """See Effect."""
        rover, whole = where.rover, contact.expanded()
        here = torch.arange(rover.axles) == self.axle
        failing = ContactInputs(
            whole.slip[..., here],
            whole.sinkage[..., here],
            whole.constants[..., here, :],
            whole.strength[..., here, :],
        )

        def torque(slip: Tensor) -> Tensor:
            return dataclasses.replace(failing, slip=slip).forces(
                rover.wheel_radius, rover.wheel_width, NODES
            )[..., 2]

        left = (1.0 - where.of(self.size)) * torque(failing.slip)
        lag = self._lag[where.episode] if self._lag.numel() else torch.zeros_like(where.rate[:, :1])
        slip = _slip_under(torque, left, failing.slip - lag)
        if self._lag.numel():
            # Where the next search starts; what it finds does not depend on that.
            self._lag[where.episode] = (failing.slip - slip).reshape(-1, *lag.shape)[0]
        return dataclasses.replace(contact, slip=torch.where(here, slip, contact.slip))


def _slip_under(torque: Callable[[Tensor], Tensor], wanted: Tensor, start: Tensor) -> Tensor:
    """Slip at which ``torque`` takes the value ``wanted``, by Newton: torque rises with slip, less and less."""
    small = 1e-6
    slip = start.clamp(MIN_SLIP, MAX_SLIP)
    for _ in range(ROUNDS):
        here, there = torque(torch.stack([slip, slip + small]))
        move = ((wanted - here) * small / (there - here).clamp(min=1e-9)).clamp(
            -LARGEST_MOVE, LARGEST_MOVE
        )
        slip = (slip + move).clamp(MIN_SLIP, MAX_SLIP)
        if float(move.abs().max()) < SETTLED:
            break
    return slip
