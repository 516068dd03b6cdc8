# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil and terrain of hidden cases: one soil a case, its strength drawn for every drive."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.contact.sinkage import drawbar_capability
from terramechanics.presets import load_soil
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import Hills, Profile, Shape, random_hills
from terramechanics.vehicle.rover import Rover

SOILS = ("loose_sand", "regolith")
COHESION_PA = (500.0, 5000.0)
FRICTION_DEG = (15.0, 45.0)
SPREAD = 0.05
"""[1] Largest relative error of each soil constant."""
STEEPEST = math.radians(4.0)
"""[rad] Slope of a ramp."""
BLEND = 2.0
"""[m] Length of the transition to a ramp."""


@dataclass(frozen=True, slots=True)
class Terrain:
    """Hills, a ramp, or neither in each episode: the sum of both, each flat elsewhere."""

    hills: Hills
    grade: Tensor  # [batch] slope of the ramp [1]
    foot: Tensor  # [batch] [m] where it begins

    def shape(self, x: Tensor) -> Shape:
        """Return height, slope and curvature at the places ``x``."""
        wide = (-1, *[1] * (x.dim() - 1))
        grade, foot = self.grade.reshape(wide), self.foot.reshape(wide)
        u = ((x - foot) / BLEND).clamp(0.0, 1.0)
        height, slope, curvature = self.hills.shape(x)
        rise = BLEND * (u**3 - u**4 / 2.0) + (x - foot - BLEND).clamp(min=0.0)
        return (
            height + grade * rise,
            slope + grade * (3.0 * u**2 - 2.0 * u**3),
            curvature + grade * 6.0 * u * (1.0 - u) / BLEND,
        )


def uniform(
    ends: tuple[float, float], shape: tuple[int, ...], generator: torch.Generator
) -> Tensor:
    """Draw uniform numbers in [low, high)."""
    return ends[0] + (ends[1] - ends[0]) * torch.rand(
        shape, generator=generator, dtype=torch.float64
    )


def draw_ground(
    soils: list[str], generator: torch.Generator, toward: str = "", share: float = 0.0
) -> Ground:
    """Return the ground of every episode, with the named soil.

    Its constants lie by a ``share`` of the way ``toward`` those of another soil, in logarithms.
    """
    batch = len(soils)
    named = torch.stack([load_soil(soil).constants() for soil in soils])
    if share:
        named = named * (load_soil(toward).constants() / named) ** share
    constants = named * (1.0 + uniform((-SPREAD, SPREAD), (batch, 6), generator))
    cohesion = uniform(COHESION_PA, (batch,), generator)
    tan_phi = torch.tan(torch.deg2rad(uniform(FRICTION_DEG, (batch,), generator)))
    return Ground([Patch(constants, torch.stack([cohesion, tan_phi], dim=-1))])


def draw_terrain(
    kinds: list[str], rover: Rover, ground: Ground, generator: torch.Generator
) -> Profile:
    """Return the named terrain of every episode, with slopes up to half of the capability."""
    capability = drawbar_capability(rover, ground.patches[0].constants, ground.patches[0].strength)
    hills = random_hills(len(kinds), capability, generator)
    hilly, ramped = (
        torch.tensor([kind == name for kind in kinds], dtype=torch.float64)
        for name in ("hills", "ramp")
    )
    steepest = torch.minimum(capability.clamp(min=0.0) / 2.0, torch.tensor(math.tan(STEEPEST)))
    grade = ramped * steepest * uniform((-1.0, 1.0), (len(kinds),), generator)
    foot = uniform((0.0, 4.0), (len(kinds),), generator)
    scale = hilly.unsqueeze(-1)
    return Terrain(
        Hills(hills.mean * scale, hills.amplitude * scale, hills.wavenumber, hills.phase),
        grade,
        foot,
    )
