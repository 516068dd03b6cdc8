# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of lugs that compete with :class:`terramechanics.effects.grousers.Grousers`."""

from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.stresses import entry_angle, quadrature, wheel_forces
from terramechanics.effects.law import AddedForce, ExtraValue, Law
from terramechanics.effects.wedges import passive_root
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.rover import Rover

MOBILISED = 0.1
"""[1] Slip at which lugs have mobilised 63 % of their thrust."""
USUAL = 3.0
"""[1] Rankine's coefficient at which the size holds, that of tan phi = 0.58."""


class ShearAtTips(Law):
    """Soil is sheared along a circle of radius R = r (1 + size), near the lugs' tips.

    The rim still carries the normal stress. Shear displacement and slip are those of R, shear
    forces grow by R / r, their torque by (R / r)^2 (Ding et al. 2009, equations of the equivalent
    shear radius).
    """

    nodes: Tensor

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width = rover.wheel_width
        self.register_buffer("nodes", quadrature())

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Shear the soil at R; ``values`` in [1]. The largest stress stays where it is."""
        del rate
        ratio = 1.0 + values
        slip = 1.0 - (1.0 - inputs.slip) / ratio
        n, k_c, k_phi, shear_modulus, c1, c2 = inputs.constants.unbind(-1)
        parts = (n, k_c, k_phi, shear_modulus / ratio, c1 + c2 * (inputs.slip - slip), c2)
        columns = torch.broadcast_tensors(*parts)  # type: ignore[no-untyped-call]
        return ContactInputs(
            slip,
            inputs.sinkage,
            torch.stack(columns, -1),
            inputs.strength * ratio.unsqueeze(-1),
            inputs.exit_angle,
            inputs.slip_angle,
        )

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return the torque that shear at R has beyond that at r."""
        by_strength = wheel_forces(
            inputs.slip,
            inputs.sinkage,
            inputs.constants,
            self.radius,
            self.width,
            self.nodes,
            inputs.exit_angle,
            inputs.slip_angle,
        )[..., 2, :2]
        torque = (by_strength * inputs.strength).sum(-1)
        return AddedForce(torch.zeros_like(torque), values * torque)


class PassivePressure(Law):
    """T + F and M + r F with F = size N / USUAL b r theta_1 sgn(i) (1 - exp(-|i| / i_0)).

    Lugs in the soil, whose number goes with the contact's length, push against passive earth
    pressure, N = tan^2(45 deg + phi / 2). i_0 is MOBILISED times the exponential of the extra
    value.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("logarithm of the slip that mobilises them", "1", 0.7),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width = rover.wheel_width
        self.mobilised = MOBILISED

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return thrust and torque of the lugs; ``values[:, 0]`` in [Pa]."""
        passive = passive_root(inputs.strength[..., 1]) ** 2 / USUAL
        area = self.width * self.radius * entry_angle(inputs.sinkage, self.radius)
        share = -torch.expm1(-inputs.slip.abs() / (self.mobilised * torch.exp(values[:, 1:])))
        thrust = values[:, :1] * passive * area * torch.sign(inputs.slip) * share
        return AddedForce(thrust, self.radius * thrust)
