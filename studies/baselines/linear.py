# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's linear model: Bayesian regression of velocity increments on closed-form features."""

from dataclasses import dataclass

import torch
from torch import Tensor

from studies.baselines.conjugate import marginal_deviation, predict, regress
from studies.baselines.drives import (
    PA_PER_UNIT,
    AffineForces,
    LevelDrives,
    Vehicle,
    closed_form_forces,
    velocity_features,
)
from studies.baselines.interface import BaselinePrior, Estimates


@dataclass(frozen=True, slots=True)
class LinearModel:
    """Linear model of the velocity increment (Banerjee et al. eqs. 15 to 17).

    x_(t+1) = x_t + Phi_nom (c, tan phi) + phi_nom + eps, with eps the noise of two velocities.
    """

    vehicle: Vehicle
    constants: Tensor  # [6] of the soil, as assumed
    prior: BaselinePrior
    forces: AffineForces = closed_form_forces
    name: str = "linear"

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Run over all drives."""
        features = velocity_features(
            drives.slip, drives.sinkage, self.constants, self.vehicle, self.forces
        )
        noise = drives.velocity_sd * 2.0**0.5
        linear, target = features[..., :2] / noise, (drives.increment - features[..., 2]) / noise
        posterior = regress(linear, target, self.prior.mean(), torch.diag(self.prior.precision()))
        change, variance = predict(posterior, linear)
        unit = torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
        return Estimates(
            parameters=posterior.mean[:, 1:] * unit,
            deviation=marginal_deviation(posterior, 2)[:, 1:] * unit,
            velocity=drives.velocity[:, :-1] + change * noise + features[..., 2],
            velocity_sd=noise * (variance + 1.0).sqrt(),
        )
