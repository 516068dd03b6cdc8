# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""P-ALPaCA as in the paper: conjugate regression on features of single velocity increments."""

from dataclasses import dataclass

import torch

from studies.baselines.conjugate import marginal_deviation, predict, regress
from studies.baselines.drives import PA_PER_UNIT, LevelDrives
from studies.baselines.features import LearntModel
from studies.baselines.interface import Estimates


@dataclass(frozen=True, slots=True)
class PaperPAlpaca:
    """A trained model; without nominal features it does not estimate c and tan phi."""

    model: LearntModel
    name: str

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Run over all drives.

        The deviations are marginal ones; the authors plot conditional ones, 1 / sqrt(diag Lambda).
        """
        with torch.no_grad():
            features, constant = self.model.features(drives)
            noise = self.model.noise()
            mean, precision = self.model.prior()
            posterior = regress(
                features / noise, (drives.increment - constant) / noise, mean, torch.diag(precision)
            )
            change, variance = predict(posterior, features)
        velocity = drives.velocity[:, :-1] + change + constant
        velocity_sd = (variance + noise**2).sqrt()
        if self.model.nominal == 0:
            return Estimates(velocity=velocity, velocity_sd=velocity_sd)
        unit = torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
        deviation = marginal_deviation(posterior, 2)[:, 1:] * unit
        return Estimates(posterior.mean[:, 1:, :2] * unit, deviation, velocity, velocity_sd)
