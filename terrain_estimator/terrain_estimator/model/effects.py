# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Named effects in the regression rows: what each one changes there, scripted with a model that has it.

Nothing is linearised in the size of an effect: the rows are evaluated with the effect at a given
size. The formulas are those of terramechanics.effects.laws, which the simulator calls. What an
effect does to a sensor or to a drive is undone on the packed observations, and what it does in the
contact or to the body acts in the forces.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.model.packing import (
    view_of,
    with_pitch,
    with_sinkage,
    with_slip_and_sd,
    with_torque,
)
from terrain_estimator.model.prior import RoverBody
from terrain_estimator.model.rows import ContactModel, with_body
from terramechanics.effects.laws import (
    GROUSER_SLIP,
    bulldozing_resistance,
    digging_exponent,
    dry_torque,
    grouser_thrust,
    rate_stiffness,
    rebound_angle,
    rut_stiffness,
    sinkage_behind,
    slip_behind,
    uneven,
    viscous_torque,
)
from terramechanics.simulation.simulation import SLOWEST
from terramechanics.vehicle.suspension import Geometry, shifted_centre


class Touching(NamedTuple):
    """What the stress integrals are evaluated at; K as in Variation."""

    slip: Tensor  # [K, n, A] [1]
    sinkage: Tensor  # [K, n, A] [m]
    constants: Tensor  # [K, n or 1, A or 1, 6]
    exit_angle: Tensor  # [K, n, A] [rad]


def scaled(touching: Touching, exponent: Tensor, stiffness: Tensor) -> Touching:
    """The same with the sinkage exponent and the stiffness of the soil multiplied."""
    n, k_c, k_phi, shear_modulus, c1, c2 = touching.constants.unbind(-1)
    parts = (n * exponent, k_c * stiffness, k_phi * stiffness, shear_modulus, c1, c2)
    columns = torch.broadcast_tensors(*parts)  # type: ignore[no-untyped-call]
    return Touching(touching.slip, touching.sinkage, torch.stack(columns, -1), touching.exit_angle)


class Law(nn.Module):
    """One named effect. Every method here leaves the nominal rows as they are.

    ``values`` [n or 1, count] are what is not known of it: its size, or what stands for it, and
    what else it has.
    """

    order: Tensor

    def __init__(self, body: RoverBody, count: int = 1) -> None:
        super().__init__()
        self.axles, self.radius, self.count = body.axles, body.radius_m, count
        self.first = 0  # place of its values among those of all
        self.register_buffer("order", torch.arange(body.axles, dtype=torch.float64))

    def undone(self, packed: Tensor, values: Tensor) -> Tensor:
        """Packed observations [n, P] as they would be without it."""
        del values
        return packed

    def touching(self, before: Touching, values: Tensor, rate: Tensor) -> Touching:
        """What it makes of the contact at the wheel ``rate`` [n, A] [rad/s]."""
        del values, rate
        return before

    def push(self, touching: Touching, values: Tensor) -> Tensor:
        """What it adds to T [N], [K, n, A]."""
        del values
        return torch.zeros_like(touching.slip)

    def turn(self, touching: Touching, values: Tensor) -> Tensor:
        """What it adds to M [N m], [K, n, A]."""
        del values
        return torch.zeros_like(touching.slip)

    def loaded(self, contact: ContactModel, values: Tensor) -> ContactModel:
        """What it makes of the rover's body."""
        del values
        return contact

    def size(self, mean: Tensor, variance: Tensor) -> Tensor:
        """Mean and variance [2] of the size where that of its first value are these."""
        return torch.stack([mean, variance])


class SlopeBias(Law):
    """See the registry; the pitch is corrected."""

    def undone(self, packed: Tensor, values: Tensor) -> Tensor:
        """See Law."""
        pitch = view_of(packed, self.axles).pitch - values[:, 0]
        return with_pitch(packed, pitch, self.axles)


class OdometryScale(Law):
    """See the registry; beside the size, how uneven it is from one axle to the next behind it."""

    def __init__(self, body: RoverBody) -> None:
        super().__init__(body, 2)

    def undone(self, packed: Tensor, values: Tensor) -> Tensor:
        """See Law."""
        error = uneven(values[:, :1], values[:, 1:], self.order)
        view = view_of(packed, self.axles)
        return with_slip_and_sd(packed, slip_behind(view.slip, error), (1.0 + error) * view.slip_sd)


class SinkageBias(Law):
    """See the registry; the sinkage is corrected."""

    def undone(self, packed: Tensor, values: Tensor) -> Tensor:
        """See Law."""
        sinkage = view_of(packed, self.axles).sinkage
        return with_sinkage(packed, sinkage_behind(sinkage, values))


class DriveDrag(Law):
    """See the registry; the torque is corrected."""

    def undone(self, packed: Tensor, values: Tensor) -> Tensor:
        """See Law."""
        view = view_of(packed, self.axles)
        return with_torque(packed, view.torque - self.loss(view.wheel_rate, values))

    def loss(self, rate: Tensor, values: Tensor) -> Tensor:
        """Torque that is lost [n, A] [N m]."""
        return viscous_torque(values, rate)


