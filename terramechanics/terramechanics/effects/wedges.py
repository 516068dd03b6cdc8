# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil that a wheel pushes aside, by passive earth pressure of its own strength.

These laws compete with :class:`terramechanics.effects.soil.Bulldozing` and its like for the side.
They are not affine in tan(phi). Their size is a share of the full passive pressure; the soil's unit
weight is UNIT_WEIGHT times the exponential of the extra value.
"""

import math
from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.stresses import entry_angle, quadrature
from terramechanics.effects.law import AddedForce, ExtraValue, Law
from terramechanics.effects.soil import SPINS, resisting, side_resistance
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.rover import Rover

UNIT_WEIGHT = 15e3
"""[N/m^3] of dry sand on Earth, where testbeds stand: 13 to 17 kN/m^3."""
WEIGHTS = ExtraValue("logarithm of the soil's unit weight over 15 kN/m^3", "1", 0.15)


def passive_root(tan_phi: Tensor) -> Tensor:
    """Return tan(45 deg + phi / 2), the root of Rankine's coefficient N_phi of passive pressure."""
    slope = tan_phi.clamp(min=0.0)
    return slope + torch.sqrt(1.0 + slope**2)


def hegedus(strength: Tensor, unit_weight: Tensor) -> tuple[Tensor, Tensor]:
    """Return the factors of h and h^2 in the force [N/m] on a vertical blade at a depth h.

    Hegedus 1960 as in Ishigami et al. 2007: D_1 (c h + gamma / 2 D_2 h^2) with D_1 = cot X +
    tan(X + phi), D_2 = cot X + cot(X)^2 tan(phi) and X = 45 deg - phi / 2. Then cot X and
    tan(X + phi) are both tan(45 deg + phi / 2).
    """
    tan_phi = strength[..., 1].clamp(min=0.0)
    root = passive_root(tan_phi)
    return 2.0 * root * strength[..., 0], root * unit_weight * (root + root**2 * tan_phi)


class HegedusWedge(Law):
    """T - size b D_1 (c z + gamma / 2 D_2 z^2), see :func:`hegedus`: the buried rim is a blade.

    Where a wheel only spins it fades, see :func:`~terramechanics.effects.soil.resisting`.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (WEIGHTS,)

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width, self.spins, self.weight = rover.wheel_width, SPINS, UNIT_WEIGHT

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the resistance of the wedge, without a moment; ``values[:, 0]`` in [1]."""
        held, pushed = hegedus(inputs.strength, self.weight * torch.exp(values[:, 1:]))
        full = self.width * inputs.sinkage * (held + pushed * inputs.sinkage)
        return resisting(values[:, :1] * full, inputs.slip, self.spins)


class HegedusSide(Law):
    """Y + F sin(beta): the side of the wheel ploughs soil with cohesion and weight.

    F is size times INT D_1 (c h + gamma / 2 D_2 h^2) (r - h cos), see :func:`hegedus` and
    terramechanics.effects.soil.side_resistance. INT h (r - h cos) is r^2 sin^3(theta_1) / 3.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (WEIGHTS,)
    nodes: Tensor

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.weight = UNIT_WEIGHT
        self.register_buffer("nodes", quadrature())

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the force on the side; none straight ahead. ``values[:, 0]`` in [1]."""
        if inputs.slip_angle is None:
            return None
        held, pushed = hegedus(inputs.strength, self.weight * torch.exp(values[:, 1:]))
        sine = torch.sin(entry_angle(inputs.sinkage, self.radius))
        full = held * self.radius**2 * sine**3 / 3.0
        full = full + side_resistance(pushed, inputs.sinkage, self.radius, self.nodes)
        side = values[:, :1] * full * torch.sin(inputs.slip_angle)
        return AddedForce(torch.zeros_like(side), torch.zeros_like(side), side)


class BekkerWedge(Law):
    """T - size R: Bekker's resistance of the soil ahead of a wheel of entry angle theta_1.

    Bekker 1969, with Terzaghi's factors of general shear failure::

        R = b sin(theta_1 + phi) / (2 sin(theta_1) cos(phi)) (2 z c K_c + gamma z^2 K_gamma)
            + gamma l^3 / 3 (90 deg - phi) + c l^2 (1 + tan(45 deg + phi / 2))
        l = z tan^2(45 deg - phi / 2)
        K_c = (N_c - tan phi) cos^2 phi,    K_gamma = (2 N_gamma / tan phi + 1) cos^2 phi

    Where a wheel only spins it fades, see :func:`~terramechanics.effects.soil.resisting`.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (WEIGHTS,)

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width, self.spins, self.weight = rover.wheel_width, SPINS, UNIT_WEIGHT

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the resistance of the wedge, without a moment; ``values[:, 0]`` in [1]."""
        unit_weight, z = self.weight * torch.exp(values[:, 1:]), inputs.sinkage
        cohesion, tan_phi = inputs.strength[..., 0], inputs.strength[..., 1].clamp(min=1e-3)
        root = passive_root(tan_phi)
        by_cohesion, by_weight = wedge_factors(tan_phi)
        ahead = 0.5 * (1.0 + tan_phi / torch.tan(entry_angle(z, self.radius)))
        wedge = ahead * (2.0 * z * cohesion * by_cohesion + unit_weight * z**2 * by_weight)
        reach = z / root**2
        ends = unit_weight * reach**3 / 3.0 * (0.5 * math.pi - torch.atan(tan_phi))
        ends = ends + cohesion * reach**2 * (1.0 + root)
        return resisting(values[:, :1] * (self.width * wedge + ends), inputs.slip, self.spins)


def wedge_factors(tan_phi: Tensor) -> tuple[Tensor, Tensor]:
    """Return Bekker's K_c and K_gamma [1] from Terzaghi's factors of bearing capacity, phi > 0.

    N_q = exp((3 / 2 pi - phi) tan phi) / (2 cos^2(45 deg + phi / 2)), N_c = (N_q - 1) cot phi;
    N_gamma, which Terzaghi gave as a curve, is 2 (N_q + 1) tan phi / (1 + 0.4 sin(4 phi)) (Coduto
    2001): 12 % below Terzaghi's table at 20 deg, 2 % above at 30 deg, 21 % above at 40 deg.
    """
    phi = torch.atan(tan_phi)
    cos_square = 1.0 / (1.0 + tan_phi**2)
    # 2 cos^2(45 deg + phi / 2) = 1 - sin(phi)
    surcharge = torch.exp((1.5 * math.pi - phi) * tan_phi) / (1.0 - torch.sin(phi))
    by_cohesion = ((surcharge - 1.0) / tan_phi - tan_phi) * cos_square
    by_weight = 4.0 * (surcharge + 1.0) / (1.0 + 0.4 * torch.sin(4.0 * phi)) + 1.0
    return by_cohesion, by_weight * cos_square
