# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tracks on the ground: how many wheels have rolled there before.

On turns wheels run beside the tracks of those before, so that a part of their width is on fresh
ground.
"""

import torch
from torch import Tensor

NEAREST = 1e-3
"""[m] Way below which a wheel counts as standing."""
LONGEST = 1000
"""Places of a wheel that are remembered: a rover on the spot never leaves its tracks."""


class Tracks:
    """Where the wheels of a batch of rovers have rolled since the start."""

    def __init__(self, places: Tensor, back: Tensor, width: float) -> None:
        """Begin with wheels of ``width`` [m] at ``places`` [batch, wheels, 2] [m].

        Each has come straight from where it is further by ``back`` [batch, 2] [m].
        """
        self._width, self._far = width, 2.0 * float(back.norm(dim=-1).max())
        self._trail = [places + back.unsqueeze(1), places]

    def remember(self, places: Tensor) -> None:
        """Go on to ``places`` [batch, wheels, 2] [m]; what is far behind every rover is left."""
        if float((places - self._trail[-1]).norm(dim=-1).max()) < NEAREST:
            return
        self._trail.append(places)
        middle = places.mean(1, keepdim=True)
        while len(self._trail) > LONGEST or bool(
            ((self._trail[1] - middle).norm(dim=-1) > self._far).all()
        ):
            del self._trail[0]

    def passes(self, places: Tensor) -> Tensor:
        """Return how many other wheels rolled at ``places`` [batch, wheels, 2] before.

        Shape [batch, wheels]; a track that a wheel covers in part counts by that part of its width.
        A wheel's own track counts for nothing: it lies behind, but for one that backs out.
        """
        trail = torch.stack(self._trail, 2)  # [batch, wheels, T, 2]
        start, way = trail[:, :, :-1], trail.diff(dim=2)
        off = places[:, :, None, None] - start.unsqueeze(1)  # [batch, wheels, others, T - 1, 2]
        way = way.unsqueeze(1)
        share = (off * way).sum(-1) / way.square().sum(-1).clamp(min=1e-12)
        beside = (off - share.clamp(0.0, 1.0).unsqueeze(-1) * way).norm(dim=-1).amin(-1)
        overlap = (1.0 - beside / self._width).clamp(min=0.0)
        return overlap.sum(-1) - overlap.diagonal(dim1=-2, dim2=-1)