class CoulombDrag(DriveDrag):
    """See the registry; the torque is corrected."""

    def loss(self, rate: Tensor, values: Tensor) -> Tensor:
        """See DriveDrag."""
        return dry_torque(values, rate)


class Bulldozing(Law):
    """See the registry."""

    def push(self, touching: Touching, values: Tensor) -> Tensor:
        """See Law."""
        return -bulldozing_resistance(values, touching.sinkage)


class Grousers(Law):
    """See the registry; beside the size, the logarithm of the slip that mobilises them, over the registry's."""

    def __init__(self, body: RoverBody) -> None:
        super().__init__(body, 2)
        self.mobilised = GROUSER_SLIP

    def push(self, touching: Touching, values: Tensor) -> Tensor:
        """See Law."""
        return grouser_thrust(
            values[:, :1], touching.slip, self.mobilised * torch.exp(values[:, 1:])
        )

    def turn(self, touching: Touching, values: Tensor) -> Tensor:
        """See Law."""
        return self.radius * grouser_thrust(
            values[:, :1], touching.slip, self.mobilised * torch.exp(values[:, 1:])
        )


class SlipSinkage(Law):
    """See the registry."""

    def touching(self, before: Touching, values: Tensor, rate: Tensor) -> Touching:
        """See Law."""
        del rate
        return scaled(
            before,
            digging_exponent(values, before.slip, before.constants[..., 0]),
            torch.ones_like(values),
        )


class Multipass(Law):
    """See the registry; beside the size, how much more later passes add than the first one, less 1."""

    def __init__(self, body: RoverBody) -> None:
        super().__init__(body, 2)

    def touching(self, before: Touching, values: Tensor, rate: Tensor) -> Touching:
        """See Law."""
        del rate
        return scaled(
            before,
            torch.ones_like(self.order),
            rut_stiffness(values[:, :1], 1.0 + values[:, 1:], self.order),
        )


class RateDependence(Law):
    """See the registry."""

    def __init__(self, body: RoverBody) -> None:
        super().__init__(body)
        self.slowest = SLOWEST

    def touching(self, before: Touching, values: Tensor, rate: Tensor) -> Touching:
        """See Law."""
        speed = (self.radius * torch.nan_to_num(rate)).clamp(min=self.slowest)
        return scaled(before, torch.ones_like(values), rate_stiffness(values, speed))


class ExitAngle(Law):
    """See the registry. Its value is the root of the size: the angle goes like that."""

    def touching(self, before: Touching, values: Tensor, rate: Tensor) -> Touching:
        """See Law."""
        del rate
        return Touching(
            before.slip,
            before.sinkage,
            before.constants,
            rebound_angle(values**2, before.sinkage, self.radius),
        )

    def size(self, mean: Tensor, variance: Tensor) -> Tensor:
        """See Law: moments of the square of a Gaussian where it is above zero, else zero."""
        sd = variance.sqrt()
        above = 0.5 * torch.special.erfc(-mean / (2.0 * variance).sqrt())
        density = sd * torch.exp(-0.5 * mean**2 / variance) / math.sqrt(2.0 * math.pi)
        second = (mean**2 + variance) * above + mean * density
        fourth = (mean**4 + 6.0 * mean**2 * variance + 3.0 * variance**2) * above + mean * (
            mean**2 + 5.0 * variance
        ) * density
        return torch.stack([second, fourth - second**2])


class Load(Law):
    """The registry's payload wherever it lies: beside its mass its moments [kg m] about the rover's centre of mass."""

    def __init__(self, body: RoverBody) -> None:
        super().__init__(body, 3)
        self.mass = body.mass_kg

    def loaded(self, contact: ContactModel, values: Tensor) -> ContactModel:
        """See Law."""
        total = (self.mass + values[:, :1]).clamp(min=0.1 * self.mass)
        geometry = contact.geometry
        centre = shifted_centre(geometry.centre, values[:, 1:], total).unsqueeze(1)
        moved = Geometry(geometry.axle_x, centre, geometry.pivot, geometry.radius)
        return with_body(contact, moved, contact.body_scale * self.mass / total)


LAWS: dict[str, Callable[[RoverBody], Law]] = {
    "slope_bias": SlopeBias,
    "bulldozing": Bulldozing,
    "drive_drag": DriveDrag,
    "coulomb_drag": CoulombDrag,
    "payload": Load,
    "grousers": Grousers,
    "slip_sinkage": SlipSinkage,
    "multipass": Multipass,
    "odometry_scale": OdometryScale,
    "sinkage_bias": SinkageBias,
    "rate_dependence": RateDependence,
    "exit_angle": ExitAngle,
}
"""The effects that a model can have, by the registry's names."""

NOT_ONLINE = {
    "latency": (
        "it needs what was measured before and after; subtract the latency from the stamps of slip"
        " and sinkage instead"
    ),
    "failed_wheel": (
        "the true slip of its wheels depends on c and tan phi; leave the axle's slip out (NaN)"
        " instead"
    ),
    "lateral_bulldozing": "it acts sideways, which a planar rover does not show",
}
"""Why the others cannot be estimated online, and what to do instead."""
