# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Belief about the ground as weighted samples of soil, cohesion and friction.

Samples serve functions that are not linear.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from terrain_estimator.distributions import normal_quantile
from terrain_estimator.observation import Floats

SAMPLES = 256
"""Samples of each soil; quasi-random and fixed, so that the same estimate gives the same advice."""


@dataclass(frozen=True, slots=True)
class Belief:
    """Posterior of the ground under the rover, as in terrain_estimate."""

    mean: Floats  # [2] c [Pa], tan phi
    covariance: Floats  # [2, 2] widened by the misfit of the rows
    soil_probability: tuple[float, ...]
    identified: bool
    change_probability: float
    disagrees: bool = False  # whether the model does not fit: the moments are then the prior's


@dataclass(frozen=True, slots=True)
class Samples:
    """Weighted samples of the ground.

    For each soil ``strength`` [n, 2], ``weight`` [n] and standard normal numbers ``spare`` [n].
    """

    strength: tuple[Floats, ...]
    weight: tuple[Floats, ...]  # they sum to 1 over all soils
    spare: tuple[Floats, ...]

    def reweighted(self, log_likelihood: tuple[Floats, ...]) -> "Samples":
        """Return the samples, reweighted by the likelihood of an observation."""
        possible = [
            np.where(weight > 0.0, part, -np.inf)
            for weight, part in zip(self.weight, log_likelihood, strict=True)
        ]
        highest = max(float(part.max()) for part in possible)
        raw = [
            weight * np.exp(part - highest)
            for weight, part in zip(self.weight, possible, strict=True)
        ]
        total = sum(float(part.sum()) for part in raw)
        return Samples(self.strength, tuple(part / total for part in raw), self.spare)

    def or_else(self, other: "Samples", probability: float) -> "Samples":
        """Return a mixture: the other samples with ``probability`` [1], these otherwise."""
        soils = range(len(self.weight))
        return Samples(
            tuple(np.concatenate([self.strength[s], other.strength[s]]) for s in soils),
            tuple(
                np.concatenate(
                    [(1.0 - probability) * self.weight[s], probability * other.weight[s]]
                )
                for s in soils
            ),
            tuple(np.concatenate([self.spare[s], other.spare[s]]) for s in soils),
        )


def widened(covariance: Floats, fit: Iterable[tuple[float, float]]) -> Floats:
    """Return a ``covariance`` [2, 2] as wide as the rows' misfits ask for, where they are large.

    ``fit`` has offset and spread of each row, in predicted deviations; the mean of their squares is
    1 where the model is right (Birge 1932, The calculation of errors by the method of least
    squares). No covariance gets narrower.
    """
    squares = [offset**2 + spread**2 for offset, spread in fit]
    return covariance * max(1.0, math.fsum(squares) / max(len(squares), 1))


def _normal_numbers() -> Floats:
    """Return quasi-random standard normal numbers [SAMPLES, 3] with exact mean and covariance.

    The points are a lattice by the plastic number, p**3 = p + 1 (Roberts 2018, The unreasonable
    effectiveness of quasirandom sequences).
    """
    count = np.arange(SAMPLES)
    plastic = 1.324717957244746
    steps = np.array([1.0 / SAMPLES, 1.0 / plastic, 1.0 / plastic**2])
    first = np.array([0.5 / SAMPLES, 0.5, 0.5])
    numbers = normal_quantile((first + np.outer(count, steps)) % 1.0)
    numbers -= numbers.mean(0)
    root = np.linalg.cholesky(np.cov(numbers.T, bias=True))
    return np.asarray(np.linalg.solve(root, numbers.T).T)


_NUMBERS = _normal_numbers()


def draw(mean: Floats, covariance: Floats, soil_probability: tuple[float, ...]) -> Samples:
    """Draw samples of a Gaussian in (c, tan phi), cut off at zero; the same for every soil."""
    deviation = np.sqrt(np.diagonal(covariance))
    slope = covariance[0, 1] / deviation[0] if deviation[0] > 0.0 else 0.0
    rest = math.sqrt(max(covariance[1, 1] - slope**2, 0.0))
    cohesion = mean[0] + deviation[0] * _NUMBERS[:, 0]
    tan_phi = mean[1] + slope * _NUMBERS[:, 0] + rest * _NUMBERS[:, 1]
    strength = np.maximum(np.column_stack([cohesion, tan_phi]), 0.0)
    total = sum(soil_probability)
    weights = tuple(
        np.full(SAMPLES, probability / total / SAMPLES) for probability in soil_probability
    )
    return Samples(
        tuple(strength for _ in weights), weights, tuple(_NUMBERS[:, 2] for _ in weights)
    )


def quantiles(
    values: Floats, weight: Floats, probabilities: tuple[float, ...]
) -> tuple[float, ...]:
    """Return weighted quantiles of ``values`` [n]."""
    order = np.argsort(values)
    below = np.cumsum(weight[order]) - 0.5 * weight[order]
    return tuple(float(np.interp(p, below / weight.sum(), values[order])) for p in probabilities)
