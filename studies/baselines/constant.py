# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Trivial reference: the same ground everywhere, and a constant velocity."""

import math
from dataclasses import dataclass

import torch

from studies.baselines.drives import LevelDrives
from studies.baselines.interface import Estimates


@dataclass(frozen=True, slots=True)
class ConstantGuess:
    """The middle of the test band of the authors' code: 1 kPa and 32.5 degrees."""

    cohesion_pa: float = 1000.0
    angle: float = math.radians(32.5)
    name: str = "constant guess"

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Return the constant guess for all drives."""
        guess = torch.tensor([self.cohesion_pa, math.tan(self.angle)], dtype=torch.float64)
        return Estimates(
            parameters=guess.expand(*drives.slip.shape[:2], 2), velocity=drives.velocity[:, :-1]
        )
