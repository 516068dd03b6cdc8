# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The unknowns of a fit, of every run and shared, and their priors."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.equations import Unknowns

PRIOR_THETA = ((2.75, 1.3), (0.6, 0.22))
"""Mean and deviation of c [kPa] and tan phi, as the shipped models have them."""
PRIOR_BIAS_SD = 0.02
"""[m/s^2] of the accelerometer's bias."""
PRIOR_VELOCITY_SD = 10.0
"""[m/s] which says nothing."""


@dataclass(frozen=True, slots=True)
class Point:
    """Values of all unknowns."""

    runs: tuple[Unknowns, ...]
    shared: Tensor  # [K]


def own_prior(unknowns: Unknowns) -> tuple[Tensor, Tensor]:
    """Return mean and precision of a run's own unknowns, [P] each."""
    constants, velocities = unknowns.kappa.shape[0], unknowns.velocity.shape[0]
    mean = torch.zeros(3 + constants + velocities, dtype=torch.float64)
    precision = torch.ones_like(mean)
    for k, (centre, sd) in enumerate(PRIOR_THETA):
        mean[k], precision[k] = centre, sd**-2
    precision[2 + constants] = PRIOR_BIAS_SD**-2
    precision[3 + constants :] = PRIOR_VELOCITY_SD**-2
    return mean, precision


def start_of(
    velocities: Sequence[Tensor], constants: int, theta: Sequence[tuple[float, float]], shared: int
) -> Point:
    """Return a start at ``theta`` (c [kPa], tan phi) and the velocities of each run.

    Everything else is zero.
    """
    runs = tuple(
        Unknowns(
            torch.tensor(strength, dtype=torch.float64),
            torch.zeros(constants, dtype=torch.float64),
            torch.zeros(1, dtype=torch.float64),
            velocity,
        )
        for strength, velocity in zip(theta, velocities, strict=True)
    )
    return Point(runs, torch.zeros(shared, dtype=torch.float64))


def with_shared(point: Point, values: Tensor) -> Point:
    """Return the point with other shared unknowns."""
    return dataclasses.replace(point, shared=values)
