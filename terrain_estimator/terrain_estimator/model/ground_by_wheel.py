# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The ground below the wheels of a model by wheel: the same below all, or not."""

from torch import Tensor, nn

from terrain_estimator.model.body_motion import BodyMotion, block_slopes
from terrain_estimator.model.rows import ContactModel, Frame, Rows
from terrain_estimator.model.rows_beside import weight_of_slopes
from terrain_estimator.model.varying_ground import ground_sources, with_sources
from terramechanics.contact.rolling import WheelMotion, rolling_forces
from terramechanics.vehicle.wheel_balances import motion_across


class EvenGround(nn.Module):
    """Ground that is the same below all wheels."""

    def forward(
        self, rows: Rows, frame: Frame, motion: BodyMotion, contact: ContactModel, theta: Tensor
    ) -> Rows:
        """Return the ``rows`` of a block as they are."""
        del frame, motion, contact, theta
        return rows


class GroundByWheel(nn.Module):
    """Ground that is not the same below every wheel, see ``varying_ground``."""

    axle_x: Tensor

    def __init__(self, axle_x: Tensor, sd: float) -> None:
        """Take the places ahead of the wheels [W] [m] and the ground's deviation ``sd`` [1]."""
        super().__init__()
        self.sd = sd
        self.register_buffer("axle_x", axle_x)

    def forward(
        self, rows: Rows, frame: Frame, motion: BodyMotion, contact: ContactModel, theta: Tensor
    ) -> Rows:
        """Return the ``rows`` of a block with 3 W sources of noise behind the others.

        ``theta`` [3] is (c [kPa], tan phi, 1); the forces are those of the measured inputs.
        """
        at = frame.measured
        left = motion.lateral.unsqueeze(-1) + motion.yaw_rate.unsqueeze(-1) * self.axle_x
        moved = WheelMotion(*motion_across(at.slip, motion.rim, motion.steering, left))
        forces = rolling_forces(
            moved, at.sinkage, contact.constants, contact.radius, contact.width, contact.nodes
        )
        forces = forces * contact.column_unit
        sources = ground_sources(frame.levers.select(2, 0), forces, theta, self.sd)
        _, share = block_slopes(at.step)
        return with_sources(rows, sources * weight_of_slopes(share, rows.target.shape[1]))
