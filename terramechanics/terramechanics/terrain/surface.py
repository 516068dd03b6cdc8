# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Uneven ground in two directions: its height above a plane, and its gradient, in batches."""

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor


class Surface(Protocol):
    """Ground above a plane."""

    def shape(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """Return height [batch, n] [m] and gradient [batch, n, 2] [1] at ``places`` [batch, n, 2].

        Places are x and y [m] along the plane, heights across it.
        """
        ...


@dataclass(frozen=True, slots=True)
class Level:
    """The plane itself."""

    def shape(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """Return zero, and zero; shapes as of :class:`Surface`."""
        return torch.zeros_like(places[..., 0]), torch.zeros_like(places)


@dataclass(frozen=True, slots=True)
class Waves:
    """A sum of plane waves: height(p) = SUM (a_j / |k_j|) sin(k_j p + f_j).

    ``amplitude`` [batch, waves] [1] is of the slope, ``wave`` [batch, waves, 2] [rad/m] is k and
    ``phase`` [batch, waves] [rad] f.
    """

    amplitude: Tensor
    wave: Tensor
    phase: Tensor

    def shape(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """Return height and gradient; shapes as of :class:`Surface`."""
        angle = places @ self.wave.mT + self.phase.unsqueeze(-2)  # [batch, n, waves]
        length = self.wave.norm(dim=-1)
        height = torch.sin(angle) @ (self.amplitude / length).unsqueeze(-1)
        gradient = torch.cos(angle) @ (
            (self.amplitude / length).unsqueeze(-1) * self.wave
        )  # [batch, n, 2]
        return height.squeeze(-1), gradient


WAVES = 6
"""Number of waves of random ground."""
EXTENT, PLACES = 10.0, 1000
"""[m], Places in which random ground is measured."""
WAVELENGTHS = (2.5, 9.0)
"""[m] Shortest and longest wavelength of random ground, as of the hills of profile.py."""


def random_waves(
    batch: int,
    steepest: float,
    generator: torch.Generator,
    lengths: tuple[float, float] = WAVELENGTHS,
) -> Waves:
    """Draw ground whose waves run anywhere.

    The steepest of PLACES places within EXTENT of the origin leans by 40 to 100 % of ``steepest``
    [rad]. ``lengths`` [m] are the shortest and the longest wavelength.
    """

    def uniform(low: float, high: float, columns: int) -> Tensor:
        unit = torch.rand(batch, columns, generator=generator, dtype=torch.float64)
        return low + (high - low) * unit

    share = uniform(0.2, 1.0, WAVES)
    slope = math.tan(steepest) * uniform(0.4, 1.0, 1)
    number = 2.0 * math.pi / uniform(*lengths, WAVES)
    direction = uniform(0.0, 2.0 * math.pi, WAVES)
    wave = number.unsqueeze(-1) * torch.stack([torch.cos(direction), torch.sin(direction)], -1)
    drawn = Waves(share, wave, uniform(0.0, 2.0 * math.pi, WAVES))
    places = uniform(-EXTENT, EXTENT, 2 * PLACES).view(batch, PLACES, 2)
    found = drawn.shape(places)[1].norm(dim=-1).amax(1, keepdim=True)
    return Waves(share * slope / found, wave, drawn.phase)
