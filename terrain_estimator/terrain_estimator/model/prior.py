# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a model is told before anything is measured: the rover, the spread of ground, and how well a soil is known."""

from typing import NamedTuple

import torch
from torch import Tensor

from terramechanics.contact.stresses import CONSTANTS
from terramechanics.vehicle.suspension import Geometry


class RoverBody(NamedTuple):
    """What the rows need of a rover."""

    axles: int
    wheels_per_axle: int
    mass_kg: float
    gravity: float  # [m/s^2]
    radius_m: float
    width_m: float
    geometry: Geometry


class Prior(NamedTuple):
    """Means and standard deviations before anything was measured."""

    cohesion_pa: float
    cohesion_sd_pa: float
    tan_phi: float
    tan_phi_sd: float
    mass_sd: float  # [1] of the rover's mass, relative to the rover file's
    centre_of_mass_sd: float  # [m] of its centre of mass along the body
    acceleration_bias_sd: float  # [m/s^2] of the imu
    constants_sd: float  # [1] of each soil constant, relative; 0 takes them for exact


UNCERTAIN = ("n", "k_phi", "shear_modulus", "c1", "c2")
"""Soil constants that can be parameters; k_c acts through the stiffness k_c / b + k_phi alone, so k_phi carries both."""


def uncertain_constants(constants: Tensor, relative_sd: float, width: float) -> Tensor:
    """Prior deviations [K, M, 6] of the constants UNCERTAIN of K soils [K, 6], where each of the six is known to ``relative_sd``.

    M = 0 where that is zero.
    """
    if relative_sd == 0.0:
        return torch.zeros(constants.shape[0], 0, 6, dtype=torch.float64)
    sd = relative_sd * constants
    sd[:, 2] = torch.hypot(sd[:, 1] / width, sd[:, 2])
    return torch.diag_embed(sd)[:, [CONSTANTS.index(name) for name in UNCERTAIN]]
