# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How the body of a model by wheel moves beside, and the slopes of what is read in a block.

No instant measures dv_y/dt and domega/dt. The least-squares slope of the n readings y_i of a block
is SUM_i w_i y_i with w_i = (t_i - mean t) / SUM (t - mean t)^2, and, as y_i is the start plus the
steps until i of the derivative a, SUM_l b_l a_l with b_l = step_l SUM_(i >= l) w_i, whatever a does
in the block.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terrain_estimator.model.packing import PackedView
from terramechanics.vehicle.wheel_places import STEEPEST_STEERING


class BodyMotion(NamedTuple):
    """How the body of n observations moves, and what turns its wheels, each [n] or [n, W]."""

    rim: Tensor  # [n, W] [m/s]
    steering: Tensor  # [n, W] [rad]
    lateral: Tensor  # [n] [m/s] of the body's origin, to the left
    lateral_sd: Tensor  # [n]
    yaw_rate: Tensor  # [n] [rad/s]
    yaw_rate_sd: Tensor  # [n]
    roll: Tensor  # [n] [rad]
    roll_sd: Tensor  # [n]


def body_motion(view: PackedView) -> BodyMotion:
    """Return the motion that stands where other layouts have wheel rates."""
    wheels = view.slip.shape[-1]
    rim, steering, scalars = view.wheel_rate.split_with_sizes([wheels, wheels, 6], -1)
    lateral, lateral_sd, yaw_rate, yaw_rate_sd, roll, roll_sd = scalars.unbind(-1)
    return BodyMotion(rim, steering, lateral, lateral_sd, yaw_rate, yaw_rate_sd, roll, roll_sd)


def moves(motion: BodyMotion, steepest: float = STEEPEST_STEERING) -> Tensor:
    """Return which wheels [..., W] have a known motion across."""
    known = torch.isfinite(motion.lateral + motion.yaw_rate + motion.roll).unsqueeze(-1)
    return known & (motion.rim.abs() > 0.0) & (motion.steering.abs() < steepest)


def safe_motion(motion: BodyMotion, usable: Tensor) -> BodyMotion:
    """Return the motion with harmless numbers for wheels [n, W] that are not usable."""
    known = usable.any(1)
    return BodyMotion(
        torch.where(usable, motion.rim, 1.0),
        torch.where(usable, motion.steering, 0.0),
        torch.where(known, motion.lateral, 0.0),
        torch.where(known, motion.lateral_sd, 0.0),
        torch.where(known, motion.yaw_rate, 0.0),
        torch.where(known, motion.yaw_rate_sd, 0.0),
        torch.where(known, motion.roll, 0.0),
        torch.where(known, motion.roll_sd, 0.0),
    )


def block_slopes(step: Tensor) -> tuple[Tensor, Tensor]:
    """Return n w and n b [n] of observations that cover ``step`` [n] [s] each."""
    count = step.shape[0]
    place = torch.arange(count)
    until = (place.unsqueeze(0) <= place.unsqueeze(1)).to(step.dtype)  # [n, n] 1 where l <= i
    time = until @ step
    apart = time - time.mean()
    weight = apart / (apart * apart).sum().clamp(min=1e-9)
    return count * weight, count * step * (weight @ until)
