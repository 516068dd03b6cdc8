# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Recursive least squares with exponential forgetting (Ljung and Soderstrom 1983, section 2.6)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from studies.baselines.drives import (
    PA_PER_UNIT,
    AffineForces,
    LevelDrives,
    Vehicle,
    closed_form_forces,
    velocity_features,
)
from studies.baselines.interface import Estimates

DIFFUSE = 1e6
"""Variance of both parameters [kPa^2, 1] before the first row, in its units: a flat prior."""


@dataclass(frozen=True, slots=True)
class RecursiveLeastSquares:
    """Unweighted rows of velocity increments; ``forgetting`` 1 remembers everything."""

    vehicle: Vehicle
    constants: Tensor  # [6] of the soil, as assumed
    forgetting: float = 1.0
    forces: AffineForces = closed_form_forces
    name: str = "recursive least squares"

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Estimate c and tan phi of all drives."""
        features = velocity_features(
            drives.slip, drives.sinkage, self.constants, self.vehicle, self.forces
        )
        target = drives.increment - features[..., 2]
        estimate = recursive_least_squares(features[..., :2], target, self.forgetting)
        change = (features[..., :2] * estimate[:, :-1]).sum(-1)
        unit = torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
        return Estimates(
            parameters=estimate[:, 1:] * unit,
            velocity=drives.velocity[:, :-1] + change + features[..., 2],
        )


def recursive_least_squares(features: Tensor, target: Tensor, forgetting: float) -> Tensor:
    """Return the estimates after 0, 1, ... rows [batch, T + 1, D].

    ``features`` are [batch, T, D], ``target`` [batch, T].

        gain = P phi / (lambda + phi' P phi)
        k <- k + gain (x - phi' k)
        P <- (P - gain phi' P) / lambda
    """
    batch, _, size = features.shape
    P = (DIFFUSE * torch.eye(size, dtype=torch.float64)).expand(batch, size, size)
    estimates = [torch.zeros(batch, size, dtype=torch.float64)]
    for phi, x in zip(features.unbind(1), target.unbind(1), strict=True):
        spread = torch.einsum("bij,bj->bi", P, phi)
        gain = spread / (forgetting + (phi * spread).sum(-1, keepdim=True))
        estimates.append(estimates[-1] + gain * (x - (phi * estimates[-1]).sum(-1)).unsqueeze(-1))
        P = (P - gain.unsqueeze(-1) * spread.unsqueeze(-2)) / forgetting
    return torch.stack(estimates, 1)
