# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The unknowns of a fit, of every run and shared, and the prior of a run's own."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.model.prior import Prior
from terrain_estimator.model.rows import PA_PER_UNIT

PRIOR_VELOCITY_SD = 10.0
"""[m/s] Wide enough to leave a velocity free."""


@dataclass(frozen=True, slots=True)
class Unknowns:
    """Values of one run's own unknowns, and their prior."""

    theta: Tensor  # [2]
    kappa: Tensor  # [M]
    bias: Tensor  # [1] [m/s^2]
    velocity: Tensor  # [V] [m/s]
    prior: Prior

    def flat(self) -> Tensor:
        """Return all unknowns [P]."""
        return torch.cat([self.theta, self.kappa, self.bias, self.velocity])

    def moved(self, step: Tensor) -> "Unknowns":
        """Return the unknowns changed by ``step`` [P]."""
        sizes = [2, self.kappa.shape[0], 1, self.velocity.shape[0]]
        theta, kappa, bias, velocity = torch.split(self.flat() + step, sizes)
        return Unknowns(theta, kappa, bias, velocity, self.prior)

    def prior_moments(self) -> tuple[Tensor, Tensor]:
        """Return mean and precision of the prior, [P] each."""
        constants, prior = self.kappa.shape[0], self.prior
        mean = torch.zeros_like(self.flat())
        mean[:2] = strength_of(prior)
        sd = torch.ones_like(mean)
        sd[0], sd[1] = prior.cohesion_sd_pa / PA_PER_UNIT, prior.tan_phi_sd
        sd[2 + constants] = prior.acceleration_bias_sd
        sd[3 + constants :] = PRIOR_VELOCITY_SD
        return mean, sd**-2


def strength_of(prior: Prior) -> Tensor:
    """Return the prior means of c [kPa] and tan phi, [2]."""
    return torch.tensor([prior.cohesion_pa / PA_PER_UNIT, prior.tan_phi], dtype=torch.float64)


@dataclass(frozen=True, slots=True)
class Point:
    """Values of all unknowns."""

    runs: tuple[Unknowns, ...]
    shared: Tensor  # [K]

    def with_shared(self, values: Tensor) -> "Point":
        """Return the point with other shared unknowns [K]."""
        return dataclasses.replace(self, shared=values)


def start_of(velocities: Sequence[Tensor], constants: int, prior: Prior) -> Point:
    """Return a start at the prior mean, with the velocities of each run and nothing shared."""
    runs = tuple(
        Unknowns(
            strength_of(prior),
            torch.zeros(constants, dtype=torch.float64),
            torch.zeros(1, dtype=torch.float64),
            velocity,
            prior,
        )
        for velocity in velocities
    )
    return Point(runs, torch.zeros(0, dtype=torch.float64))
