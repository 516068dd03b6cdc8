# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The meta-learnt features Phi_net: a small network from an observation to columns of the rows."""

import torch
from torch import Tensor, nn


class Layer(nn.Linear):
    """A linear layer whose TorchScript is the same in every process.

    torch writes a module's constants in the order of a set of names, which each process draws anew.
    """

    __constants__: list[str] = []  # noqa: RUF012 (not a ClassVar in torch)


class NetFeatures(nn.Module):
    """tanh network from slip, sinkage, contact angles and pitch to ``width`` columns in every row.

    The rows are those of ``terrain_estimator.model.rows``; the imu row has the columns of the
    velocity row, because both are the same force. Columns are in units of ``row_scale``, the size
    that an effect may have in a row. A net with columns in the moment rows has A + 4 distinct rows,
    one without them A + 2.
    """

    input_scale: Tensor
    row_scale: Tensor

    def __init__(
        self, axles: int, columns: int, hidden: int, sinkage_scale: float, row_scale: Tensor
    ) -> None:
        """Build the net of ``columns`` columns with two layers of ``hidden`` units.

        ``sinkage_scale`` [m] makes the sinkage of order one; ``row_scale`` [A + 4] or [A + 2] is in
        the units of the rows.
        """
        super().__init__()
        self.columns = columns
        self.axles, self.rows = axles, row_scale.shape[0]
        scale = torch.cat(
            [
                torch.full((axles,), 0.3),
                torch.full((axles,), sinkage_scale),
                torch.full((axles + 1,), 0.1),
            ]
        )
        self.register_buffer("input_scale", scale.to(torch.float64))
        self.register_buffer("row_scale", row_scale)
        self.layers = nn.Sequential(
            Layer(3 * axles + 1, hidden, dtype=torch.float64),
            nn.Tanh(),
            Layer(hidden, hidden, dtype=torch.float64),
            nn.Tanh(),
            Layer(hidden, self.rows * columns, dtype=torch.float64),
        )

    def forward(self, slip: Tensor, sinkage: Tensor, angle: Tensor, pitch: Tensor) -> Tensor:
        """Return columns [..., A + 5, columns] of inputs [..., A] and pitch [..., 1]."""
        columns, before = self.distinct(slip, sinkage, angle, pitch), self.axles + 2
        if self.rows == before:
            return torch.cat(
                [columns, columns[..., :1, :], torch.zeros_like(columns[..., :2, :])], dim=-2
            )
        return torch.cat(
            [columns[..., :before, :], columns[..., :1, :], columns[..., before:, :]], dim=-2
        )

    def distinct(self, slip: Tensor, sinkage: Tensor, angle: Tensor, pitch: Tensor) -> Tensor:
        """Return the columns of distinct rows alone; that of the velocity comes first."""
        x = torch.cat([slip, sinkage, angle, pitch], dim=-1) / self.input_scale
        return self.layers(x).unflatten(-1, [self.rows, self.columns]) * self.row_scale.unsqueeze(
            -1
        )
