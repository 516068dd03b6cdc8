# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tracks on the ground: how many wheels have rolled there before, and how deep they are.

On turns wheels run beside the tracks of those before, so that a part of their width is on fresh
ground.
"""

from functools import partial

import torch
from torch import Tensor

from terramechanics.contact.trails import beside, covered, passed

NEAREST = 1e-3
"""[m] Way below which a wheel counts as standing."""
LONGEST = 1000
"""Places of a wheel that are remembered: a rover on the spot never leaves its tracks."""


class Tracks:
    """Where the wheels of a batch of rovers have rolled since the start."""

    def __init__(
        self, places: Tensor, back: Tensor, width: float, bottom: Tensor | None = None
    ) -> None:
        """Begin with wheels of ``width`` [m] at ``places`` [batch, wheels, 2] [m].

        Each has come straight from where it is further by ``back`` [batch, 2] [m], and has left
        the ground at ``bottom`` [batch, wheels] [m] below where it was, 0 by default.
        """
        self._width, self._far = width, 2.0 * float(back.norm(dim=-1).max())
        self._trail = [places + back.unsqueeze(1), places]
        self._bottoms = [torch.zeros_like(places[..., 0]) if bottom is None else bottom]

    def remember(self, places: Tensor, bottom: Tensor | None = None) -> None:
        """Go on to ``places`` [batch, wheels, 2] [m]; what is far behind every rover is left.

        ``bottom`` [batch, wheels] [m] is how far the ground that the wheels left on the way is
        below where it was; by default as before.
        """
        if float((places - self._trail[-1]).norm(dim=-1).max()) < NEAREST:
            return
        self._trail.append(places)
        self._bottoms.append(self._bottoms[-1] if bottom is None else bottom)
        middle = places.mean(1, keepdim=True)
        while len(self._trail) > LONGEST or bool(
            ((self._trail[1] - middle).norm(dim=-1) > self._far).all()
        ):
            del self._trail[0], self._bottoms[0]

    def passes(self, places: Tensor) -> Tensor:
        """Return how many other wheels rolled at ``places`` [batch, wheels, 2] before.

        Shape [batch, wheels]; a track that a wheel covers in part counts by that part of its width.
        A wheel's own track counts for nothing: it lies behind, but for one that backs out.
        """
        distance, _ = self._beside(places)
        overlap = covered(distance.amin(-1), self._width)
        return overlap.sum(-1) - overlap.diagonal(dim1=-2, dim2=-1)

    def depth(self, places: Tensor) -> Tensor:
        """Return how deep the ground right before wheels at ``places`` is [m].

        Shapes [batch, wheels, 2] and [batch, wheels]. It is that of the deepest track, by the part
        of the width that is in it. A wheel's own track counts where the wheel backs over it.
        """
        distance, share = self._beside(places)
        stretches = distance.shape[-1]
        way = torch.stack(self._trail, 2).diff(dim=2).norm(dim=-1).unsqueeze(1)
        behind = (1.0 - share) * way < NEAREST  # of the place: it was left just now, or before
        own = torch.eye(places.shape[1], dtype=torch.bool).unsqueeze(-1)
        distance = torch.where(own & behind, torch.inf, distance)
        least = distance.amin(-1, keepdim=True)
        there = passed(distance, share, least, NEAREST).to(torch.int8)
        nearest = (stretches - 1 - there.flip(-1).argmax(-1)).unsqueeze(-1)
        overlap = covered(least.squeeze(-1), self._width)
        bottoms = torch.stack(self._bottoms, 2).unsqueeze(1).expand_as(distance)
        return (overlap * bottoms.gather(-1, nearest).squeeze(-1)).amax(-1)

    def _beside(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """Return how far ``places`` are from every stretch, and where along it.

        Both are [batch, wheels, wheels that rolled before, stretches].
        """
        trail = torch.stack(self._trail, 2)  # [batch, wheels, T, 2]
        start, way = trail[:, :, :-1], trail.diff(dim=2)
        off = places[:, :, None, None] - start.unsqueeze(1)  # [batch, wheels, others, T - 1, 2]
        return beside(off, way.unsqueeze(1), partial(torch.norm, dim=-1))
