# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil: the constants of the pressure-sinkage and shear laws, and its strength."""

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rover_parameters.records import ConfigError, entry, nearest, number, shortened

if TYPE_CHECKING:
    from torch import Tensor

CONSTANTS = ("n", "k_c", "k_phi", "shear_modulus", "c1", "c2")
"""Order of the soil constants in a tensor: [1], [Pa/m^(n-1)], [Pa/m^n], [m], [1], [1]."""
WONG_REECE, SCM, LINEAR_STRESS = "wong_reece", "scm", "linear_stress"
LAWS = (WONG_REECE, SCM, LINEAR_STRESS)
"""Contact laws by name, see terramechanics.contact.laws."""


@dataclass(frozen=True, slots=True)
class Soil:
    """One soil in SI units (Bekker's k_c and k_phi, Wong and Reece 1967).

    ``law`` names the contact law of wheels on it. Under ``scm`` c1 is the share of the sinkage by
    which the ground springs back, and c2 is 0: the largest stress is below the axle.

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
    law: str = entry("contact law of wheels: wong_reece, scm or linear_stress", WONG_REECE)

    def __post_init__(self) -> None:
        """Check the law. Raises ConfigError."""
        if self.law not in LAWS:
            raise ConfigError(
                f"law: {shortened(self.law)} is no contact law: {nearest(self.law, LAWS)}"
            )
        if self.law == SCM and self.c2 != 0.0:
            raise ConfigError(
                f"c2: {self.c2:g} has no meaning under law scm, whose largest stress stays below"
                " the axle: give 0.0, and as c1 the share of the sinkage by which the ground"
                " springs back"
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

    def constants(self) -> "Tensor":
        """Return the soil constants in the order of CONSTANTS, shape [6], float64."""
        import torch  # noqa: PLC0415 (a node reads soils without torch)

        return torch.tensor([getattr(self, name) for name in CONSTANTS], dtype=torch.float64)

    def strength(self) -> "Tensor":
        """Return cohesion [Pa] and tan(phi) [1], shape [2], float64."""
        import torch  # noqa: PLC0415

        return torch.tensor([self.cohesion, self.tan_phi], dtype=torch.float64)

    def with_values(self, **values: float | str) -> "Soil":
        """Return a copy with some of its values replaced. Raises ConfigError."""
        return dataclasses.replace(self, **values)  # type: ignore[arg-type]
