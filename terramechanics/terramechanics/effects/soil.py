# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of the soil: what the pressure-sinkage and shear laws of the nominal model leave out."""

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.contact import entry_angle
from terramechanics.plant import Contact, Effect, Situation, Size

GROUSER_SLIP = 0.1
"""[1] Slip at which grousers have mobilised 63 % of their thrust."""
_SOFTEST = 0.05  # [1] of the undisturbed stiffness
REFERENCE_SPEED = 0.1
"""[m/s] Circumferential speed at which the soil constants hold."""


def with_traction(forces: Tensor, extra: Tensor, torque: Tensor | None = None) -> Tensor:
    """Forces [..., 3] with ``extra`` [...] [N] added to T, and ``torque`` [...] [N m] to M."""
    turn = torch.zeros_like(extra) if torque is None else torque
    return forces + torch.stack(torch.broadcast_tensors(torch.zeros_like(extra), extra, turn), dim=-1)  # type: ignore[no-untyped-call]


@dataclass
class Bulldozing(Effect):
    """T = T - size z^2: the wheel pushes a wedge of soil; its weight grows with the square of the depth. [N/m^2]."""

    size: Size

    def push(self, where: Situation, contact: Contact, forces: Tensor) -> Tensor:
        """See Effect."""
        return with_traction(forces, -where.of(self.size) * contact.sinkage**2)


@dataclass
class Grousers(Effect):
    """T + F and M + r F with F = size sgn(i) (1 - exp(-|i| / mobilised)): lugs shear soil between them. [N]."""

    size: Size
    mobilised: float = GROUSER_SLIP  # [1] slip at which 63 % of the thrust are there

    def push(self, where: Situation, contact: Contact, forces: Tensor) -> Tensor:
        """See Effect."""
        thrust = -where.of(self.size) * torch.sign(contact.slip) * torch.expm1(-contact.slip.abs() / self.mobilised)
        return with_traction(forces, thrust, where.rover.wheel_radius * thrust)


@dataclass
class SlipSinkage(Effect):
    """n + size i: a spinning wheel digs, so that the same load needs more depth (Ding et al. 2011). [1]."""

    size: Size

    def contact(self, where: Situation, contact: Contact) -> Contact:
        """See Effect. A braked wheel digs as much as a driven one does."""
        factor = 1.0 + where.of(self.size) * contact.slip.abs() / contact.constants[..., 0]
        return contact.with_constants(n=factor)


@dataclass
class Multipass(Effect):
    """k (1 + size p) below a wheel that p wheels went before: the rut is compacted. [1].

    Passes after the first may add ``growth`` times what the first did.
    """

    size: Size
    growth: float = 1.0

    def contact(self, where: Situation, contact: Contact) -> Contact:
        """See Effect."""
        passes = where.order.clamp(max=1.0) + self.growth * (where.order - 1.0).clamp(min=0.0)
        return contact.stiffened((1.0 + where.of(self.size) * passes).clamp(min=_SOFTEST))


@dataclass
class RateDependence(Effect):
    """k (r w / (0.1 m/s))^size: soil that is loaded faster is stiffer, or softer where size is negative. [1]."""

    size: Size

    def contact(self, where: Situation, contact: Contact) -> Contact:
        """See Effect."""
        return contact.stiffened((where.speed / REFERENCE_SPEED) ** where.of(self.size))


@dataclass
class ExitAngle(Effect):
    """theta_2 = -acos(1 - size z / r): soil springs back behind the axle by that share of the sinkage. [1]."""

    size: Size

    def contact(self, where: Situation, contact: Contact) -> Contact:
        """See Effect."""
        rebound = where.of(self.size) * contact.sinkage
        angle = torch.where(rebound > 0.0, entry_angle(rebound, where.rover.wheel_radius), 0.0)
        return dataclasses.replace(contact, exit_angle=angle)
