# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The posterior of a world, given a drive, by adaptive importance sampling.

Given a world the instants are independent but for the velocity, v_j = v_(j-1) + dt a_j, whose start
is unknown. Its part is a Kalman filter with the mean and variance of each a_j. The worlds' prior is
that of the estimator's documentation: independent Gaussians, c and tan phi above zero.

Three priors of the true inputs are judged, called readings:

- ``FLAT``: slips, angles and pitch are flat, sinkages are what these make them.
- ``FLAT_SINKAGE``: the sinkages are flat, too, and the balances cut out of them what they allow.
  Each instant then has a factor 1 / |d (load, moments) / d sinkage|.
- ``ALIKE``: Jeffreys' prior given the world, the root of the information about the inputs. It takes
  the volume of their posterior out of the evidence, so that no world is preferred because its
  sensors tell the inputs less well (Berger, Liseo and Wolpert 1999, Integrated likelihood methods
  for eliminating nuisance parameters). The estimator leaves out the determinants of its rows
  (docs/method.md), which is the same to first order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from scipy.stats import chi2, norm, qmc
from torch import Tensor

from studies.independent_reference.equations import Equations, Seen
from studies.independent_reference.instants import Instants, integrate
from terrain_estimator.model.prior import DEFAULT_PRIOR

FLAT, FLAT_SINKAGE, ALIKE = READINGS = range(3)
"""Places of the readings of the inputs."""
CHUNK = 8
"""Worlds that are integrated at once."""
WARMING = (64, 64, 128)
"""Worlds of the rounds from which the last one's proposal is taken."""
FREEDOM = 5.0
"""Degrees of freedom of the proposals, Student's t."""

PROPOSED = (FLAT, ALIKE)
"""Readings around whose moments worlds are drawn."""

LogDensity = Callable[[Tensor], Tensor]
"""Log densities [P, F] of worlds [P, D], F of them, each up to a constant."""


class Weighted(NamedTuple):
    """Worlds with their weights."""

    worlds: Tensor  # [P, D]
    log_weight: Tensor  # [P, F]


class Moments(NamedTuple):
    """Moments of a weighted set of worlds."""

    mean: Tensor  # [D]
    covariance: Tensor  # [D, D]
    effective: float  # number of worlds of equal weight that are worth as much


@dataclass(slots=True)
class Quality:
    """The worst of all samples that were taken."""

    effective: float = 1.0  # least share of effective samples of an instant
    imbalance: float = 0.0  # [m g, m g L] largest excess of load or moments


@dataclass(frozen=True, slots=True)
class DriveDensity:
    """Log posterior densities of worlds, given one drive."""

    equations: Equations
    seen: Seen
    step_s: float  # [s] between instants
    draws: Tensor  # [T, N, E] standard normal, by which the instants are integrated
    torque: bool  # whether torques are used, beside velocity, load and moments
    quality: Quality = field(default_factory=Quality)

    def __call__(self, worlds: Tensor) -> Tensor:
        """Return the log densities [P, 3] of worlds [P, 4], one for each reading of the inputs."""
        return torch.cat([self._chunk(chunk) for chunk in torch.split(worlds, CHUNK)])

    def _chunk(self, worlds: Tensor) -> Tensor:
        possible = (worlds[:, :2] > 0.0).all(1, keepdim=True)
        safe = torch.cat([worlds[:, :2].clamp(min=1e-3), worlds[:, 2:]], 1)
        found = integrate(self.equations, safe, self.seen, self.draws, torque=self.torque)
        if bool(possible.any()):
            here = possible.squeeze(1)
            worst, most = found.effective[here].min(), found.imbalance[here].max()
            self.quality.effective = min(self.quality.effective, float(worst))
            self.quality.imbalance = max(self.quality.imbalance, float(most))
        flat = log_prior(worlds) + found.log_evidence.sum(1)
        flat = flat + log_velocities(found, self.seen, self.step_s)
        every = torch.stack([flat, flat - found.by_sinkage, flat - found.log_volume], 1)
        return torch.where(possible & every.isfinite(), every, -math.inf)


def prior_moments() -> tuple[Tensor, Tensor]:
    """Return mean [4] and deviations [4] of a world before any measurement."""
    own = DEFAULT_PRIOR
    mean = torch.tensor([own.cohesion_pa, own.tan_phi, 0.0, 0.0], dtype=torch.float64)
    deviations = (own.cohesion_sd_pa, own.tan_phi_sd, own.mass_sd, own.centre_of_mass_sd)
    return mean, torch.tensor(deviations, dtype=torch.float64)


