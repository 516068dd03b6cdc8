# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one observation, affine in (c [kPa], tan phi), and their noise.

Rows (A axles, p wheels per axle, m mass, g gravity, al = contact angle relative to the body, ab = pitch)::

    0        dv/dt + g sin ab = SUM_k p (T_k cos al_k - N_k sin al_k) / m       [m/s^2]   longitudinal balance
    1        cos ab           = SUM_k p (N_k cos al_k + T_k sin al_k) / (m g)   [1]       balance normal to the body
    2..A+1   torque_k         = M_k                                             [N m]     drive torque of one wheel
    A+2      acceleration     = SUM_k p (T_k cos al_k - N_k sin al_k) / m       [m/s^2]   specific force of the imu

(Banerjee et al. eqs. 1, 15 and 17 with gravity along the slope; Iagnemma et al. 2004 for the torque.) Each measured
slip, sinkage and angle enters several rows, so its error is carried along as one unit-variance source per value and
turned into the full covariance of the rows, not into a variance of each.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terramechanics.contact import in_range, wheel_forces

PA_PER_UNIT = 1000.0
"""c is carried in kPa, so that both parameters are of order one."""


class Rows(NamedTuple):
    """The rows of n observations: R = A + 3 rows, E = 3 A + 1 sources of noise, each of unit variance.

    The leading C = 1 + M: first the values, then their change for one prior deviation of each uncertain soil constant.
    """

    features: Tensor  # [C, n, R, 3] columns c [kPa], tan phi, 1
    noise: Tensor  # [C, n, R, E, 3] change of a row for one standard deviation of a source, affine in (c, tan phi)
    target: Tensor  # [n, R] what the row has to equal; row 0: g sin ab, to be subtracted from dv/dt
    variance: Tensor  # [n, R] of the target itself
    used: Tensor  # [n, R] 1 where the row holds, else 0


def row_names(axles: int) -> tuple[str, ...]:
    """Names of the rows, in their order."""
    return ("velocity", "load", *(f"torque_{k}" for k in range(axles)), "acceleration")


def turn(forces: Tensor, angle: Tensor) -> Tensor:
    """Forces [..., A, 3, 3] turned by the contact angles [..., A] into the body: [..., A, 2, 3], along x and normal to it."""
    cosine, sine = torch.cos(angle).unsqueeze(-1), torch.sin(angle).unsqueeze(-1)
    normal, traction = forces[..., 0, :], forces[..., 1, :]
    return torch.stack([traction * cosine - normal * sine, normal * cosine + traction * sine], dim=-2)


class Contact(NamedTuple):
    """What the rows need to know of rover and soil."""

    constants: Tensor  # [6] of the soil, in the order of terramechanics.contact.CONSTANTS; or [n, 1, 6]
    varied: Tensor  # [C, 6] nothing, then a thousandth of the prior deviation of each of M uncertain constants
    nodes: Tensor  # of terramechanics.contact.quadrature
    column_unit: Tensor  # [3] Pa per kPa, 1, 1
    body_scale: Tensor  # [2, 1] p / m [1/kg] and p / (m g) [1/N]
    stand_in: Tensor  # [8, 1] harmless values of the packed groups, for a wheel that is not usable
    gravity: float  # [m/s^2]
    radius: float  # [m]
    width: float  # [m]


def usable_wheels(wheels: Tensor, contact: Contact) -> Tensor:
    """Wheels [n, A] of packed groups [n, 8, A] that are measured and inside the model's range."""
    return in_range(wheels[:, 0], wheels[:, 2], contact.constants, contact.radius) & torch.isfinite(wheels[:, 4])


def drive_row(wheels: Tensor, contact: Contact) -> Tensor:
    """Row 0 of one packed group [8, A] whose wheels are all usable, without noise: [1 + M, 3].

    First the features, then their change for one prior deviation of each uncertain constant.
    """
    constants = (contact.constants + contact.varied).unsqueeze(1)
    forces = wheel_forces(wheels[0], wheels[2], constants, contact.radius, contact.width, contact.nodes) * contact.column_unit
    row = (turn(forces, wheels[4])[:, :, 0] * contact.body_scale[0]).sum(1)
    return torch.cat([row[:1], 1e3 * (row[1:] - row[0])])


