# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every effect by name: what it is, where it comes from, in which rows it shows, and how it acts in the simulation."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from rover_parameters.records import ConfigError
from terramechanics.effects import sensing, soil, vehicle
from terramechanics.simulation.plant import Effect, Size


@dataclass(frozen=True, slots=True)
class Description:
    """One named effect. The size is its one coefficient; 0 is the nominal model."""

    name: str
    sentence: str
    coefficient: str  # name of the size, with its unit
    unit: str
    low: float
    high: float
    rows: tuple[
        str, ...
    ]  # velocity, load, torque, acceleration; of single-wheel data drawbar_pull, sinkage, lateral_force
    source: str
    make: (
        Callable[..., Effect] | None
    )  # of size, and of axle where by_axle; None: a planar rover does not show it
    by_axle: bool = False  # it acts on one axle, which has to be named

    def checked(self, size: float) -> float:
        """``size`` where it is in its physical range. Raises ConfigError that gives the range."""
        if not math.isfinite(size) or not self.low <= size <= self.high:
            limits = f"{self.low:g} to {self.high:g} [{self.unit}]"
            raise ConfigError(
                f"effect {self.name}: size {size:g} is outside its physical range, {limits}"
            )
        return size


BALANCES = ("velocity", "load", "acceleration")
EVERY_ROW = ("velocity", "load", "torque", "acceleration")

EFFECTS = {
    description.name: description
    for description in (
        Description(
            "slope_bias", "The attitude sensor sits tilted, so that the reported pitch is too large by a constant.",
            "slope_bias_rad", "rad", -0.1, 0.1, ("velocity", "load"),
            "mount misalignment of inertial sensors; 0.05 to 1 deg is usual", sensing.SlopeBias,
        ),
        Description(
            "bulldozing", "A sunken wheel pushes a wedge of soil ahead of it, which resists with the square of the depth.",
            "bulldozing_n_per_m2", "N/m^2", 0.0, 2e5, ("velocity", "acceleration", "load", "drawbar_pull"),
            "Bekker 1969; Gee-Clough 1976: resistance from z to z^2", soil.Bulldozing,
        ),
        Description(
            "drive_drag", "Gears and seals take a torque in proportion to wheel rate, which the motor gives and the ground does not get.",
            "drive_drag_n_m_s_per_rad", "N m s/rad", 0.0, 10.0, ("torque",),
            "viscous term of joint friction, Armstrong-Helouvry et al. 1994", vehicle.DriveDrag,
        ),
        Description(
            "coulomb_drag", "Bearings and gears take a constant torque, which the motor gives and the ground does not get.",
            "coulomb_drag_n_m", "N m", 0.0, 10.0, ("torque",),
            "dry term of joint friction, Armstrong-Helouvry et al. 1994", vehicle.CoulombDrag,
        ),
        Description(
            "payload", "The rover carries more (or less) mass at its centre of mass than its file says.",
            "payload_kg", "kg", -80.0, 150.0, BALANCES,
            "Newton; wheel load enters sinkage as W^(2/(2n+1)), Bekker 1969", vehicle.ExtraMass,
        ),
        Description(
            "grousers", "Lugs on the rim shear the soil between them: thrust and torque that grow with slip and saturate.",
            "grouser_thrust_n", "N", 0.0, 200.0, (*EVERY_ROW, "drawbar_pull"),
            "Bekker 1969 (thrust of lugs), Micklethwait 1944", soil.Grousers,
        ),
        Description(
            "slip_sinkage", "A slipping wheel transports soil away and digs itself in: the sinkage exponent grows with slip.",
            "exponent_per_slip", "1", 0.0, 2.0, (*EVERY_ROW, "drawbar_pull", "sinkage"),
            "Ding, Gao, Deng et al. 2011: n = n0 + n1 s", soil.SlipSinkage,
        ),
        Description(
            "multipass", "A wheel that follows rolls in the compacted rut of the wheels before it, on stiffer soil.",
            "stiffening_per_pass", "1", 0.0, 4.0, EVERY_ROW,
            "Wong 2008, repetitive loading of terrain", soil.Multipass,
        ),
        Description(
            "odometry_scale", "Slip is computed with a wheel radius that is too large by a constant share.",
            "radius_error", "1", -0.2, 0.2, EVERY_ROW,
            "Borenstein and Feng 1996 (UMBmark): unequal and mistaken wheel diameters", sensing.OdometryScale,
        ),
        Description(
            "failed_wheel", "The coupling of one axle's motors passes on a part of the torque only; with 1 its wheels roll freely.",
            "lost_torque_share", "1", 0.0, 1.0, EVERY_ROW,
            "drive failures of the Mars Exploration Rovers; contact as Wong and Reece 1967", vehicle.FailedWheel, by_axle=True,
        ),
        Description(
            "sinkage_bias", "The camera finds the edge of the soil on the rim too high by a constant.",
            "sinkage_bias_m", "m", -0.02, 0.02, (*EVERY_ROW, "sinkage"),
            "Brooks and Iagnemma 2009 (visual sinkage measurement)", sensing.SinkageBias,
        ),
        Description(
            "latency", "Slip and sinkage come from images and are reported as present when they are older.",
            "latency_s", "s", 0.0, 1.0, EVERY_ROW,
            "pipelines of visual odometry: 20 to 300 ms", sensing.Latency,
        ),
        Description(
            "rate_dependence", "Soil that is loaded faster is stiffer (or softer): a power of the circumferential speed.",
            "speed_exponent", "1", -1.0, 1.0, (*EVERY_ROW, "drawbar_pull", "sinkage"),
            "Pope 1969; measurements with wheels of 0.01 to 1 m/s", soil.RateDependence,
        ),
        Description(
            "exit_angle", "Soil springs back behind the axle, so that contact does not end below it.",
            "rebound_share", "1", 0.0, 1.0, (*EVERY_ROW, "drawbar_pull", "sinkage"),
            "Ishigami, Miwa, Nagatani and Yoshida 2007: theta_r = acos(1 - lambda z / r)", soil.ExitAngle,
        ),
        Description(
            "lateral_bulldozing", "The side of a wheel that moves at a slip angle ploughs through the soil.",
            "side_resistance_n_per_m3", "N/m^3", 0.0, 4e5, ("lateral_force",),
            "Hegedus 1960; Ishigami, Miwa, Nagatani and Yoshida 2007", None,
        ),
    )
}  # fmt: skip
"""All effects by name. lateral_bulldozing (``soil.LateralBulldozing``) is for a single wheel alone: a planar rover has no lateral force."""


def describe(name: str) -> Description:
    """The effect of that name. Raises ConfigError that lists the names."""
    if name not in EFFECTS:
        raise ConfigError(f"unknown effect {name!r}; known effects are {', '.join(EFFECTS)}")
    return EFFECTS[name]


def make_effect(name: str, size: Size, axle: int | None = None) -> Effect:
    """The named effect as one that acts in the simulation. ``size`` is one number, or a tensor [batch]; 0 has no effect.

    ``axle`` goes to an effect of one axle, 0 is the front. Raises ConfigError for a name that is
    unknown or not simulated.
    """
    description = describe(name)
    if description.make is None:
        raise ConfigError(f"effect {name} acts sideways, which a planar rover does not simulate")
    return (
        description.make(size)
        if axle is None or not description.by_axle
        else description.make(size, axle)
    )
