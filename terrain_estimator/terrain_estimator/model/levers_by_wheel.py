# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the forces of single wheels do in the rows of a model by wheel.

The ground below a wheel leans along its heading by the contact angle, measured or supposed, and
aside by its bank, which nobody measures: it turns the load of the wheel to the other side. So banks
are sources of noise. Uneven ground leans as far aside as it does along: their deviation follows
from the contact angles.
"""

import torch
from torch import Tensor, nn

from terrain_estimator.model.packing import PackedView
from terramechanics.vehicle.suspension import Geometry
from terramechanics.vehicle.wheel_balances import bank_balances, wheel_balances

LASTING = 6.0
"""[1] Deviation that a bank counts with, over its own: it stays, and noise is new each time.

It is the root of the readings at 10 Hz in 3.6 s.
"""
STATED = 3.0
"""[1] Deviation that is stated for supposed contact angles over the usual one, for the same reason.

See docs/bring_your_own_sensors.md.
"""


def levers_by_wheel(
    view: PackedView, steering: Tensor, geometry: Geometry, side: Tensor, scale: Tensor
) -> Tensor:
    """Return the effect of N, T, M, Y of each wheel in each row [n, W, 2, R, 4].

    Then follows its change for one deviation of the contact angles. ``steering`` [n, W] [rad] is to
    the left, ``side`` [W] [m] y, and ``scale`` [3] that of forces along, up and of moments.
    """
    angle, angle_sd = view.contact_angle, view.contact_angle_sd
    body = wheel_balances(geometry, side, steering, angle, _joint_angle(view, geometry))
    deviation = torch.stack([torch.ones_like(angle_sd), angle_sd], 1)
    body = body * deviation.unsqueeze(2).unsqueeze(-1)  # [n, 2, 6 + J, W, 4]
    wheels = angle.shape[1]
    torque = nn.functional.pad(torch.eye(wheels, dtype=body.dtype).unsqueeze(-1), [2, 1])
    torques = torch.stack([torque, torch.zeros_like(torque)]).expand(body.shape[0], -1, -1, -1, -1)
    return _in_rows(body, torques, scale).permute(0, 3, 1, 2, 4)


def levers_of_banks(
    view: PackedView,
    steering: Tensor,
    geometry: Geometry,
    side: Tensor,
    scale: Tensor,
    lasting: float = LASTING,
    stated: float = STATED,
) -> Tensor:
    """Return the effect of N, T, M, Y in each row by one deviation of each bank [n, W, R, 4].

    Arguments as of :func:`levers_by_wheel`. Contact angles count by what they vary in the block
    beyond their noise, and by their deviation, which is large where they are supposed.
    """
    angle, angle_sd = view.contact_angle, view.contact_angle_sd
    varied = (angle * angle - angle_sd * angle_sd).mean().clamp(min=0.0)
    supposed = (angle_sd * angle_sd).mean(1) / (stated * stated)
    bank = lasting * torch.sqrt(varied + supposed)
    body = bank_balances(geometry, side, steering, _joint_angle(view, geometry))
    none = torch.zeros_like(body.narrow(1, 0, 1)).expand(-1, angle.shape[1], -1, -1)
    rows = _in_rows(body.unsqueeze(1), none.unsqueeze(1), scale).squeeze(1)
    return (rows * bank.view(-1, 1, 1, 1)).transpose(1, 2)


def _joint_angle(view: PackedView, geometry: Geometry) -> Tensor:
    """Return the angles of the passive joints [n, J] [rad], 0 where none is measured."""
    angle = torch.where(torch.isfinite(view.bogie_angle), view.bogie_angle, 0.0)
    return angle.unsqueeze(1).narrow(1, 0, geometry.carried.shape[0])


def _in_rows(body: Tensor, torques: Tensor, scale: Tensor) -> Tensor:
    """Return balances [n, k, 6 + J, W, 4] and torques [n, k, W, W, 4] as rows [n, k, R, W, 4]."""
    along, across, yaw, up, pitch, roll, of_joints = body.split_with_sizes(
        [1, 1, 1, 1, 1, 1, body.shape[2] - 6], 2
    )
    along = along * scale[0]
    moments = torch.cat([pitch, of_joints], 2) * scale[2:].unsqueeze(-1).unsqueeze(-1)
    across, yaw, roll = across * scale[0], yaw * scale[2], roll * scale[2]
    return torch.cat([along, up * scale[1], torques, along, moments, roll, across, yaw], 2)
