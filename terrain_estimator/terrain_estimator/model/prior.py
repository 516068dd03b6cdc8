# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The knowledge before any measurement: the rover, the spread of ground and of soil constants."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from rover_parameters.records import number
from terramechanics.contact.stresses import CONSTANTS
from terramechanics.vehicle.suspension import Geometry


class RoverBody(NamedTuple):
    """The numbers of a rover that the rows need."""

    axles: int
    wheels_per_axle: int
    mass_kg: float
    gravity: float  # [m/s^2]
    radius_m: float
    width_m: float
    geometry: Geometry


@dataclass(frozen=True, slots=True)
class Prior:
    """Means and standard deviations before any measurement."""

    cohesion_pa: float = number("prior mean of the cohesion", "Pa")
    cohesion_sd_pa: float = number(
        "prior standard deviation of the cohesion", "Pa", 0.0, exclusive=True
    )
    tan_phi: float = number("prior mean of the tangent of the friction angle")
    tan_phi_sd: float = number("prior standard deviation of tan phi", "1", 0.0, exclusive=True)
    mass_sd: float = number(
        "standard deviation of the rover's mass, relative to the rover file's",
        "1",
        0.0,
        exclusive=True,
    )
    centre_of_mass_sd: float = number(
        "standard deviation of the centre of mass along the body", "m", 0.0, exclusive=True
    )
    acceleration_bias_sd: float = number(
        "standard deviation of the imu's acceleration bias", "m/s^2", 0.0, exclusive=True
    )
    constants_sd: float = number(
        "relative standard deviation of each soil constant; 0 makes them exact", "1", 0.0
    )


DEFAULT_PRIOR = Prior(
    cohesion_pa=2750.0,
    cohesion_sd_pa=1300.0,
    tan_phi=0.6,
    tan_phi_sd=0.22,
    acceleration_bias_sd=0.02,
    mass_sd=0.01,
    centre_of_mass_sd=0.02,
    constants_sd=0.05 / 3**0.5,
)
"""The prior of a training without another one, and of a search without a model.

Mean and deviation of the benchmarks' draws: c uniform in 0.5 to 5 kPa, phi in 15 to 45 deg,
constants within 5 %.
"""

UNCERTAIN = ("n", "k_phi", "shear_modulus", "c1", "c2")
"""Soil constants that can be parameters.

k_c acts through the stiffness k_c / b + k_phi alone, so k_phi carries both.
"""


def uncertain_constants(constants: Tensor, relative_sd: float, width: float) -> Tensor:
    """Return prior deviations [K, M, 6] of the constants UNCERTAIN of K soils [K, 6].

    Each of the six is known to ``relative_sd`` [1]. M = 0 where that is zero.
    """
    if relative_sd == 0.0:
        return torch.zeros(constants.shape[0], 0, 6, dtype=torch.float64)
    sd = relative_sd * constants
    sd[:, 2] = torch.hypot(sd[:, 1] / width, sd[:, 2])
    return torch.diag_embed(sd)[:, [CONSTANTS.index(name) for name in UNCERTAIN]]
