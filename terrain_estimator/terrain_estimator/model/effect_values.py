# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Values of named effects as parameters: their prior, and the change of whole rows with them."""

import torch
from torch import Tensor, nn

from terrain_estimator.model.rows import Rows

NEAR = 0.01
"""[prior deviations] Move of an effect that needs no other rows."""


class ValuePrior(nn.Module):
    """Gaussian prior of the V values of the effects, and the range of their laws, [V] each."""

    mean: Tensor
    sd: Tensor
    low: Tensor
    high: Tensor

    def __init__(self, mean: Tensor, sd: Tensor, low: Tensor, high: Tensor) -> None:
        super().__init__()
        for name, value in (("mean", mean), ("sd", sd), ("low", low), ("high", high)):
            self.register_buffer(name, value)

    def within(self, deviations: Tensor, first: int) -> Tensor:
        """Return ``deviations`` [M + V], those of values from ``first`` on inside their ranges.

        Beyond the end of a range the rows are continued linearly.
        """
        low, high = (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd
        return torch.cat(
            [deviations[:first], torch.minimum(torch.maximum(deviations[first:], low), high)]
        )

    def from_deviations(self, deviations: Tensor, first: int) -> Tensor:
        """Return the values [1, V] of ``deviations`` [M + V], which begin at ``first``."""
        return (self.mean + self.sd * deviations[first:]).unsqueeze(0)

    def varied(self, values: Tensor) -> Tensor:
        """Return ``values`` [1, V] with one each larger by a thousandth of its deviation [V, V]."""
        return values + 1e-3 * torch.diag(self.sd)


def with_changes(rows: Rows, varied: Rows) -> Rows:
    """Return ``rows`` [C, n, ...] with their changes by V values.

    The rows ``varied`` [1, V n, ...] are by a thousandth of a deviation of each. The change of a
    target stands, with the other sign, in the constant column.
    """
    n, r = rows.target.shape
    alike = (varied.used.view(-1, n, r) == rows.used).to(rows.used.dtype).unsqueeze(-1)
    by_target = 1e3 * (varied.target.view(-1, n, r) - rows.target)
    features = 1e3 * (varied.features.view(-1, n, r, 3) - rows.features[0])
    features = (
        torch.cat([features[..., :2], (features[..., 2] - by_target).unsqueeze(-1)], -1) * alike
    )
    noise = (
        1e3
        * (varied.noise.view(-1, n, r, rows.noise.shape[3], 3) - rows.noise[0])
        * alike.unsqueeze(-1)
    )
    return Rows(
        torch.cat([rows.features, features]),
        torch.cat([rows.noise, noise]),
        rows.target,
        rows.variance,
        rows.used,
        rows.taken,
    )
