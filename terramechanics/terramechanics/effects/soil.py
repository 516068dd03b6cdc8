# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of the soil: what the pressure-sinkage and shear laws of the nominal model leave out.

Sources and physical ranges stand in the registry.
"""

import math
from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.stresses import entry_angle, quadrature
from terramechanics.effects.law import AddedForce, ExtraValue, Law
from terramechanics.simulation.plant import (
    ContactInputs,
    with_depth,
    with_exit_angle,
    with_exponent,
    with_stiffness,
)
from terramechanics.simulation.sample import SLOWEST
from terramechanics.vehicle.rover import Rover

REFERENCE_SPEED = 0.1
"""[m/s] Circumferential speed at which the soil constants hold."""
SPINS = 0.05
"""[1] Share of the rim's speed below which a wheel that hardly moves on pushes less soil."""
WEDGE_DEPTH, USUAL_COHESION, USUAL_FRICTION = 0.02, 2000.0, 0.58
"""[m], [Pa], [1] Depth and strength of the ground at which the size of a wedge holds."""
WEDGE_COHESIVE = 0.75
"""[1] Expected share of cohesion in the resistance of a wedge there."""
SOFTEST = 0.05
"""[1] Least stiffness of a rut, of that of the undisturbed soil."""


class Bulldozing(Law):
    """T - size z^2: a wheel pushes a wedge of soil, whose weight grows with the square of z.

    SPINS says where a wheel only spins, see :func:`resisting`.
    """

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.spins = SPINS

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the resistance of the wedge; ``values`` in [N/m^2]."""
        return resisting(values * inputs.sinkage**2, inputs.slip, self.spins)


class PassiveBulldozing(Law):
    """T - F, by the passive pressure of the ground's own strength.

    ::

        F = size z (d z_0 c / c_0 + (1 - d) z tan(phi) / tan(phi_0)),    d = WEDGE_COHESIVE + value

    of the extra value, with z_0 = WEDGE_DEPTH, c_0 = USUAL_COHESION, tan(phi_0) = USUAL_FRICTION.
    d is the share of cohesion in the force on usual soil at z_0, where the size [N/m^2] is F /
    z_0^2.

    On a wall of depth z Rankine's pressure is 2 c sqrt(K_p) z by cohesion and gamma K_p z^2 / 2 by
    weight: d is 0.94 where gamma is 15 kN/m^3. A heap ahead of the wheel, or remoulded soil, has
    less. K_p is 3 tan(phi) / tan(phi_0) within 15 % where tan(phi) is 0.3 to 1; sqrt(K_p), 23 %
    less to 39 % more there than at phi_0, counts as constant.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("share of cohesion 2 cm deep in usual soil, less 0.75", "1", 0.25),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.spins, self.share = SPINS, WEDGE_COHESIVE
        self.cohesion, self.friction = WEDGE_DEPTH / USUAL_COHESION, USUAL_FRICTION

    def under_load(self, forces: Tensor, inputs: ContactInputs, values: Tensor) -> Tensor:
        """Take the resistance from the traction; ``values[:, 0]`` in [N/m^2]."""
        z, share = inputs.sinkage, self.share + values[:, 1:]
        rolls = ((1.0 - inputs.slip) / self.spins).clamp(0.0, 1.0)
        wedge = values[:, :1] * z * rolls
        by_cohesion = share * self.cohesion * wedge
        by_friction = (1.0 - share) * z / self.friction * wedge
        force = torch.stack([by_cohesion, by_friction, torch.zeros_like(by_friction)], -1)
        traction = forces[..., 1:2, :] - force.unsqueeze(-2)
        return torch.cat([forces[..., :1, :], traction, forces[..., 2:, :]], -2)


class BlendedBulldozing(Law):
    """T - z (size (d z_0 + (1 - d) z) + v (z_0 - z)): linear in both values [N/m^2].

    With d = WEDGE_COHESIVE and z_0 = WEDGE_DEPTH that is what :class:`PassiveBulldozing` has in
    usual soil; v is size times the value there. A filter that expands the products of size, share
    and strength anew every second takes the wedge for strength. In other soil the size is the
    resistance there, F / z_0^2 at z_0.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("resistance of more cohesion at a depth of 2 cm", "of the size", 0.25),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.spins, self.share, self.depth = SPINS, WEDGE_COHESIVE, WEDGE_DEPTH

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the resistance of the wedge; ``values`` in [N/m^2]."""
        z = inputs.sinkage
        size = values[:, :1] * (self.share * self.depth + (1.0 - self.share) * z)
        return resisting(z * (size + values[:, 1:] * (self.depth - z)), inputs.slip, self.spins)


def resisting(wedge: Tensor, slip: Tensor, spins: float) -> AddedForce:
    """Return the force of soil that a wheel pushes ahead, without a moment.

    ``wedge`` [..., A] [N] is that of a wheel that rolls, ``slip`` [..., A] [1]. A wheel that only
    spins pushes none: above a slip of 1 - ``spins`` the force goes to zero.
    """
    resistance = wedge * ((1.0 - slip) / spins).clamp(0.0, 1.0)
    return AddedForce(-resistance, torch.zeros_like(resistance))