def force_changes(wheels: Tensor, contact: Contact) -> Tensor:
    """Forces and their change for one standard deviation of slip and of sinkage: [3, C, n, A, 3, 3], as ``wheel_forces``.

    The change is a central difference over plus and minus one deviation, so that a curved law is averaged over the
    spread of its input; a sinkage smaller than its deviation is varied by less. C as in Rows.
    """
    slip, slip_sd, sinkage, sinkage_sd = wheels[:, 0], wheels[:, 1], wheels[:, 2], wheels[:, 3]
    shallow = torch.minimum(sinkage_sd, 0.9 * sinkage)
    zero = torch.zeros_like(slip)
    # With the constants as given both sides; for the changes by the constants one side is enough.
    slips = [torch.stack([zero, -slip_sd])] + [torch.stack([zero, slip_sd, zero])] * contact.varied.shape[0]
    sinkages = [torch.stack([-shallow, zero])] + [torch.stack([zero, zero, shallow])] * contact.varied.shape[0]
    constants = contact.constants + contact.varied.unsqueeze(1).unsqueeze(1)
    every = torch.cat([constants[:1], constants[:1], constants.repeat_interleave(3, 0)])
    forces = wheel_forces(slip + torch.cat(slips), sinkage + torch.cat(sinkages), every, contact.radius, contact.width, contact.nodes)
    shallower, braked = forces[0], forces[1]
    values, faster, deeper = forces[2::3], forces[3::3], forces[4::3]
    scale = (sinkage_sd / shallow).unsqueeze(-1).unsqueeze(-1)
    one_sided = torch.stack([values, faster - values, (deeper - values) * scale])
    changes = 1e3 * (one_sided[:, 1:] - one_sided[:, :1])
    central = torch.stack([values[0], 0.5 * (faster[0] - braked), 0.5 * (deeper[0] - shallower) * scale])
    return torch.cat([central.unsqueeze(1), changes], 1) * contact.column_unit


def regression_rows(packed: Tensor, contact: Contact) -> Rows:
    """Rows of n packed observations [n, 8 A + 8]; a wheel that is not usable takes the rows that need it along."""
    axles = (packed.shape[1] - 8) // 8
    wheels = packed[:, : 8 * axles].view(-1, 8, axles)
    usable = usable_wheels(wheels, contact)
    wheels = torch.where(usable.unsqueeze(1), wheels, contact.stand_in)
    forces = force_changes(wheels, contact)
    turned = turn(forces, wheels[:, 4])
    scale = contact.body_scale
    by_angle = torch.stack([-turned[0, :, :, :, 1], turned[0, :, :, :, 0]], dim=3) * wheels[:, 5].unsqueeze(-1).unsqueeze(-1)
    body_noise = (torch.cat([turned[1], turned[2], by_angle], 2) * scale).transpose(2, 3)  # [C, n, 2, 3 A, 3]
    nominal = torch.cat([(turned[0] * scale).sum(2), forces[0, :, :, :, 2]], 2)
    eye = torch.eye(axles, dtype=packed.dtype).unsqueeze(-1)
    own = [eye * forces[1, :, :, :, 2].unsqueeze(2), eye * forces[2, :, :, :, 2].unsqueeze(2)]
    torque_noise = torch.cat([own[0], own[1], torch.zeros_like(own[0])], 3)  # [C, n, A, 3 A, 3]
    noise = torch.cat([body_noise, torque_noise, body_noise[:, :, :1]], 2)

    pitch, pitch_sd = packed[:, 8 * axles + 2], packed[:, 8 * axles + 3]
    tilt = torch.zeros_like(noise[:, :, :, :1])
    tilt[0, :, 0, 0, 2] = -contact.gravity * torch.cos(pitch) * pitch_sd
    tilt[0, :, 1, 0, 2] = torch.sin(pitch) * pitch_sd
    every = usable.all(1, keepdim=True)
    measured = torch.cat([packed[:, 6 * axles : 7 * axles], packed[:, 8 * axles + 4 : 8 * axles + 5]], 1)
    measured_sd = torch.cat([packed[:, 7 * axles : 8 * axles], packed[:, 8 * axles + 5 : 8 * axles + 6]], 1)
    holds = torch.isfinite(measured) & torch.isfinite(measured_sd) & torch.cat([usable, every], 1)
    balance = torch.stack([contact.gravity * torch.sin(pitch), torch.cos(pitch)], 1)
    return Rows(
        features=torch.cat([nominal, nominal[:, :, :1]], 2),
        noise=torch.cat([noise, tilt], 3),
        target=torch.cat([balance, torch.where(holds, measured, 0.0)], 1),
        variance=torch.cat([torch.zeros_like(balance), torch.where(holds, measured_sd**2, 0.0)], 1),
        used=torch.cat([every, every, holds], 1).to(packed.dtype),
    )
