# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Iagnemma, Kang, Shibly and Dubowsky 2004: least squares on load and torque of every wheel.

With stresses linear in the angle, the largest ones at theta_m = theta_1 / 2, and without the small
share of c in the normal stress, every wheel gives one equation that is linear in both parameters::

    2 M / (r^2 b theta_1) = (1/2 + A) c + A sigma_m tan phi            divided by (1/2 + A)
    sigma_m = (W r theta_1^2 + 4 M sin theta_1 - 8 M sin(theta_1 / 2)) / (4 r^2 b f_1)
    f_1 = theta_1 / 2 (2 cos(theta_1 / 2) - cos theta_1 - 1)
    A = 1 - exp(-r / K (theta_1 / 2 - (1 - i) (sin theta_1 - sin(theta_1 / 2))))

The paper's K_1 and K_2 stack one row per wheel and sample. Of the soil only K is needed.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from studies.baselines.drives import PA_PER_UNIT, LevelDrives, Vehicle
from studies.baselines.interface import Estimates
from studies.baselines.least_squares import recursive_least_squares
from terramechanics.contact.stresses import entry_angle


@dataclass(frozen=True, slots=True)
class Iagnemma:
    """Least squares on load and torque, without deviations and without predictions of velocity.

    As in the paper it gets the true load and torque of every wheel.
    """

    vehicle: Vehicle
    constants: Tensor  # [6] of the soil, as assumed
    name: str = "Iagnemma"

    def estimate(self, drives: LevelDrives) -> Estimates:
        """Estimate c and tan phi of all drives."""
        features, target = self.rows(drives.slip, drives.sinkage, drives.torque, drives.load)
        axles = features.shape[-2]
        estimate = recursive_least_squares(features.flatten(1, 2), target.flatten(1), 1.0)[
            :, axles::axles
        ]
        return Estimates(
            parameters=estimate * torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
        )

    def rows(
        self, slip: Tensor, sinkage: Tensor, torque: Tensor, load: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Features [..., 2] of (c [kPa], tan phi) and targets [...] [kPa] of wheels [...]."""
        radius, width, modulus = self.vehicle.radius_m, self.vehicle.width_m, self.constants[3]
        theta = entry_angle(sinkage, radius)
        half = theta / 2.0
        f1 = half * (2.0 * torch.cos(half) - torch.cos(theta) - 1.0)
        moment = 4.0 * torque * torch.sin(theta) - 8.0 * torque * torch.sin(half)
        sigma = (load * radius * theta**2 + moment) / (4.0 * radius**2 * width * f1)
        a = -torch.expm1(
            -radius / modulus * (half - (1.0 - slip) * (torch.sin(theta) - torch.sin(half)))
        )
        target = 2.0 * torque / (radius**2 * width * theta * (0.5 + a) * PA_PER_UNIT)
        return torch.stack([torch.ones_like(a), a * sigma / ((0.5 + a) * PA_PER_UNIT)], -1), target
