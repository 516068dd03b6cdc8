# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Ground whose strength and stiffness differ from place to place in two directions, in batches."""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

MOST = 2.5
"""Deviations by which a factor differs from 1 at most."""


class GroundField(Protocol):
    """What the ground is at a place, of what it is in the mean."""

    def factors(self, places: Tensor) -> Tensor:
        """Return factors [batch, n, 3] of c, tan phi and stiffness at ``places`` [batch, n, 2].

        Places are x and y [m] along the plane. The stiffness is k_c and k_phi together.
        """
        ...


@dataclass(frozen=True, slots=True)
class Uniform:
    """The same ground everywhere."""

    def factors(self, places: Tensor) -> Tensor:
        """Return ones; shapes as of :class:`GroundField`."""
        return torch.ones_like(places[..., :1]).expand(*places.shape[:-1], 3)


@dataclass(frozen=True, slots=True)
class Mesh:
    """Factors at the nodes of a square mesh about the origin, and linear between them.

    ``nodes`` [batch, m, m, 3] are ``spacing`` [m] apart; beyond the last one its value holds.
    """

    nodes: Tensor
    spacing: float

    def factors(self, places: Tensor) -> Tensor:
        """Return what lies between four nodes; shapes as of :class:`GroundField`."""
        last = self.nodes.shape[1] - 1
        place = (places / self.spacing + 0.5 * last).clamp(0.0, last)
        corner = place.floor().clamp(max=last - 1)
        ahead, left = (place - corner).unsqueeze(-1).unbind(-2)
        x, y = corner.long().unbind(-1)
        drive = torch.arange(len(x)).unsqueeze(-1)
        near = (1.0 - left) * self.nodes[drive, x, y] + left * self.nodes[drive, x, y + 1]
        far = (1.0 - left) * self.nodes[drive, x + 1, y] + left * self.nodes[drive, x + 1, y + 1]
        return (1.0 - ahead) * near + ahead * far


def random_mesh(
    batch: int, sd: float, spacing: float, extent: float, generator: torch.Generator
) -> Mesh:
    """Return ground that deviates by ``sd`` [1], independently from node to node.

    Nodes are ``spacing`` [m] apart, as far as ``extent`` [m] from the origin each way.
    """
    count = 2 * round(extent / spacing) + 1
    drawn = torch.randn(batch, count, count, 3, generator=generator, dtype=torch.float64)
    return Mesh(1.0 + sd * drawn.clamp(-MOST, MOST), spacing)
