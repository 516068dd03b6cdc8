# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The formulas of the named effects: tensors in, tensors out.

Like terramechanics.contact.stresses they broadcast over leading dimensions and can be compiled by
``torch.jit.script``, so that the simulator, the search for a missing effect and an exported model
that has the effect call the same functions. Sources and physical ranges stand in the registry.
"""

import torch
from torch import Tensor

from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP, entry_angle

GROUSER_SLIP = 0.1
"""[1] Slip at which grousers have mobilised 63 % of their thrust."""
REFERENCE_SPEED = 0.1
"""[m/s] Circumferential speed at which the soil constants hold."""
SOFTEST = 0.05
"""[1] Least stiffness of a rut, of that of the undisturbed soil."""
SHALLOWEST = 0.2
"""[1] Share of the reported sinkage that is left at least when a bias is taken off: a wheel on the ground has some."""


def bulldozing_resistance(size: Tensor, sinkage: Tensor) -> Tensor:
    """Resistance [N] of the wedge of soil ahead of a wheel: size [N/m^2] times the square of the sinkage [m]."""
    return size * sinkage**2


def side_resistance(size: Tensor, sinkage: Tensor, radius: float, nodes: Tensor) -> Tensor:
    """Force [N] on the side of a wheel that moves straight sideways (Hegedus 1960 as in Ishigami et al. 2007, without cohesion)::

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


def grouser_thrust(size: Tensor, slip: Tensor, mobilised: Tensor) -> Tensor:
    """Thrust [N] of the lugs, of which 63 % are there at the slip ``mobilised`` [1]."""
    return -size * torch.sign(slip) * torch.expm1(-slip.abs() / mobilised)


def digging_exponent(size: Tensor, slip: Tensor, exponent: Tensor) -> Tensor:
    """Factor [1] of the sinkage ``exponent``: n + size |i|. A braked wheel digs as much as a driven one does."""
    return 1.0 + size * slip.abs() / exponent


def rut_stiffness(size: Tensor, growth: Tensor, order: Tensor, softest: float = SOFTEST) -> Tensor:
    """Factor [1] of the stiffness below a wheel that ``order`` wheels went before.

    Each pass after the first adds ``growth`` times what the first did.
    """
    passes = order.clamp(max=1.0) + growth * (order - 1.0).clamp(min=0.0)
    return (1.0 + size * passes).clamp(min=softest)


def rate_stiffness(size: Tensor, speed: Tensor, reference: float = REFERENCE_SPEED) -> Tensor:
    """Factor [1] of the stiffness at the circumferential ``speed`` [m/s], which has to be positive."""
    return (speed / reference) ** size


def rebound_angle(size: Tensor, sinkage: Tensor, radius: float) -> Tensor:
    """Angle [rad] behind the axle to which contact reaches where soil springs back by ``size`` of the sinkage [m]; 0 for none."""
    rebound = size * sinkage
    return torch.where(rebound > 0.0, entry_angle(rebound, radius), 0.0)


def viscous_torque(size: Tensor, rate: Tensor) -> Tensor:
    """Torque [N m] that drives lose at the wheel ``rate`` [rad/s]."""
    return size * rate


def dry_torque(size: Tensor, rate: Tensor) -> Tensor:
    """Torque [N m] that drives lose whatever the wheel ``rate`` [rad/s], against it."""
    return size * torch.sign(rate)


def reported_slip(slip: Tensor, error: Tensor) -> Tensor:
    """Slip that is computed with a wheel radius too large by the share ``error``."""
    return (slip + error) / (1.0 + error)


def in_slip_range(slip: Tensor, lowest: float = MIN_SLIP, highest: float = MAX_SLIP) -> Tensor:
    """Slip [1] that was corrected, within the range of the model."""
    return slip.clamp(lowest, highest)


def slip_behind(reported: Tensor, error: Tensor) -> Tensor:
    """The inverse of :func:`reported_slip`, within the range of the model."""
    return in_slip_range((1.0 + error) * reported - error)


def sinkage_behind(reported: Tensor, bias: Tensor, shallowest: float = SHALLOWEST) -> Tensor:
    """Sinkage [m] less what was reported too much."""
    return torch.maximum(reported - bias, shallowest * reported)


def uneven(error: Tensor, unevenness: Tensor, order: Tensor) -> Tensor:
    """Error of the radius of each axle, in the middle ``error``, from one to the next behind it ``unevenness`` of that more."""
    middle = 0.5 * (order.shape[0] - 1)
    return error * (1.0 + unevenness * (order - middle))
