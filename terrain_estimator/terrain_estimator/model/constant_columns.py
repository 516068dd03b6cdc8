# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Columns that stand in the place of a net's: those of a rover's body, or none."""

import torch
from torch import Tensor, nn

OF_BODY = 2
"""Number of parameters before those of the torques: the centre of mass to the left, the roll."""


def observed_columns(
    turned: Tensor, torque: Tensor, rim: Tensor, columns: int, rows: int, of_body: int = OF_BODY
) -> Tensor:
    """Return the parts [n, R, K] of the columns that depend on the observation.

    A centre of mass to the left changes the last row by ``turned`` [n]. Torques [n, W] may share
    errors: a share of the measured ``torque``, then a friction with the sign of the ``rim``'s speed
    [n, W].
    """
    found = nn.functional.pad(turned.view(-1, 1, 1), [0, columns - 1, rows - 1, 0])
    behind = rows - 2 - torque.shape[1]
    if columns > of_body:
        gain = [of_body, columns - 1 - of_body, 2, behind]
        found = found + nn.functional.pad(torque.unsqueeze(2), gain)
    if columns > of_body + 1:
        against = torch.sign(rim).unsqueeze(2)
        found = found + nn.functional.pad(against, [columns - 1, 0, 2, behind])
    return found


class ConstantColumns(nn.Module):
    """Constant columns with the methods of :class:`~terrain_estimator.model.net.NetFeatures`."""

    table: Tensor

    def __init__(self, table: Tensor) -> None:
        """Take the columns [R, K] of K parameters in all rows; K may be 0."""
        super().__init__()
        self.columns = table.shape[1]
        self.register_buffer("table", table)

    def forward(self, slip: Tensor, sinkage: Tensor, angle: Tensor, pitch: Tensor) -> Tensor:
        """Return the columns [n, R, K] of n observations."""
        del sinkage, angle, pitch
        return self.table.expand(slip.shape[0], -1, -1)

    def distinct(self, slip: Tensor, sinkage: Tensor, angle: Tensor, pitch: Tensor) -> Tensor:
        """Return the columns [R, K] of one observation; that of the velocity comes first."""
        del slip, sinkage, angle, pitch
        return self.table
