# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Weighted draws from a density within a box: adaptive multiple importance sampling.

Cornuet, Marin, Mira and Robert 2012. Each round draws from a Student distribution with the weighted
mean and covariance of all draws before it, and weighs all draws anew by the mixture of all
distributions so far. The density is evaluated for many points at once.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import softmax
from scipy.stats import multivariate_t

from terrain_estimator.observation import Floats

_DRAWN, _FEWEST_ROUNDS, _MOST_ROUNDS = 2000, 4, 20
_TAILS = 4
"""Degrees of freedom of the Student distributions, whose tails are to exceed the density's."""
_WIDER = 2.0
"""[1] Factor on their covariance, for the same reason."""
_STEP, _CURVED = 1e-5, 1e-3
"""[1] Shares of the box by which first and second differences step."""
_BEGINS, _SOUGHT = 3, 40

LogDensity = Callable[[Floats], Floats]
"""Log densities [V] up to a constant at points [V, D] inside the box."""


@dataclass(frozen=True, slots=True)
class Draws:
    """Draws [V, D] with weights [V] that add up to one."""

    values: Floats
    weights: Floats

    @property
    def effective(self) -> float:
        """Number of independent draws that say as much."""
        return float(1.0 / (self.weights**2).sum())

    def quantiles(self, of: Floats, shares: tuple[float, ...]) -> Floats:
        """Return quantiles of a quantity [V] of the draws."""
        order = np.argsort(of)
        below = np.cumsum(self.weights[order]) - 0.5 * self.weights[order]
        return np.interp(shares, below, of[order])

    def moments(self) -> tuple[Floats, Floats]:
        """Return mean and covariance."""
        mean = self.weights @ self.values
        apart = self.values - mean
        return mean, apart.T @ (apart * self.weights[:, None])


def draws(
    log_density: LogDensity,
    middle: Floats,
    low: Floats,
    high: Floats,
    enough: float,
    seed: int,
) -> Draws:
    """Return draws from the density in the box [low, high], from the mode near ``middle`` on.

    Sampling ends with ``enough`` effective draws, or when it takes too long: see
    :attr:`Draws.effective`.
    """
    # in shares of the box: a covariance in units as far apart as Pa and m looks singular
    width, none, whole = high - low, np.zeros_like(low), np.ones_like(low)

    def of_shares(shares: Floats) -> Floats:
        return log_density(low + width * shares)

    centre = (mode(log_density, middle, low, high, seed) - low) / width
    covariance = _curvature(of_shares, centre, none, whole)
    generator = np.random.default_rng(seed)
    distributions, rounds = [], 0
    values, heights = np.zeros((0, len(low))), np.zeros(0)
    while True:
        rounds += 1
        proposal = multivariate_t(centre, _WIDER * covariance, df=_TAILS)
        distributions.append(proposal)
        new = proposal.rvs(_DRAWN, random_state=generator)
        values = np.vstack([values, new])
        heights = np.concatenate([heights, _inside(of_shares, new, none, whole)])
        mixture = np.logaddexp.reduce([each.logpdf(values) for each in distributions])
        ratios = heights - mixture
        found = Draws(values, softmax(ratios))
        settled = rounds >= _FEWEST_ROUNDS and found.effective >= enough
        if settled or rounds == _MOST_ROUNDS:
            return Draws(low + width * values, found.weights)
        centre, covariance = _tempered(values, ratios).moments()
        covariance += _CURVED**2 * np.eye(len(low))


def _tempered(values: Floats, ratios: Floats) -> Draws:
    """Return draws with weights flat enough that their covariance has full rank."""
    power = 1.0
    found = Draws(values, softmax(ratios))
    while found.effective < 20.0 + 2.0 * values.shape[1] and power > 0.05:
        power *= 0.8
        found = Draws(values, softmax(power * ratios))
    return found


def _inside(log_density: LogDensity, values: Floats, low: Floats, high: Floats) -> Floats:
    inside = ((values >= low) & (values <= high)).all(1)
    found = np.full(len(values), -math.inf)
    if inside.any():
        found[inside] = log_density(values[inside])
    return found


def mode(log_density: LogDensity, middle: Floats, low: Floats, high: Floats, seed: int) -> Floats:
    """Return the highest of some modes, sought from ``middle`` and from places around it."""
    width, generator = high - low, np.random.default_rng(seed)

    def sloped(share: Floats) -> tuple[float, Floats]:
        steps = np.where(share + _STEP > 1.0, -_STEP, _STEP)
        moved = np.vstack([share[None], share + np.diag(steps)])
        heights = -log_density(np.clip(low + width * moved, low, high))
        return float(heights[0]), (heights[1:] - heights[0]) / steps

    begins = [(middle - low) / width]
    begins += [begins[0] + 0.3 * generator.uniform(-1.0, 1.0, len(low)) for _ in range(_BEGINS - 1)]
    found = [
        minimize(
            sloped,
            begin.clip(0.01, 0.99),
            jac=True,
            method="L-BFGS-B",
            bounds=[(0.0, 1.0)] * len(low),
            options={"maxiter": _SOUGHT},
        )
        for begin in begins
    ]
    best = min(found, key=lambda each: float(each.fun))
    return np.asarray(low + width * best.x)


def _curvature(log_density: LogDensity, at: Floats, low: Floats, high: Floats) -> Floats:
    """Return the covariance of the Gaussian at a mode, at most as wide as the box."""
    width, count = high - low, len(low)
    step = _CURVED * width
    centre = np.clip(at, low + 2.0 * step, high - 2.0 * step)
    rows, columns = np.triu_indices(count)
    signs = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
    unit = np.diag(step)
    moved = centre + signs[:, 0, None, None] * unit[rows] + signs[:, 1, None, None] * unit[columns]
    heights = -log_density(moved.reshape(-1, count)).reshape(4, -1)
    second = (heights[0] - heights[1] - heights[2] + heights[3]) / (4.0 * _CURVED**2)
    hessian = np.zeros((count, count))
    hessian[rows, columns] = hessian[columns, rows] = second
    values, vectors = np.linalg.eigh(hessian)
    # 12 is the precision of a uniform distribution over the box
    return np.asarray((vectors / values.clip(12.0)) @ vectors.T * np.outer(width, width))
