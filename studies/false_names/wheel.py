# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A rigid wheel on soils with laws of many authors, apart from terramechanics.

Nothing of the library's laws, quadrature or search is used, so that a table of these wheels is
foreign to it. Normal stress of a point at the angle theta from the vertical follows from a pressure
law of depth h and a distribution along the rim, shear stress from a law of the shear displacement::

    tau = (c + sigma tan phi) E(j),   j = R ((theta_1 - theta) - (1 - i) (sin theta_1 - sin theta))

with R the radius at which soil is sheared (that of the rim, or more with lugs).
"""

import math
from dataclasses import dataclass

import numpy as np

from terrain_estimator.observation import Floats

PRESSURES = ("power", "bounded", "hyperbola", "crust")
"""Bekker 1956; exponential with a bound (Wong 2001, organic terrain); Kondner 1963; a crust."""
SHEARS = ("janosi", "hyperbola", "hump")
"""Janosi and Hanamoto 1961; Kacigin and Guskov 1968; with a peak (Wong 2001, eq. 2.51)."""
DISTRIBUTIONS = ("shifted", "vertical", "sine", "sprung")
"""Wong and Reece 1967; Bekker 1956; a half wave over the contact; shifted, with an exit angle."""
_POINTS, _HALVINGS = 160, 50


@dataclass(frozen=True, slots=True)
class Soil:
    """Laws of one soil, and their numbers."""

    pressure: str
    shear: str
    distribution: str
    n: float  # [1] of "power" and "crust"
    stiffness: float  # [Pa] pressure at ``depth``
    depth: float  # [m] at which pressure laws agree
    bend: float  # [m] depth at which a bounded law bends, or a crust breaks
    crust: float  # [1] strength of a crust over ``stiffness``
    shear_length: float  # [m]
    peak: float  # [1] height of a hump over the residual
    c1: float
    c2: float
    exit_share: float  # [1] contact behind the axle over that before it, of "sprung" and "sine"
    cohesion_pa: float
    tan_phi: float

    def pressed(self, depth: Floats) -> Floats:
        """Return the pressure [Pa] below a plate, or a rim, at a depth [m]."""
        h = np.maximum(depth, 0.0)
        if self.pressure == "bounded":
            return np.asarray(
                self.stiffness * np.expm1(-h / self.bend) / math.expm1(-self.depth / self.bend)
            )
        if self.pressure == "hyperbola":
            at = self.depth / (self.bend + self.depth)
            return np.asarray(self.stiffness * h / (self.bend + h) / at)
        power = self.stiffness * (h / self.depth) ** self.n
        if self.pressure == "crust":
            power = power + self.crust * self.stiffness * (h / self.bend) * np.exp(
                1.0 - h / self.bend
            )
        return np.asarray(power)

    def mobilised(self, shear: Floats) -> Floats:
        """Return the share [1] of the strength that a shear displacement [m] mobilises."""
        j = np.abs(shear) / self.shear_length
        share = j / (1.0 + j) if self.shear == "hyperbola" else -np.expm1(-j)
        if self.shear == "hump":
            share = share * (1.0 + self.peak * np.exp(-j))
        return np.asarray(np.sign(shear) * share)


@dataclass(frozen=True, slots=True)
class Extra:
    """What acts besides, for tables that do lack an effect. 0 is nothing."""

    tip: float = 0.0  # [m] soil is sheared this far beyond the rim (Ding et al. 2009)
    passive_n: float = 0.0  # [N] of all lugs in the soil together at full passive pressure
    passive_slip: float = 0.15  # [1] slip that mobilises half of it
    spaced_pa: float = 0.0  # [Pa] of the contact area, in proportion to slip up to ``spaced_slip``
    spaced_slip: float = 0.3
    digging: float = 0.0  # [1] stiffness falls as 1 / (1 + digging |i|)^2 (after Lyasko 2010)
    wedge_pa_m: float = 0.0  # [N/m^3] resistance of a wedge over width and depth squared


@dataclass(frozen=True, slots=True)
class Wheel:
    """One wheel on one soil."""

    radius: float  # [m]
    width: float  # [m]
    soil: Soil
    extra: Extra = Extra()

    def state(self, slip: float, load: float) -> tuple[float, float, float]:
        """Return sinkage [m], drawbar pull [N] and torque [N m] under a load [N]."""
        low, high = 1e-6 * self.radius, 0.9 * self.radius
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self.forces(slip, middle)[0] < load:
                low = middle
            else:
                high = middle
        depth = 0.5 * (low + high)
        _, pull, torque = self.forces(slip, depth)
        return depth, pull, torque

    def forces(self, slip: float, depth: float) -> tuple[float, float, float]:
        """Return normal force [N], drawbar pull [N] and torque [N m] at a sinkage [m]."""
        soil, extra = self.soil, self.extra
        ahead = math.acos(1.0 - depth / self.radius)
        behind = soil.exit_share * ahead if soil.distribution in ("sine", "sprung") else 0.0
        step = (ahead + behind) / _POINTS
        theta: Floats = np.asarray(-behind + step * (np.arange(_POINTS) + 0.5), np.float64)
        sigma = self._normal(theta, ahead, behind, slip)
        if extra.digging:
            sigma = sigma / (1.0 + extra.digging * abs(slip)) ** 2
        reach = self.radius + extra.tip
        free = (1.0 - slip) * self.radius / reach
        shear = reach * ((ahead - theta) - free * (math.sin(ahead) - np.sin(theta)))
        tau = (soil.cohesion_pa + sigma * soil.tan_phi) * soil.mobilised(shear)
        area = self.radius * self.width * step
        share = reach / self.radius
        normal = area * float((sigma * np.cos(theta) + share * tau * np.sin(theta)).sum())
        pull = area * float((share * tau * np.cos(theta) - sigma * np.sin(theta)).sum())
        torque = area * self.radius * share**2 * float(tau.sum())
        thrust = extra.passive_n * slip / (abs(slip) + extra.passive_slip)
        grown = max(-1.0, min(slip / extra.spaced_slip, 1.0))
        thrust += extra.spaced_pa * self.width * self.radius * ahead * grown
        wedge = extra.wedge_pa_m * self.width * depth**2
        return normal, pull + thrust - wedge, torque + self.radius * thrust

    def _normal(self, theta: Floats, ahead: float, behind: float, slip: float) -> Floats:
        soil, r = self.soil, self.radius
        if soil.distribution == "vertical":
            return soil.pressed(r * (np.cos(theta) - math.cos(ahead)))
        if soil.distribution == "sine":
            deepest = soil.pressed(np.array(r * (1.0 - math.cos(ahead))))
            return np.asarray(deepest * np.sin(math.pi * (theta + behind) / (ahead + behind)))
        largest = min(max(soil.c1 + soil.c2 * slip, 0.05), 0.95) * ahead
        rear = ahead - (theta + behind) / (largest + behind) * (ahead - largest)
        place = np.where(theta >= largest, theta, rear)
        return soil.pressed(r * (np.cos(place) - math.cos(ahead)))
