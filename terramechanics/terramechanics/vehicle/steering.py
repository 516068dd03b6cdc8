# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Wheel commands for a wanted twist: skid steering, and wheels that are steered.

They are those of wheels that roll without slip. A twist is v_x, v_y [m/s] of the body's origin and
the yaw rate [rad/s], [..., 3]. Results are rim speeds r w [m/s] and steering angles [rad], positive
to the left, [..., wheels] each.
"""

import math

import torch
from torch import Tensor

from terramechanics.vehicle.chassis import Chassis

STILL = 1e-12
"""[m/s] A hub that is to move more slowly keeps its wheel straight."""


def skid_command(chassis: Chassis, twist: Tensor) -> tuple[Tensor, Tensor]:
    """Return the command of wheels that cannot be steered; v_y of the twist counts for nothing."""
    y = torch.tensor(chassis.wheel_y, dtype=twist.dtype)
    rim = twist[..., :1] - twist[..., 2:] * y
    return rim, torch.zeros_like(rim)


def steered_command(chassis: Chassis, twist: Tensor) -> tuple[Tensor, Tensor]:
    """Return the command of wheels that are all steered, each by no more than a right angle.

    So a wheel turns backwards rather than around. Covers point turns, crabbing and backing, and by
    :func:`ackermann_twist` rovers whose rear wheels are fixed.
    """
    x = torch.tensor(chassis.wheel_x, dtype=twist.dtype)
    y = torch.tensor(chassis.wheel_y, dtype=twist.dtype)
    along = twist[..., :1] - twist[..., 2:] * y
    left = twist[..., 1:2] + twist[..., 2:] * x
    speed = torch.hypot(along, left)
    angle = torch.where(speed > STILL, torch.atan2(left, along), 0.0)
    back = angle.abs() > 0.5 * math.pi + 1e-9
    turned = angle - torch.sign(angle) * math.pi
    return torch.where(back, -speed, speed), torch.where(back, turned, angle)


def ackermann_twist(chassis: Chassis, speed: Tensor, yaw_rate: Tensor) -> Tensor:
    """Return the twist [..., 3] whose centre of turn lies on the line of the rearmost axle.

    ``speed`` [m/s] and ``yaw_rate`` [rad/s] are [...]. The wheels of that axle then stay straight.
    """
    rear = min(chassis.wheel_x)
    return torch.stack([speed, -rear * yaw_rate, yaw_rate], -1)


def partly_steered_command(
    chassis: Chassis, speed: Tensor, yaw_rate: Tensor, steered: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the command of wheels of which those with a flag in ``steered`` [wheels] are steered.

    The others stay straight, and the centre of turn lies beside their middle: where they are of one
    axle none slides aside. ``speed`` [m/s] and ``yaw_rate`` [rad/s] are [...].
    """
    straight = torch.tensor(chassis.wheel_x, dtype=speed.dtype)[~steered]
    beside = straight.mean() if len(straight) else torch.zeros((), dtype=speed.dtype)
    twist = torch.stack([speed, -beside * yaw_rate, yaw_rate], -1)
    rim, angle = steered_command(chassis, twist)
    return torch.where(steered, rim, skid_command(chassis, twist)[0]), torch.where(
        steered, angle, 0.0
    )
