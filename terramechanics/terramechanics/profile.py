# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Terrain profiles: the height of the ground along the track, with its slope and curvature, batched over episodes."""

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
        """Height, slope and second derivative at the horizontal places ``x`` [batch, ...] [m]."""
        ...


@dataclass(frozen=True, slots=True)
class Flat:
    """Level ground at height 0."""

    def shape(self, x: Tensor) -> Shape:
        """See Profile."""
        zero = torch.zeros_like(x)
        return zero, zero, zero


@dataclass(frozen=True, slots=True)
class Ramp:
    """Level ground up to ``start`` [m], then a constant ``grade`` [rad], blended over ``blend`` [m] of the track."""

    grade: float
    start: float = 2.0
    blend: float = 1.0

    def shape(self, x: Tensor) -> Shape:
        """See Profile. The slope rises as u^2 (3 - 2 u)."""
        u = ((x - self.start) / self.blend).clamp(0.0, 1.0)
        beyond = (x - self.start - self.blend).clamp(min=0.0)
        slope = math.tan(self.grade)
        height = slope * (self.blend * (u**3 - u**4 / 2.0) + beyond)
        return height, slope * (3.0 * u**2 - 2.0 * u**3), slope * 6.0 * u * (1.0 - u) / self.blend


@dataclass(frozen=True, slots=True)
class Step:
    """A rounded step of height ``rise`` [m] that starts at ``start`` [m] and is ``length`` [m] long."""

    rise: float
    start: float = 2.0
    length: float = 1.0

    def shape(self, x: Tensor) -> Shape:
        """See Profile. The height is rise (u - sin(2 pi u) / (2 pi))."""
        u = ((x - self.start) / self.length).clamp(0.0, 1.0)
        angle = 2.0 * math.pi * u
        height = self.rise * (u - torch.sin(angle) / (2.0 * math.pi))
        slope = self.rise / self.length * (1.0 - torch.cos(angle))
        return height, slope, self.rise / self.length**2 * 2.0 * math.pi * torch.sin(angle)


@dataclass(frozen=True, slots=True)
class Hills:
    """A mean slope and a sum of sines: slope(x) = mean + SUM a_j cos(k_j x + p_j).

    ``mean`` [batch, 1] [1]; ``amplitude`` [1], ``wavenumber`` [rad/m] and ``phase`` [rad] are [batch, sines].
    """

    mean: Tensor
    amplitude: Tensor
    wavenumber: Tensor
    phase: Tensor

    def shape(self, x: Tensor) -> Shape:
        """See Profile."""
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
    """Hills of four random sines each. No slope exceeds STEEPEST or half of ``capability`` [batch] (drawbar pull / weight).

    The mean slope is uniform in +-MEAN_SLOPE; the sines together take between 40 and 100 % of what is left to STEEPEST.
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