def log_prior(worlds: Tensor) -> Tensor:
    """Return the log prior densities [P] of worlds above zero, up to a constant."""
    mean, sd = prior_moments()
    return -0.5 * ((worlds - mean) / sd).square().sum(1)


def log_velocities(found: Instants, seen: Seen, step_s: float) -> Tensor:
    """Return the log density [P] of the measured velocities after the first one.

    A Kalman filter: the first velocity starts it, each further one follows an acceleration.
    """
    noise = seen.velocity_sd.square()
    mean = seen.velocity[0].expand(len(found.acceleration))
    variance, total = noise[0].expand_as(mean), torch.zeros_like(mean)
    for j in range(1, len(noise)):
        mean = mean + step_s * found.acceleration[:, j]
        variance = variance + step_s**2 * found.variance[:, j]
        spread, miss = variance + noise[j], seen.velocity[j] - mean
        total = total - 0.5 * (miss.square() / spread + torch.log(2.0 * math.pi * spread))
        mean, variance = mean + variance / spread * miss, variance * noise[j] / spread
    return total


def sample(density: LogDensity, start: Moments, count: int, seed: int) -> Weighted:
    """Return ``count`` weighted worlds of ``density``, after rounds that improve the proposal.

    ``start`` is where to look first. It does not change the answer, only its accuracy.
    """
    about = [start] * len(PROPOSED)
    for number in WARMING:
        seed += 1
        worlds = _round(density, about, number, seed)
        about = [_flattened(worlds, reading) for reading in PROPOSED]
    return _round(density, about, count, seed + 1)


def moments(weighted: Weighted, place: int) -> Moments:
    """Return the moments by the density at ``place``."""
    return _moments(weighted.worlds, torch.softmax(weighted.log_weight[:, place], 0))


def _flattened(weighted: Weighted, place: int) -> Moments:
    """Return moments by weights so flattened that a tenth of the worlds is effective."""
    log_weight = weighted.log_weight[:, place]
    found = _moments(weighted.worlds, torch.softmax(log_weight, 0))
    while found.effective < 0.1 * len(log_weight):
        log_weight = 0.7 * log_weight
        found = _moments(weighted.worlds, torch.softmax(log_weight, 0))
    return found


def _moments(worlds: Tensor, weight: Tensor) -> Moments:
    mean = weight @ worlds
    away = worlds - mean
    covariance = away.T @ (weight.unsqueeze(1) * away)
    return Moments(mean, covariance, 1.0 / float(weight.square().sum()))


def _round(density: LogDensity, about: list[Moments], count: int, seed: int) -> Weighted:
    """Return ``count`` weighted worlds drawn by Student's t, as many around each of ``about``.

    They are scrambled Sobol sequences, which fill space more evenly than independent draws;
    ``count`` over the length of ``about`` is a power of two.
    """
    size, number = len(about[0].mean), count // len(about)
    roots = [torch.linalg.cholesky(each.covariance) for each in about]
    parts = []
    for place, (each, root) in enumerate(zip(about, roots, strict=True)):
        sequence = qmc.Sobol(size + 1, seed=1000 * seed + place)
        share = sequence.random(number).clip(1e-9, 1.0 - 1e-9)
        stretch = (FREEDOM / chi2.ppf(share[:, -1:], FREEDOM)) ** 0.5
        parts.append(each.mean + torch.from_numpy(norm.ppf(share[:, :-1]) * stretch) @ root.T)
    worlds = torch.cat(parts)
    proposed = torch.stack(
        [_log_student(worlds, each, root) for each, root in zip(about, roots, strict=True)]
    )
    return Weighted(worlds, density(worlds) - torch.logsumexp(proposed, 0).unsqueeze(1))


def _log_student(worlds: Tensor, about: Moments, root: Tensor) -> Tensor:
    """Return the log density [P] of Student's t at ``worlds``, up to a constant."""
    white = torch.linalg.solve_triangular(root, (worlds - about.mean).T, upper=False)
    power = -0.5 * (FREEDOM + len(root)) * torch.log1p(white.square().sum(0) / FREEDOM)
    return power - root.diagonal().log().sum()
