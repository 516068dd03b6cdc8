# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every hidden effect by name, with the size at which it matters and the right verdict.

Nothing here comes from the library of named effects: names are all that the two share. See
matters.py for the sizes.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.simulation.plant import Effect
from tests.hidden import outside, sensing, soil, vehicle


@dataclass(frozen=True, slots=True)
class Draw:
    """Random properties of the effect in each episode of a batch, besides its size.

    Episodes of one case follow each other.
    """

    sizes: Tensor  # [batch]
    axle: Tensor  # [batch] the same within a case
    place: Tensor  # [batch] [m] somewhere in the first half of the track


@dataclass(frozen=True, slots=True)
class Hidden:
    """One hidden effect."""

    law: str
    unit: str
    matters: float  # size at which it matters, see matters.py
    make: Callable[[Draw], Effect]
    signed: bool = False  # its sign is drawn
    known: bool = True  # the library has an effect of this name


def _sized(kind: Callable[[Tensor], Effect]) -> Callable[[Draw], Effect]:
    return lambda draw: kind(draw.sizes)


GENERATORS = {
    "slope_bias": Hidden(
        "inertial unit tilted, less while cold",
        "rad",
        0.02,
        _sized(sensing.TiltedUnit),
        signed=True,
    ),
    "bulldozing": Hidden("Rankine's passive wedge", "1", 0.25, _sized(soil.PassiveWedge)),
    "drive_drag": Hidden("shear-thinning grease", "N m s/rad", 0.2, _sized(vehicle.Grease)),
    "coulomb_drag": Hidden("Coulomb with Stribeck's rise", "N m", 0.27, _sized(vehicle.DryBearing)),
    "payload": Hidden("load on the deck", "kg", 15.0, _sized(vehicle.DeckLoad)),
    "grousers": Hidden("Bekker's lug thrust", "m", 0.0075, _sized(soil.LugThrust)),
    "slip_sinkage": Hidden("Lyasko's depth factor", "1", 0.25, _sized(soil.Excavation)),
    "multipass": Hidden("elastic reload in the rut", "1", 0.15, _sized(soil.Rut)),
    "odometry_scale": Hidden(
        "wheels worn unevenly", "1", 0.012, _sized(sensing.UnevenWear), signed=True
    ),
    "failed_wheel": Hidden(
        "worn coupling of one axle",
        "1",
        0.85,
        lambda draw: vehicle.WornCoupling(draw.sizes, draw.axle),
    ),
    "sinkage_bias": Hidden(
        "rim angle read wrong", "rad", 0.035, _sized(sensing.RimAngle), signed=True
    ),
    "latency": Hidden("low-pass filter", "s", 0.25, _sized(sensing.Smoothed)),
    "rate_dependence": Hidden(
        "logarithm of the penetration rate", "1", 0.15, _sized(soil.PenetrationRate), signed=True
    ),
    "exit_angle": Hidden(
        "share of the entry angle, growing with slip", "1", 0.1, _sized(soil.TrailingContact)
    ),
    "tether": Hidden(
        "pull that grows with distance", "N", 20.0, _sized(outside.Tether), known=False
    ),
    "gain_drift": Hidden(
        "torque gain that drifts", "1", 0.1, _sized(outside.GainDrift), signed=True, known=False
    ),
    "crust": Hidden(
        "crust that breaks",
        "1",
        0.4,
        lambda draw: outside.Crust(draw.sizes, draw.place),
        known=False,
    ),
    "slow_clock": Hidden(
        "body's clock loses time", "1", 0.12, _sized(outside.SlowClock), known=False
    ),
}
"""All hidden effects by name; the first fourteen have the name of a library effect."""


def sizes_of(hidden: Hidden, share: float, cases: int, generator: torch.Generator) -> Tensor:
    """Draw the size of every case [cases]: ``share`` of the one that matters, within 15 %.

    The sign is drawn, too, where the effect has one.
    """
    spread = 0.85 + 0.3 * torch.rand(cases, generator=generator, dtype=torch.float64)
    flip = torch.rand(cases, generator=generator, dtype=torch.float64) < 0.5
    sign = torch.where(flip & torch.tensor(hidden.signed), -1.0, 1.0)
    return hidden.matters * share * spread * sign
