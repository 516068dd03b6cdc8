# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The ground along the track: patches of soil with sharp or gradual transitions, in batches."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from terramechanics.terrain.soil import WONG_REECE, Soil


@dataclass(frozen=True, slots=True)
class Patch:
    """Soil from ``start`` [m] along the track on, after a transition of ``transition`` [m].

    ``constants`` [6] or [batch, 6] in the order of CONSTANTS; ``strength`` [2] or [batch, 2]: c
    [Pa], tan(phi) [1].
    """

    constants: Tensor
    strength: Tensor
    start: float = 0.0
    transition: float = 0.0
    name: str = ""
    law: str = WONG_REECE  # contact law of wheels

    @classmethod
    def of(cls, soil: Soil, start: float = 0.0, transition: float = 0.0) -> "Patch":
        """Make a patch of one soil."""
        return cls(soil.constants(), soil.strength(), start, transition, soil.name, soil.law)


class Ground:
    """Soil constants and strength as functions of the place along the track."""

    def __init__(self, patches: Sequence[Patch]) -> None:
        """Order the patches; the first one reaches back to the start of the track.

        Raises ValueError where they are out of order or have several contact laws.
        """
        if not patches:
            raise ValueError("a ground needs at least one patch of soil")
        for before, after in pairwise(patches):
            if after.start < before.start + before.transition or after.transition < 0.0:
                raise ValueError(
                    f"the patch at {after.start:g} m must start behind the transition of the patch"
                    f" at {before.start:g} m"
                )
        laws = {patch.law for patch in patches}
        if len(laws) > 1:
            raise ValueError(
                f"soils of one ground have one contact law, not {', '.join(sorted(laws))}"
            )
        self.patches, self.law = tuple(patches), patches[0].law

    @classmethod
    def constant(cls, soil: Soil) -> "Ground":
        """Make ground of one soil everywhere."""
        return cls([Patch.of(soil)])

    @classmethod
    def random_strength(
        cls, soil: Soil, batch: int, generator: torch.Generator, **ranges: tuple[float, float]
    ) -> "Ground":
        """Make ground of one soil with random c and phi in each episode.

        They are uniform in ``cohesion`` [Pa] and ``friction_angle`` [rad].
        """
        unit = torch.rand(batch, 2, generator=generator, dtype=torch.float64)
        low, high = torch.tensor(
            [ranges.get("cohesion", COHESION), ranges.get("friction_angle", FRICTION_ANGLE)],
            dtype=torch.float64,
        ).T
        drawn = low + (high - low) * unit
        strength = torch.stack([drawn[:, 0], torch.tan(drawn[:, 1])], dim=-1)
        return cls([Patch(soil.constants(), strength, name=soil.name, law=soil.law)])

    def at(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Return soil constants [batch, axles, 6] and strength [batch, axles, 2].

        ``x`` [batch, axles] [m] are the places.
        """
        first = self.patches[0]
        constants = _spread(first.constants).expand(*x.shape, 6)
        strength = _spread(first.strength).expand(*x.shape, 2)
        for patch in self.patches[1:]:
            share = _share(x, patch).unsqueeze(-1)
            constants = torch.lerp(constants, _spread(patch.constants).expand_as(constants), share)
            strength = torch.lerp(strength, _spread(patch.strength).expand_as(strength), share)
        return constants, strength

    def patch_at(self, x: float) -> int:
        """Return the index of the last patch that starts at or before ``x`` [m]."""
        reached = [index for index, patch in enumerate(self.patches) if patch.start <= x]
        return reached[-1] if reached else 0


COHESION = (500.0, 5000.0)
"""[Pa] Range of c in benchmarks."""
FRICTION_ANGLE = (0.2617993877991494, 0.7853981633974483)
"""[rad] Range of phi in benchmarks: 15 to 45 deg."""


def _spread(values: Tensor) -> Tensor:
    """Reshape [6] or [batch, 6] to broadcast with [batch, axles, 6]."""
    return values.unsqueeze(-2)


def _share(x: Tensor, patch: Patch) -> Tensor:
    """Return the share of the patch's soil at x [1]: 0 before it, 1 behind its transition."""
    if patch.transition == 0.0:
        return (x >= patch.start).to(x.dtype)
    return ((x - patch.start) / patch.transition).clamp(0.0, 1.0)
