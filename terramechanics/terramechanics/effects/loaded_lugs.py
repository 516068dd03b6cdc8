# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of lugs whose thrust grows with the load; they compete with those of ``lugs``."""

from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.stresses import entry_angle, quadrature, wheel_forces
from terramechanics.effects.law import AddedForce, ExtraValue, Law
from terramechanics.effects.lugs import MOBILISED, PassivePressure
from terramechanics.effects.wedges import passive_root
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.rover import Rover


def carried(inputs: ContactInputs, radius: float, width: float, nodes: Tensor) -> Tensor:
    """Return the normal force [N] of the stresses."""
    rows = wheel_forces(
        inputs.slip,
        inputs.sinkage,
        inputs.constants,
        radius,
        width,
        nodes,
        inputs.exit_angle,
        inputs.slip_angle,
    )[..., 0, :]
    return (rows[..., :2] * inputs.strength).sum(-1) + rows[..., 2]


class LugSides(Law):
    """T + F and M + (r + size / 2) F: the sides of lugs of the height ``size`` shear the soil.

    Micklethwait 1944 and Bekker 1969, of the contact's length l = r theta_1 and the load N::

        F = sgn(i) (2 size l c + 0.64 N tan phi (size / b) atan(b / size)) m
        m = 1 - K / (|i| l) (1 - exp(-|i| l / K))

    The force acts in the middle of the sides.
    """

    nodes: Tensor

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width = rover.wheel_width
        self.register_buffer("nodes", quadrature(4))

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return thrust and torque of the sides; ``values`` in [m]."""
        length = self.radius * entry_angle(inputs.sinkage, self.radius)
        load = carried(inputs, self.radius, self.width, self.nodes)
        cohesion, tan_phi = inputs.strength.unbind(-1)
        aspect = values / self.width
        rubbed = 0.64 * aspect * torch.atan(1.0 / aspect.clamp(min=1e-9))
        full = 2.0 * values * length * cohesion + load * tan_phi * rubbed
        sheared = (inputs.slip.abs() * length / inputs.constants[..., 3]).clamp(min=1e-9)
        thrust = torch.sign(inputs.slip) * full * (1.0 + torch.expm1(-sheared) / sheared)
        return AddedForce(thrust, (self.radius + 0.5 * values) * thrust)


class SpacedLugs(Law):
    """T + F and M + r F: each lug in the soil pushes against all of its passive earth pressure.

    Of one lug of height h that is b (q h N_phi + 2 c h sqrt(N_phi)), Terzaghi 1943 and Wong 2008,
    with N_phi = tan^2(45 deg + phi / 2) and the load over the contact's area as surcharge q. Lugs
    at the spacing L are l / L in a contact of the length l, so with size = h / L::

        F = size sgn(i) (N N_phi + 2 c sqrt(N_phi) b l) (1 - exp(-|i| / i_0))

    The weight of the soil between lugs is left out: gamma h / 2 is about a hundredth of q. i_0 is
    MOBILISED times the exponential of the extra value.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = PassivePressure.extra
    nodes: Tensor

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width = rover.wheel_width
        self.mobilised = MOBILISED
        self.register_buffer("nodes", quadrature(4))

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return thrust and torque of the lugs; ``values[:, 0]`` in [1]."""
        root = passive_root(inputs.strength[..., 1])
        area = self.width * self.radius * entry_angle(inputs.sinkage, self.radius)
        load = carried(inputs, self.radius, self.width, self.nodes)
        full = load * root**2 + 2.0 * inputs.strength[..., 0] * root * area
        share = -torch.expm1(-inputs.slip.abs() / (self.mobilised * torch.exp(values[:, 1:])))
        thrust = values[:, :1] * full * torch.sign(inputs.slip) * share
        return AddedForce(thrust, self.radius * thrust)
