# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Terrain profiles: height, slope and curvature of the ground along the track, in batches."""

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

Shape = tuple[Tensor, Tensor, Tensor]
"""Height [m], slope dh/dx [1] and second derivative [1/m] at the same places."""


class Profile(Protocol):
    """The ground along the track."""

    def shape(self, x: Tensor) -> Shape:
        """Return height, slope and second derivative at the places ``x`` [batch, ...] [m]."""
        ...


@dataclass(frozen=True, slots=True)
class Flat:
    """Level ground at height 0."""

    def shape(self, x: Tensor) -> Shape:
        """Return height, slope and second derivative at ``x`` [batch, ...] [m]."""
        zero = torch.zeros_like(x)
        return zero, zero, zero


@dataclass(frozen=True, slots=True)
class Ramp:
    """Level ground up to ``start`` [m], then a ``grade`` [rad], blended over ``blend`` [m]."""

    grade: float
    start: float = 2.0
    blend: float = 1.0

    def shape(self, x: Tensor) -> Shape:
        """Return height, slope and second derivative; the slope rises as u^2 (3 - 2 u)."""
        u = ((x - self.start) / self.blend).clamp(0.0, 1.0)
        beyond = (x - self.start - self.blend).clamp(min=0.0)
        slope = math.tan(self.grade)
        height = slope * (self.blend * (u**3 - u**4 / 2.0) + beyond)
        return height, slope * (3.0 * u**2 - 2.0 * u**3), slope * 6.0 * u * (1.0 - u) / self.blend


@dataclass(frozen=True, slots=True)
class StepProfile:
    """A rounded step of height ``rise`` [m] and ``length`` [m] that starts at ``start`` [m]."""

    rise: float
    start: float = 2.0
    length: float = 1.0

    def shape(self, x: Tensor) -> Shape:
        """Return height, slope and second derivative; height is rise (u - sin(2 pi u) / (2 pi))."""
        u = ((x - self.start) / self.length).clamp(0.0, 1.0)
        angle = 2.0 * math.pi * u
        height = self.rise * (u - torch.sin(angle) / (2.0 * math.pi))
        slope = self.rise / self.length * (1.0 - torch.cos(angle))
        return height, slope, self.rise / self.length**2 * 2.0 * math.pi * torch.sin(angle)


@dataclass(frozen=True, slots=True)
class Sampled:
    """Slopes at equal distances, joined by cubics.

    Before the first and behind the last the slope is constant.

    ``slope`` [batch, places] [1] and ``curvature`` [batch, places] [1/m], its derivative, at
    ``start`` [m] + k ``spacing`` [m].
    """

    slope: Tensor
    curvature: Tensor
    start: float
    spacing: float

    def shape(self, x: Tensor) -> Shape:
        """Return height, slope and second derivative; slopes are Hermite's cubics."""
        last = self.slope.shape[1] - 1
        place = (x.reshape(x.shape[0], -1) - self.start) / self.spacing
        index = place.floor().clamp(0.0, last - 1.0).long()
        u = (place - index).clamp(0.0, 1.0)
        first, second = self.slope.gather(1, index), self.slope.gather(1, index + 1)
        bend, after = (
            self.spacing * self.curvature.gather(1, index),
            self.spacing * self.curvature.gather(1, index + 1),
        )
        rise = second - first
        square, cube = 3.0 * rise - 2.0 * bend - after, bend + after - 2.0 * rise
        slope = first + u * (bend + u * (square + u * cube))
        curvature = (bend + u * (2.0 * square + 3.0 * u * cube)) / self.spacing
        whole = 0.5 * (self.slope[:, 1:] + self.slope[:, :-1]) - self.spacing / 12.0 * torch.diff(
            self.curvature
        )
        below = torch.nn.functional.pad(torch.cumsum(whole, 1), (1, 0)).gather(1, index)
        height = self.spacing * (
            below + u * (first + u * (bend / 2.0 + u * (square / 3.0 + u * cube / 4.0)))
        )
        beyond = place - index - u
        height = height + self.spacing * beyond * slope
        curvature = torch.where(beyond == 0.0, curvature, 0.0)
        return height.reshape(x.shape), slope.reshape(x.shape), curvature.reshape(x.shape)


@dataclass(frozen=True, slots=True)
class Hills:
    """A mean slope and a sum of sines: slope(x) = mean + SUM a_j cos(k_j x + p_j).

    ``mean`` [batch, 1] [1]; ``amplitude`` [1], ``wavenumber`` [rad/m] and ``phase`` [rad] are
    [batch, sines].
    """

    mean: Tensor
    amplitude: Tensor
    wavenumber: Tensor
    phase: Tensor

    def shape(self, x: Tensor) -> Shape:
        """Return height, slope and second derivative at ``x`` [batch, ...] [m]."""
        extra = x.dim() - 1
        mean = self.mean.reshape(self.mean.shape[:1] + (1,) * extra)
        size = self.phase.shape[:1] + (1,) * extra + self.phase.shape[1:]
        wavenumber, amplitude = self.wavenumber.reshape(size), self.amplitude.reshape(size)
        angle = wavenumber * x.unsqueeze(-1) + self.phase.reshape(size)
        sine, cosine = torch.sin(angle), torch.cos(angle)
        height = mean * x + (amplitude / wavenumber * sine).sum(-1)
        return height, mean + (amplitude * cosine).sum(-1), -(amplitude * wavenumber * sine).sum(-1)


SINES = 4
"""Number of sines of random hills."""
WAVELENGTHS = (2.5, 9.0)
"""[m] Shortest and longest wavelength of random hills."""
STEEPEST = math.radians(5.0)
"""[rad] Bound of the slope of random hills, the mean slope included."""
MEAN_SLOPE = math.radians(2.0)
"""[rad] Bound of the mean slope of random hills."""


def random_hills(batch: int, capability: Tensor, generator: torch.Generator) -> Hills:
    """Draw hills of four sines each, no steeper than STEEPEST or half of ``capability`` [batch].

    The capability is drawbar pull / weight [1].

    The mean slope is uniform in +-MEAN_SLOPE; the sines together take between 40 and 100 % of what
    is left to STEEPEST.
    """

    def uniform(low: float, high: float, columns: int) -> Tensor:
        unit = torch.rand(batch, columns, generator=generator, dtype=torch.float64)
        return low + (high - low) * unit

    mean = uniform(-MEAN_SLOPE, MEAN_SLOPE, 1)
    share = uniform(0.2, 1.0, SINES)
    sines = share / share.sum(-1, keepdim=True) * uniform(0.4, 1.0, 1) * (STEEPEST - mean.abs())
    wavenumber = 2.0 * math.pi / uniform(*WAVELENGTHS, SINES)
    phase = uniform(0.0, 2.0 * math.pi, SINES)
    steepest = math.tan(STEEPEST)
    scale = (capability.clamp(min=0.0) / 2.0).clamp(max=steepest).unsqueeze(-1) / steepest
    return Hills(mean * scale, sines * scale, wavenumber, phase)
