# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The contact law of one wheel with all of its numbers free within physical ranges.

Coordinates of a fit: c [kPa], tan phi, the logarithms of n, k and K, then c1 and c2, errors of
sensors that are not known, values of effects. k is k_c / b + k_phi, which is what presses on a
wheel.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch

from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel.cells import Cells, Rig
from terrain_estimator.discovery.single_wheel.fit import Floats, NearBy, acting
from terrain_estimator.model.rows import PA_PER_UNIT

RANGES = {
    "c": (0.0, 10.0),
    "tan_phi": (0.0, 1.5),
    "n": (0.3, 2.5),
    "k": (1 / 30.0, 30.0),
    "shear_modulus": (1e-4, 0.1),
    "c1": (0.01, 0.99),
    "c2": (-1.0, 1.0),
}
"""Physical ranges: [kPa], [1], [1], shares of the soil file's [1], [m], [1], [1].

They hold dry sands to loams (Wong, Theory of Ground Vehicles, tables 2.3 and 2.4).
"""
MEASURED = ("n", "k", "shear_modulus", "c1", "c2")
"""Constants that the soil file gives, in the order of UNCERTAIN; k is k_c / b + k_phi."""
UNITS_OF_CONSTANTS = {"n": "1", "k": "Pa/m^n", "shear_modulus": "m", "c1": "1", "c2": "1"}
_LOGARITHMIC = ("n", "k", "shear_modulus")


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One unknown, its physical range and what is known of it; all as coordinates."""

    name: str
    low: float
    high: float
    mean: float
    sd: float  # inf: nothing but the range


class FreeLaw:
    """Rows of cells for many values of the unknowns at once."""

    def __init__(self, bed: Rig, given: Hypothesis, hypothesis: Hypothesis) -> None:
        """Take the wheel and soil of one testbed, known effects and those of a finding."""
        self.bed, self._given, self._sought = bed, given, hypothesis
        self._near = NearBy()
        self.coordinates = (*self._soil(), *self._sensors(), *self._effects())
        self.low = np.array([each.low for each in self.coordinates])
        self.high = np.array([each.high for each in self.coordinates])

    def start(self) -> Floats:
        """Return the soil file's constants with everything else in the middle."""
        found = np.array([each.mean for each in self.coordinates])
        return np.clip(found, self.low + 1e-6, self.high - 1e-6)

    def of(self, cells: Cells, values: Floats) -> Floats:
        """Return the rows [V, B, R] for values [V, P]."""
        table = torch.from_numpy(np.ascontiguousarray(values))
        soil = self.bed.soil
        stiffness = torch.exp(table[:, 3:4])
        constants = torch.cat(
            [
                torch.exp(table[:, 2:3]),
                soil.k_c * stiffness,
                soil.k_phi * stiffness,
                torch.exp(table[:, 4:5]),
                table[:, 5:7],
            ],
            1,
        )
        strength = table[:, :2] * torch.tensor([PA_PER_UNIT, 1.0], dtype=torch.float64)
        first = 7 + len(self.bed.sensor_errors)
        last = first + len(self._given.shared().sd)
        effects = [
            *acting(self._given, table[:, first:last], cells),
            *acting(self._sought, table[:, last:], cells, sought=True),
        ]
        found = self._near.states(self.bed, cells, strength, constants, effects)
        return self.bed.read(found, table[:, 7:first]).numpy()

    def constant(self, name: str, coordinates: Floats) -> Floats:
        """Return the values of a soil constant for its coordinates."""
        values = np.exp(coordinates) if name in _LOGARITHMIC else coordinates
        return np.asarray(values * self._stiffness() if name == "k" else values)

    def deviation(self, name: str) -> float:
        """Return the stated deviation of a soil constant."""
        share = self.bed.constants_sd[MEASURED.index(name)]
        measured = self._stiffness() if name == "k" else getattr(self.bed.soil, name)
        return share * abs(float(measured))

    def _stiffness(self) -> float:
        return self.bed.soil.k_c / self.bed.rover.wheel_width + self.bed.soil.k_phi

    def _soil(self) -> list[Coordinate]:
        soil = self.bed.soil
        known = {"n": soil.n, "k": 1.0, "shear_modulus": soil.shear_modulus}
        known |= {"c1": soil.c1, "c2": soil.c2}
        sds = dict(zip(MEASURED, self.bed.constants_sd, strict=True))
        found = []
        for name, (low, high) in RANGES.items():
            if name in _LOGARITHMIC:
                ends = math.log(low), math.log(high)
                found.append(Coordinate(name, *ends, math.log(known[name]), sds[name]))
            elif name in known:
                found.append(Coordinate(name, low, high, known[name], self.deviation(name)))
            else:
                found.append(Coordinate(name, low, high, 0.5 * (low + high), math.inf))
        return found

    def _sensors(self) -> list[Coordinate]:
        return [
            Coordinate(each.name, -4.0 * each.sd, 4.0 * each.sd, 0.0, each.sd)
            for each in self.bed.sensor_errors
        ]

    def _effects(self) -> list[Coordinate]:
        found = []
        for hypothesis in (self._given, self._sought):
            shared = hypothesis.shared()
            for name, low, high, sd in zip(
                _value_names(hypothesis), shared.low, shared.high, shared.sd, strict=True
            ):
                found.append(Coordinate(name, float(low), float(high), 0.0, float(sd)))
        return found


def _value_names(hypothesis: Hypothesis) -> list[str]:
    return [
        name
        for each in hypothesis.effects
        for name in (each.name, *(f"{each.name}: {extra.name}" for extra in each.law.extra))
    ]
