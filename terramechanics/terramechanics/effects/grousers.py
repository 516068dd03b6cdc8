# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of grousers: of drives, of models of steered rovers, and of tables of one wheel."""

from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.stresses import entry_angle
from terramechanics.effects.law import AddedForce, ExtraValue, Law
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.rover import Rover

GROUSER_SLIP = 0.1
"""[1] Slip at which grousers have mobilised 63 % of their thrust."""
SOONER, LATER = 0.05, 0.2
"""[1] The same of grousers that act sooner and later, between which a blend of laws goes."""
COHESIVE = 2.0
"""[1] Thrust by a force c b l of cohesion, over the thrust by an equal load N.

By published laws 1.2 (passive earth pressure, Terzaghi 1943), 1.7 (shear at the tips, Wong 2010) or
3.4 to 3.9 (sides of lugs up to a fifth as high as wide, Micklethwait 1944), each at tan(phi) =
0.58. This is between them.
"""


class Grousers(Law):
    """T + F and M + r F with F = size sgn(i) (1 - exp(-|i| / i_0)): lugs shear soil between them.

    i_0 is GROUSER_SLIP times the exponential of the extra value. For tables of one wheel, whose
    load hardly varies.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("logarithm of the slip that mobilises them", "1", 0.7),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.mobilised = GROUSER_SLIP

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return thrust and torque of the lugs; ``values[:, 0]`` in [N]."""
        mobilised = self.mobilised * torch.exp(values[:, 1:])
        slip = inputs.slip
        thrust = -values[:, :1] * torch.sign(slip) * torch.expm1(-slip.abs() / mobilised)
        return AddedForce(thrust, self.radius * thrust)


class LoadedGrousers(Law):
    """The same, with a thrust that grows with the wheel's load N and with cohesion.

    ::

        F = size (N + COHESIVE c b l) / N_0 sgn(i) (1 - exp(-|i| / i_0))

    of the contact's width b and length l = r theta_1. N_0 is the load on level ground, where the
    size [N] is the thrust at large slips without cohesion.

    Lugs push against soil that the wheel presses down. Laws of lugs in loaded soil have both parts:
    on their sides (Micklethwait 1944, Bekker 1969), in front of them (Terzaghi 1943, Wong 2008),
    and at their tips (Ding et al. 2009, Wong 2010).
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = Grousers.extra

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.mobilised, self.load = GROUSER_SLIP, rover.weight / len(rover.wheels)
        self.area = COHESIVE * rover.wheel_width * rover.wheel_radius

    def under_load(self, forces: Tensor, inputs: ContactInputs, values: Tensor) -> Tensor:
        """Add thrust and torque of the lugs; ``values[:, 0]`` in [N]."""
        slip = inputs.slip
        mobilised = self.mobilised * torch.exp(values[:, 1:])
        thrust = -values[:, :1] * torch.sign(slip) * torch.expm1(-slip.abs() / mobilised)
        cohesive = self.area * entry_angle(inputs.sinkage, self.radius)
        return pushed(forces, thrust / self.load, cohesive, self.radius)


class BlendedGrousers(Law):
    """Grousers whose force is linear in both values, size and v [N].

    F = sgn(i) (size m(GROUSER_SLIP) + v (m(SOONER) - m(LATER))), m(i_0) = 1 - exp(-|i| / i_0). The
    sum is what :class:`Grousers` has where v is zero, and the size at large slips whatever v is.

    At slips far below i_0 only size / i_0 shows. A filter that expands this ratio anew every second
    comes to know size and i_0 each by itself, which no reading tells. With a sum it does not. For
    the same reason the force does not grow with the load, which depends on c and tan(phi).
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("force that acts sooner less that which acts later", "of the size", 0.5),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.usual, self.sooner, self.later = GROUSER_SLIP, SOONER, LATER

    def added_force(self, inputs: ContactInputs, values: Tensor) -> AddedForce | None:
        """Return thrust and torque of the lugs; ``values`` in [N]."""
        slip = inputs.slip.abs()
        usual = -torch.expm1(-slip / self.usual)
        shape = torch.exp(-slip / self.later) - torch.exp(-slip / self.sooner)
        force = values[:, :1] * usual + values[:, 1:] * shape
        thrust = torch.sign(inputs.slip) * force
        return AddedForce(thrust, self.radius * thrust)


def pushed(forces: Tensor, share: Tensor, cohesive: Tensor, radius: float) -> Tensor:
    """Add a thrust at the rim to coefficients [..., A, R, 3] of N, T, M and perhaps Y.

    It is a ``share`` [..., A] [1] of the load and of c times ``cohesive`` [..., A] [m^2]. Its
    arm is ``radius`` [m].
    """
    none = torch.zeros_like(cohesive)
    thrust = share.unsqueeze(-1) * (forces[..., 0, :] + torch.stack([cohesive, none, none], -1))
    rows = forces[..., 1:3, :] + torch.stack([thrust, radius * thrust], -2)
    return torch.cat([forces[..., :1, :], rows, forces[..., 3:, :]], -2)
