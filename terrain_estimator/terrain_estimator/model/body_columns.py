# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Columns of parameters of a rover's body, in the place of a net's."""

from torch import Tensor, nn


class BodyColumns(nn.Module):
    """Constant columns with the methods of :class:`~terrain_estimator.model.net.NetFeatures`."""

    table: Tensor

    def __init__(self, table: Tensor) -> None:
        """Take the columns [R, K] of K parameters in all rows."""
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