class LateralBulldozing(Law):
    """Y + F sin(beta), F of :func:`side_resistance`: the side of the wheel ploughs the soil."""

    nodes: Tensor

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.register_buffer("nodes", quadrature())

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the force on the side; none straight ahead. ``values`` in [N/m^3]."""
        aside = inputs.slip_angle
        if aside is None:
            return None
        force = side_resistance(values, inputs.sinkage, self.radius, self.nodes)
        side = force * torch.sin(aside)
        return AddedForce(torch.zeros_like(side), torch.zeros_like(side), side)


def side_resistance(size: Tensor, sinkage: Tensor, radius: float, nodes: Tensor) -> Tensor:
    """Force [N] on the side of a wheel that moves straight sideways.

    Hegedus 1960 as in Ishigami et al. 2007, without cohesion::

        INT size h^2 (r - h cos) over 0..theta_1,    h = r (cos - cos(theta_1))

    ``size`` is gamma / 2 D_1 D_2 [N/m^3], of the soil's unit weight gamma and two factors of its
    friction angle phi: D_1 = cot X + tan(X + phi), D_2 = cot X + cot(X)^2 tan(phi), X = 45 deg -
    phi / 2; up to 4e5 at phi = 45 deg and 20 kN/m^3. ``nodes`` are those of
    terramechanics.contact.stresses.quadrature.
    """
    theta_1 = entry_angle(sinkage, radius).unsqueeze(-1)
    theta = theta_1 * nodes[0]
    depth = 2.0 * radius * torch.sin(0.5 * (theta_1 + theta)) * torch.sin(0.5 * (theta_1 - theta))
    pushed = depth**2 * (radius - depth * torch.cos(theta)) * nodes[1] * theta_1
    return size * pushed.sum(-1)


class SlipSinkage(Law):
    """n + size |i|: a slipping wheel digs; a braked wheel does so as much as a driven one."""

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Raise the sinkage exponent with slip; ``values`` in [1]."""
        del rate
        factor = 1.0 + values * inputs.slip.abs() / inputs.constants[..., 0]
        return with_exponent(inputs, factor)


class DugSinkage(Law):
    """The same, of which a share d, the extra value, leaves no contact.

    With a = size |i| / n the exponent is n (1 + (1 - d) a) at the depth z^(1 + d a), z in [m] as in
    the pressure-sinkage law. With d = 0 that is :class:`SlipSinkage`. With d = 1 all stresses are
    those at the depth z_0 of the same pressure on soil without the effect: the wheel touches the
    ground below the hole that it dug.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("share of the digging that leaves no contact", "1", 0.5),
    )

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Raise the sinkage exponent with slip; ``values[:, 0]`` in [1]."""
        del rate
        dug = values[:, :1] * inputs.slip.abs() / inputs.constants[..., 0]
        away = values[:, 1:]
        # A wheel that carries nothing has no depth, of which the power has no derivative.
        depth = inputs.sinkage.clamp(min=1e-6) ** (away * dug)
        return with_depth(with_exponent(inputs, 1.0 + (1.0 - away) * dug), depth)


class SinkageFactor(Law):
    """z times ((1 + |i|) / (1 - 0.5 |i|))^size at the same pressure; 1 is Lyasko's law."""

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Soften the soil with slip; ``values`` in [1]."""
        del rate
        slip = inputs.slip.abs().clamp(max=1.0)
        deeper = (1.0 + slip) / (1.0 - 0.5 * slip)
        return with_stiffness(inputs, deeper ** (-values * inputs.constants[..., 0]))


class Multipass(Law):
    """k (1 + size p) below a wheel that p wheels went before: the rut is compacted.

    Each pass after the first adds 1 plus the extra value times what the first did.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("growth with later passes, less 1", "1", 0.5),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.softest = SOFTEST

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Stiffen the soil below the wheels that follow; ``values[:, 0]`` in [1]."""
        del rate
        growth = 1.0 + values[:, 1:]
        passes = self.order.clamp(max=1.0) + growth * (self.order - 1.0).clamp(min=0.0)
        return with_stiffness(inputs, (1.0 + values[:, :1] * passes).clamp(min=self.softest))


class RateDependence(Law):
    """k (r w / (0.1 m/s))^size: soil that is loaded faster is stiffer, or softer."""

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.slowest, self.reference = SLOWEST, REFERENCE_SPEED

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Scale the stiffness with the circumferential speed; ``values`` in [1]."""
        speed = (self.radius * torch.nan_to_num(rate).abs()).clamp(min=self.slowest)
        return with_stiffness(inputs, (speed / self.reference) ** values)


class ExitAngle(Law):
    """theta_2 = -acos(1 - size z / r): soil springs back behind the axle by a share of z.

    The angle goes like the root of the size, so its value is that root.
    """

    @classmethod
    def size_of(cls, value: float) -> float:
        """Return the square of the value."""
        return value**2

    @classmethod
    def value_of(cls, size: float) -> float:
        """Return the root of the size."""
        return math.sqrt(size)

    @classmethod
    def slope(cls, value: float) -> float:
        """Return the change of the size with its value."""
        return 2.0 * value

    def size_moments(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Return the moments of the square of a Gaussian where it is above zero, else zero."""
        sd = variance.sqrt()
        above = 0.5 * torch.special.erfc(-mean / (2.0 * variance).sqrt())
        density = sd * torch.exp(-0.5 * mean**2 / variance) / math.sqrt(2.0 * math.pi)
        second = (mean**2 + variance) * above + mean * density
        fourth = (mean**4 + 6.0 * mean**2 * variance + 3.0 * variance**2) * above + mean * (
            mean**2 + 5.0 * variance
        ) * density
        return torch.stack([second, fourth - second**2])

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Extend the contact behind the axle."""
        del rate
        rebound = values**2 * inputs.sinkage
        angle = torch.where(rebound > 0.0, entry_angle(rebound, self.radius), 0.0)
        return with_exit_angle(inputs, angle)
