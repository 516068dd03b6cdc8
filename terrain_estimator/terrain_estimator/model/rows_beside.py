# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The two last rows of a model by wheel, of how the body moves beside, and their sources of noise.

No instant measures dv_y/dt and domega/dt, see ``body_motion``. An instant's rows have the slopes of
the block; those of the block are weighted so that their mean has them.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.model.body_motion import BodyMotion, block_slopes
from terrain_estimator.model.packing import PackedView
from terrain_estimator.model.rows import Frame, Rows


class BodyBeside(NamedTuple):
    """The numbers of a rover that these rows need."""

    axle_x: Tensor  # [W] [m] of the wheels
    centre_x: Tensor  # [] [m] of the centre of mass
    yaw_inertia: Tensor  # [] [s^2] over m g b
    gravity: float  # [m/s^2]


def velocity_beside(body: BodyBeside, motion: BodyMotion) -> Tensor:
    """Return the lateral velocity [n] [m/s] of the centre of mass."""
    return motion.lateral + body.centre_x * motion.yaw_rate


def pulled_beside(body: BodyBeside, view: PackedView, motion: BodyMotion) -> Tensor:
    """Return omega v_x + g sin(roll) [n] [m/s^2]."""
    return motion.yaw_rate * view.velocity + body.gravity * torch.sin(motion.roll)


def slopes_beside(body: BodyBeside, view: PackedView, motion: BodyMotion) -> Tensor:
    """Return the targets [n] [m/s^2] whose mean is that of the lateral velocity in the block."""
    slope, share = block_slopes(view.step)
    return slope * velocity_beside(body, motion) + share * pulled_beside(body, view, motion)


def level_share(body: BodyBeside, view: PackedView, motion: BodyMotion) -> Tensor:
    """Return the share [n] of gravity across the body's plane."""
    turned = motion.yaw_rate * velocity_beside(body, motion) / body.gravity
    nose, side = torch.sin(view.pitch) + turned, torch.sin(motion.roll)
    return torch.sqrt((1.0 - nose * nose - side * side).clamp(min=0.0))


def in_last(lateral: Tensor, turning: Tensor, rows: int) -> Tensor:
    """Return values [n, S] of S sources in the last two of R rows, [n, R, S, 3]."""
    both = torch.stack([lateral, turning], 1).unsqueeze(-1)
    return nn.functional.pad(both, [2, 0, 0, 0, rows - 2, 0])


def with_motion(
    body: BodyBeside,
    rows: Rows,
    frame: Frame,
    motion: BodyMotion,
    by_left: Tensor,
    by_bank: Tensor,
) -> Rows:
    """Return the rows with the errors of lateral velocity, yaw rate and roll as sources.

    ``by_left`` [n, W, 4, 3] is the change of the forces by the hubs' velocity to the left,
    ``by_bank`` [n, W, R, 3] that of the rows by the bank below each wheel, W sources more.
    """
    acting = frame.levers[:, :, 0] @ by_left  # [n, W, R, 3]
    of_lateral = acting.sum(1) * motion.lateral_sd[:, None, None]
    turned = (acting * body.axle_x[:, None, None]).sum(1)
    of_yaw = turned * motion.yaw_rate_sd[:, None, None]
    moved = torch.stack([of_lateral, of_yaw, torch.zeros_like(of_yaw)], 2)  # [n, R, 3, 3]
    # the change of a row is less that of its target
    none = torch.zeros_like(motion.roll)
    level = body.gravity * torch.cos(motion.roll) * motion.roll_sd
    lateral = torch.stack([none, frame.measured.velocity * motion.yaw_rate_sd, level], 1)
    moved = moved - in_last(lateral, torch.zeros_like(lateral), moved.shape[1])
    moved = torch.cat([moved, by_bank.transpose(1, 2)], 2)
    sources = nn.functional.pad(
        moved.unsqueeze(0), [0, 0, 0, 0, 0, 0, 0, 0, 0, rows.noise.shape[0] - 1]
    )
    noise = torch.cat([rows.noise, sources], 3)
    return Rows(rows.features, noise, rows.target, rows.variance, rows.used, rows.taken)


def weight_of_slopes(share: Tensor, rows: int) -> Tensor:
    """Return the weights [n, R, 1] of R rows, of the last two n b [n] of :func:`block_slopes`."""
    last = share.unsqueeze(1).expand(-1, 2)
    return torch.cat([torch.ones_like(last[:, :1]).expand(-1, rows - 2), last], 1).unsqueeze(-1)


def of_slopes(
    body: BodyBeside, rows: Rows, frame: Frame, motion: BodyMotion, variance: float
) -> Rows:
    """Return the rows of a block whose mean over it has the slopes in the last two.

    These have the ``variance`` of moment rows beside their sources.
    """
    slope, share = block_slopes(frame.measured.step)
    return weighted_by(body, rows, frame, motion, variance, slope, share)


def weighted_by(
    body: BodyBeside,
    rows: Rows,
    frame: Frame,
    motion: BodyMotion,
    variance: float,
    slope: Tensor,
    share: Tensor,
) -> Rows:
    """Return what :func:`of_slopes` does, with n w and n b [n] of :func:`block_slopes` given."""
    view, count = frame.measured, rows.target.shape[1]
    weight = weight_of_slopes(share, count)
    lateral = slope * velocity_beside(body, motion) + share * pulled_beside(body, view, motion)
    turning = slope * motion.yaw_rate * body.yaw_inertia
    target = torch.cat([rows.target[:, : count - 2], lateral.unsqueeze(1), turning.unsqueeze(1)], 1)
    none = torch.zeros_like(slope)
    by_yaw = slope * motion.yaw_rate_sd
    read = in_last(
        torch.stack([slope * motion.lateral_sd, by_yaw * body.centre_x, none], 1),
        torch.stack([none, by_yaw * body.yaw_inertia, none], 1),
        count,
    )
    noise = rows.noise * weight.unsqueeze(-1)
    banks = frame.measured.slip.shape[1]  # the last sources, of which nothing is read
    read = nn.functional.pad(
        read.unsqueeze(0),
        [0, 0, noise.shape[3] - 3 - banks, banks, 0, 0, 0, 0, 0, noise.shape[0] - 1],
    )
    own = nn.functional.pad(rows.variance[:, : count - 2], [0, 2], value=variance)
    features = rows.features * weight
    return Rows(features, noise - read, target, own, rows.used, rows.taken)
