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
    """Independent Gaussians; the default is wide and not centred on the paper's test band."""

    cohesion_kpa: float = 2.75
    cohesion_sd_kpa: float = 1.3
    tan_phi: float = 0.6
    tan_phi_sd: float = 0.4

    def mean(self) -> Tensor:
        """Return the mean of c [kPa] and tan phi [2]."""
        return torch.tensor([self.cohesion_kpa, self.tan_phi], dtype=torch.float64)

    def precision(self) -> Tensor:
        """Return the diagonal of the precision [2], c in kPa."""
        return torch.tensor([self.cohesion_sd_kpa, self.tan_phi_sd], dtype=torch.float64) ** -2.0


@dataclass(frozen=True, slots=True)
class Estimates:
    """Output of a method after every sample; None for what it does not estimate."""

    # [batch, time, 2] c [Pa], tan phi, from the samples up to this one
    parameters: Tensor | None = None
    deviation: Tensor | None = None  # [batch, time, 2] their marginal standard deviations
    # [batch, time] [m/s] predicted for this sample from those before it and its own inputs
    velocity: Tensor | None = None
    velocity_sd: Tensor | None = None  # [batch, time] deviation of that measurement


class Method(Protocol):
    """A deterministic method for a batch of drives, which may use the true load and torque only."""

    @property
    def name(self) -> str:
        """Name in the tables."""
        ...

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Run over all drives."""
        ...
