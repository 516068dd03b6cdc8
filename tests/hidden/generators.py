# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every hidden effect by name, with the size at which it matters and the right verdict.

Nothing here comes from the library of named effects: names are all that the two share. The sizes
that matter are those of matters.py. Sizes are drawn from ranges of their own, which begin about
there and end where a rover still drives.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.simulation.plant import Effect
from terramechanics.vehicle.rover import Rover
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
    low: float  # sizes that are drawn lie log-uniformly between these, see sizes_of
    high: float
    make: Callable[[Draw], Effect]
    signed: bool = False  # its sign is drawn
    known: bool = True  # the library has an effect of this name
    scale: str = ""  # of a rover to which drawn sizes are in proportion, see SCALES


def _sized(kind: Callable[[Tensor], Effect]) -> Callable[[Draw], Effect]:
    return lambda draw: kind(draw.sizes)


GENERATORS = {
    "slope_bias": Hidden(
        "inertial unit tilted, less while cold",
        "rad",
        0.02,
        0.015,
        0.045,
        _sized(sensing.TiltedUnit),
        signed=True,
    ),
    "bulldozing": Hidden("Rankine's passive wedge", "1", 0.25, 0.2, 0.7, _sized(soil.PassiveWedge)),
    "drive_drag": Hidden(
        "shear-thinning grease",
        "N m s/rad",
        0.2,
        0.16,
        0.55,
        _sized(vehicle.Grease),
        scale="torque",
    ),
    "coulomb_drag": Hidden(
        "Coulomb with Stribeck's rise",
        "N m",
        0.27,
        0.2,
        0.7,
        _sized(vehicle.DryBearing),
        scale="torque",
    ),
    "payload": Hidden(
        "load on the deck", "kg", 15.0, 12, 40, _sized(vehicle.DeckLoad), scale="mass"
    ),
    "grousers": Hidden(
        "passive pressure on short lugs",
        "m",
        0.0025,
        0.002,
        0.006,
        _sized(soil.LugFaces),
        scale="radius",
    ),
    "slip_sinkage": Hidden(
        "hole dug by the rim, half fallen in", "1", 0.2, 0.15, 0.45, _sized(soil.Excavation)
    ),
    "multipass": Hidden("elastic reload in the rut", "1", 0.15, 0.12, 0.4, _sized(soil.Rut)),
    "odometry_scale": Hidden(
        "wheels worn unevenly", "1", 0.012, 0.01, 0.03, _sized(sensing.UnevenWear), signed=True
    ),
    "failed_wheel": Hidden(
        "worn coupling of one axle",
        "1",
        0.85,
        0.6,
        0.95,
        lambda draw: vehicle.WornCoupling(draw.sizes, draw.axle),
    ),
    "sinkage_bias": Hidden(
        "rim angle read wrong", "rad", 0.035, 0.028, 0.08, _sized(sensing.RimAngle), signed=True
    ),
    "latency": Hidden("low-pass filter", "s", 0.25, 0.2, 0.55, _sized(sensing.Smoothed)),
    "rate_dependence": Hidden(
        "logarithm of the penetration rate",
        "1",
        0.15,
        0.12,
        0.35,
        _sized(soil.PenetrationRate),
        signed=True,
    ),
    "exit_angle": Hidden(
        "share of the entry angle, growing with slip",
        "1",
        0.1,
        0.08,
        0.22,
        _sized(soil.TrailingContact),
    ),
    "tether": Hidden(
        "pull that grows with distance",
        "N",
        20.0,
        16,
        45,
        _sized(outside.Tether),
        known=False,
        scale="mass",
    ),
    "gain_drift": Hidden(
        "torque gain that drifts",
        "1",
        0.1,
        0.08,
        0.25,
        _sized(outside.GainDrift),
        signed=True,
        known=False,
    ),
    "crust": Hidden(
        "crust that breaks",
        "1",
        0.4,
        0.3,
        0.9,
        lambda draw: outside.Crust(draw.sizes, draw.place),
        known=False,
    ),
    "rocks": Hidden(
        "buried rocks",
        "1",
        0.2,
        0.15,
        0.6,
        lambda draw: outside.Rocks(draw.sizes, draw.place),
        known=False,
    ),
    "wheel_flex": Hidden(
        "wheel that flattens",
        "1",
        0.02,
        0.015,
        0.06,
        _sized(outside.FlexibleWheel),
        known=False,
    ),
    "current_limit": Hidden(
        "torque sensor that saturates",
        "1/(N m)",
        0.005,
        0.004,
        0.015,
        _sized(outside.CurrentLimit),
        known=False,
        scale="per_torque",
    ),
    "slow_clock": Hidden(
        "body's clock loses time", "1", 0.12, 0.1, 0.25, _sized(outside.SlowClock), known=False
    ),
}
"""All hidden effects by name; the first fourteen have the name of a library effect."""


SCALES: dict[str, Callable[[Rover], float]] = {
    "": lambda _: 1.0,
    "mass": lambda rover: rover.mass * rover.gravity / 688.2,
    "radius": lambda rover: rover.wheel_radius / 0.13,
    "torque": lambda rover: rover.mass * rover.gravity * rover.wheel_radius / 89.47,
    "per_torque": lambda rover: 89.47 / (rover.mass * rover.gravity * rover.wheel_radius),
}
"""Scales of a rover, in those of the one whose sizes the ranges are [1]."""


def sizes_of(
    hidden: Hidden, share: float | None, cases: int, generator: torch.Generator, scale: float = 1.0
) -> Tensor:
    """Draw the size of every case [cases]: ``share`` of the one that matters, within 15 %.

    Without a share it is drawn log-uniformly from the range of the law, times ``scale``. The sign
    is drawn, too, where the effect has one.
    """
    drawn = torch.rand(cases, generator=generator, dtype=torch.float64)
    flip = torch.rand(cases, generator=generator, dtype=torch.float64) < 0.5
    sign = torch.where(flip & torch.tensor(hidden.signed), -1.0, 1.0)
    if share is None:
        return scale * hidden.low * (hidden.high / hidden.low) ** drawn * sign
    return hidden.matters * share * (0.85 + 0.3 * drawn) * sign
