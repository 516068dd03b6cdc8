# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The one interface of all methods."""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from studies.baselines.drives import LevelDrives


@dataclass(frozen=True, slots=True)
class BaselinePrior:
    """Independent Gaussians. The default is wide and not centred on the band that the paper keeps for its tests."""

    cohesion_kpa: float = 2.75
    cohesion_sd_kpa: float = 1.3
    tan_phi: float = 0.6
    tan_phi_sd: float = 0.4

    def mean(self) -> Tensor:
        """[2] c [kPa], tan phi."""
        return torch.tensor([self.cohesion_kpa, self.tan_phi], dtype=torch.float64)

    def precision(self) -> Tensor:
        """[2] diagonal, c in kPa."""
        return torch.tensor([self.cohesion_sd_kpa, self.tan_phi_sd], dtype=torch.float64) ** -2.0


@dataclass(frozen=True, slots=True)
class Estimates:
    """What a method says after every sample. None where it says nothing of the kind."""

    parameters: Tensor | None = (
        None  # [batch, time, 2] c [Pa], tan phi, from the samples up to this one
    )
    deviation: Tensor | None = None  # [batch, time, 2] their marginal standard deviations
    velocity: Tensor | None = (
        None  # [batch, time] [m/s] predicted for this sample from those before it and its own inputs
    )
    velocity_sd: Tensor | None = None  # [batch, time] deviation of what that sample will measure


class Method(Protocol):
    """A method for a batch of drives. Deterministic; it must not look at anything true but load and torque."""

    @property
    def name(self) -> str:
        """As tables call it."""
        ...

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Run over all drives."""
        ...
