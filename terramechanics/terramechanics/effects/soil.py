# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of the soil: what the pressure-sinkage and shear laws of the nominal model leave out."""

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.contact.stresses import quadrature
from terramechanics.effects.laws import (
    GROUSER_SLIP,
    bulldozing_resistance,
    digging_exponent,
    grouser_thrust,
    rate_stiffness,
    rebound_angle,
    rut_stiffness,
    side_resistance,
)
from terramechanics.simulation.plant import ContactInputs, Effect, Situation, Size

NODES = quadrature()
"""For the side of a wheel."""


def with_traction(forces: Tensor, extra: Tensor, torque: Tensor | None = None) -> Tensor:
    """Forces [..., 3 or 4] with ``extra`` [...] [N] added to T, and ``torque`` [...] [N m] to M."""
    none = torch.zeros_like(extra)
    added = [none, extra, none if torque is None else torque, none][: forces.shape[-1]]
    return forces + torch.stack(torch.broadcast_tensors(*added), dim=-1)  # type: ignore[no-untyped-call]


@dataclass
class Bulldozing(Effect):
    """T = T - size z^2: the wheel pushes a wedge of soil; its weight grows with the square of the depth. [N/m^2]."""

    size: Size

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """See Effect."""
        return with_traction(forces, -bulldozing_resistance(where.of(self.size), contact.sinkage))


@dataclass
class LateralBulldozing(Effect):
    """Y + F sin(beta), F of :func:`side_resistance`: the side of the wheel ploughs through the soil. [N/m^3]. Straight ahead nothing."""

    size: Size

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """See Effect."""
        if contact.slip_angle is None:
            return forces
        side = side_resistance(
            where.of(self.size), contact.sinkage, where.rover.wheel_radius, NODES
        ) * torch.sin(contact.slip_angle)
        return torch.cat([forces[..., :3], forces[..., 3:] + side.unsqueeze(-1)], dim=-1)


@dataclass
class Grousers(Effect):
    """T + F and M + r F with F = size sgn(i) (1 - exp(-|i| / mobilised)): lugs shear soil between them. [N]."""

    size: Size
    mobilised: float = GROUSER_SLIP  # [1] slip at which 63 % of the thrust are there

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """See Effect."""
        thrust = grouser_thrust(
            where.of(self.size), contact.slip, torch.tensor(self.mobilised, dtype=torch.float64)
        )
        return with_traction(forces, thrust, where.rover.wheel_radius * thrust)


@dataclass
class SlipSinkage(Effect):
    """n + size i: a spinning wheel digs, so that the same load needs more depth (Ding et al. 2011). [1]."""

    size: Size

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """See Effect."""
        return contact.with_constants(
            n=digging_exponent(where.of(self.size), contact.slip, contact.constants[..., 0])
        )


@dataclass
class Multipass(Effect):
    """k (1 + size p) below a wheel that p wheels went before: the rut is compacted. [1].

    Passes after the first may add ``growth`` times what the first did.
    """

    size: Size
    growth: float = 1.0

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """See Effect."""
        return contact.stiffened(
            rut_stiffness(
                where.of(self.size), torch.tensor(self.growth, dtype=torch.float64), where.order
            )
        )


@dataclass
class RateDependence(Effect):
    """k (r w / (0.1 m/s))^size: soil that is loaded faster is stiffer, or softer where size is negative. [1]."""

    size: Size

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """See Effect."""
        return contact.stiffened(rate_stiffness(where.of(self.size), where.speed))


@dataclass
class ExitAngle(Effect):
    """theta_2 = -acos(1 - size z / r): soil springs back behind the axle by that share of the sinkage. [1]."""

    size: Size

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """See Effect."""
        angle = rebound_angle(where.of(self.size), contact.sinkage, where.rover.wheel_radius)
        return dataclasses.replace(contact, exit_angle=angle)
