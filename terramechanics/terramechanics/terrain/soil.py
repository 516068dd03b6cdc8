# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil: the constants of the pressure-sinkage and shear laws, and its strength."""

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from rover_parameters.records import ConfigError, number
from terramechanics.contact.stresses import CONSTANTS


@dataclass(frozen=True, slots=True)
class Soil:
    """One soil in SI units (Bekker's k_c and k_phi, Wong and Reece 1967).

    The moduli depend on n: depths are in metres. k_c may be negative, as fits of two plates often
    give it: what presses on a wheel of width b is k_c / b + k_phi (:meth:`for_wheel`).
    """

    name: str
    n: float = number("sinkage exponent", "1", 0.0, 3.0, exclusive=True)
    k_c: float = number("cohesive modulus of sinkage", "Pa/m^(n-1)")
    k_phi: float = number("frictional modulus of sinkage", "Pa/m^n", 0.0, exclusive=True)
    shear_modulus: float = number("shear deformation modulus K", "m", 0.0, 1.0, exclusive=True)
    c1: float = number(
        "place of the largest normal stress, theta_m = (c1 + c2 i) theta_1",
        "1",
        0.0,
        1.0,
        exclusive=True,
    )
    c2: float = number("change of that place with slip", "1", -1.0, 1.0)
    cohesion: float = number("cohesion c, a typical value", "Pa", 0.0)
    tan_phi: float = number(
        "tangent of the internal friction angle, a typical value", "1", 0.0, 2.0
    )

    def for_wheel(self, width: float) -> "Soil":
        """Return this soil, which carries wheels of a ``width`` [m]; raises ConfigError if not."""
        stiffness = self.k_c / width + self.k_phi
        if stiffness <= 0.0:
            raise ConfigError(
                f"soil {self.name}: k_c / b + k_phi is {stiffness:.4g} Pa/m^n for wheels of b ="
                f" {width:g} m, so the soil would carry nothing: measure with plates about as wide"
                " as the wheel"
            )
        return self

    def constants(self) -> Tensor:
        """Return the soil constants in the order of CONSTANTS, shape [6], float64."""
        return torch.tensor([getattr(self, name) for name in CONSTANTS], dtype=torch.float64)

    def strength(self) -> Tensor:
        """Return cohesion [Pa] and tan(phi) [1], shape [2], float64."""
        return torch.tensor([self.cohesion, self.tan_phi], dtype=torch.float64)

    def with_values(self, **values: float) -> "Soil":
        """Return a copy with some of its numbers replaced."""
        return dataclasses.replace(self, **values)  # type: ignore[arg-type]
