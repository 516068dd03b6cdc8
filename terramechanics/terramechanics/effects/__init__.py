# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The registry of named effects: sentence, size, range, rows that show it, source, and law."""

import math
from dataclasses import dataclass
from functools import partial

import torch

from rover_parameters.records import ConfigError
from terramechanics.effects import (
    contact,
    depth,
    grousers,
    loaded_lugs,
    lugs,
    sensing,
    soil,
    vehicle,
    wedges,
)
from terramechanics.effects.law import Law
from terramechanics.effects.simulated import SimulatedEffect
from terramechanics.simulation.plant import Size


@dataclass(frozen=True, slots=True)
class Competing:
    """Another law of the literature for the same effect, with a size of its own."""

    name: str
    unit: str
    high: float  # largest size; the smallest is 0
    source: str
    law: type[Law]


@dataclass(frozen=True, slots=True)
class Description:
    """One named effect. The size is its one coefficient; 0 is the nominal model."""

    name: str
    sentence: str
    coefficient: str  # name of the size, with its unit
    unit: str
    low: float
    high: float
    # velocity, load, torque, acceleration; of one wheel drawbar_pull, sinkage, lateral_force
    rows: tuple[str, ...]
    source: str
    law: type[Law]
    # what tables of one wheel weigh in its place: their few settings do not tell its extra values
    of_one_wheel: type[Law] | None = None
    by_axle: bool = False  # it acts on one axle, which has to be named
    planar: bool = True  # a planar rover shows it
    competing: tuple[Competing, ...] = ()  # which tables of one wheel weigh beside ``law``

    def values(self, size: Size) -> torch.Tensor:
        """Return the values [batch or 1, V] of its law at ``size``, the extra ones zero."""
        sizes = torch.as_tensor(size, dtype=torch.float64).flatten()
        value = torch.tensor(list(map(self.law.value_of, sizes.tolist())), dtype=torch.float64)
        return torch.nn.functional.pad(value.unsqueeze(1), [0, len(self.law.extra)])

    def acting(self, values: torch.Tensor, axle: int | None = None) -> SimulatedEffect:
        """Return the effect with ``values`` [batch or 1, V] of its law for a simulation."""
        return SimulatedEffect(partial(self.law, axle=axle), values)

    def checked(self, size: float) -> float:
        """Return ``size`` in its physical range. Raises ConfigError that gives the range."""
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
            name="slope_bias",
            sentence=(
                "The attitude sensor sits tilted, so that the reported pitch is too large by a "
                "constant; the accelerometer may be tilted with it."
            ),
            coefficient="slope_bias_rad",
            unit="rad",
            low=-0.1,
            high=0.1,
            rows=("velocity", "acceleration", "load"),
            source="mount misalignment of inertial sensors; 0.05 to 1 deg is usual",
            law=sensing.SlopeBias,
        ),
        Description(
            name="bulldozing",
            sentence=(
                "A sunken wheel pushes a wedge of soil ahead of it, which resists with the depth "
                "by cohesion and with its square by friction."
            ),
            coefficient="bulldozing_n_per_m2",
            unit="N/m^2",
            low=0.0,
            high=2e5,
            rows=("velocity", "acceleration", "load", "drawbar_pull"),
            source="Rankine 1857; Bekker 1969; Gee-Clough 1976: resistance from z to z^2",
            law=soil.PassiveBulldozing,
            of_one_wheel=soil.Bulldozing,
            competing=(
                Competing(
                    name="hegedus_wedge",
                    unit="1",
                    high=2.0,
                    source="Hegedus 1960; Ishigami et al. 2007: passive pressure on a blade",
                    law=wedges.HegedusWedge,
                ),
                Competing(
                    name="bekker_wedge",
                    unit="1",
                    high=2.0,
                    source="Bekker 1969, Terzaghi 1943: general shear failure ahead of a wheel",
                    law=wedges.BekkerWedge,
                ),
            ),
        ),
        Description(
            name="drive_drag",
            sentence=(
                "Gears and seals take a torque in proportion to wheel rate, which the motor gives "
                "and the ground does not get."
            ),
            coefficient="drive_drag_n_m_s_per_rad",
            unit="N m s/rad",
            low=0.0,
            high=10.0,
            rows=("torque",),
            source="viscous term of joint friction, Armstrong-Helouvry et al. 1994",
            law=vehicle.DriveDrag,
        ),
        Description(
            name="coulomb_drag",
            sentence=(
                "Bearings and gears take a constant torque, which the motor gives and the ground "
                "does not get."
            ),
            coefficient="coulomb_drag_n_m",
            unit="N m",
            low=0.0,
            high=10.0,
            rows=("torque",),
            source="dry term of joint friction, Armstrong-Helouvry et al. 1994",
            law=vehicle.CoulombDrag,
        ),
        Description(
            name="payload",
            sentence=(
                "The rover carries more (or less) mass at its centre of mass than its file says."
            ),
            coefficient="payload_kg",
            unit="kg",
            low=-80.0,
            high=150.0,
            rows=BALANCES,
            source="Newton; wheel load enters sinkage as W^(2/(2n+1)), Bekker 1969",
            law=vehicle.ExtraMass,
        ),
        Description(
            name="grousers",
            sentence=(
                "Lugs on the rim shear the soil between them: thrust and torque that grow with "
                "load, cohesion and slip, where they saturate."
            ),
            coefficient="grouser_thrust_n",
            unit="N",
            low=0.0,
            high=200.0,
            rows=(*EVERY_ROW, "drawbar_pull"),
            source="Bekker 1969 (thrust of lugs), Micklethwait 1944",
            law=grousers.LoadedGrousers,
            of_one_wheel=grousers.Grousers,
            competing=(
                Competing(
                    name="shear_at_tips",
                    unit="1",
                    high=0.5,
                    source="Ding et al. 2009; Wong 2010: soil is sheared at the lugs' tips",
                    law=lugs.ShearAtTips,
                ),
                Competing(
                    name="passive_pressure",
                    unit="Pa",
                    high=2e4,
                    source="Bekker 1969, Terzaghi 1943: passive earth pressure of lugs in the soil",
                    law=lugs.PassivePressure,
                ),
                Competing(
                    name="lug_sides",
                    unit="m",
                    high=0.05,
                    source="Micklethwait 1944, Bekker 1969: shear along the sides of lugs",
                    law=loaded_lugs.LugSides,
                ),
                Competing(
                    name="spaced_lugs",
                    unit="1",
                    high=0.5,
                    source="Terzaghi 1943, Wong 2008: passive pressure of each lug below the load",
                    law=loaded_lugs.SpacedLugs,
                ),
            ),
        ),
        Description(
            name="slip_sinkage",
            sentence=(
                "A slipping wheel transports soil away and digs itself in: the sinkage exponent "
                "grows with slip."
            ),
            coefficient="exponent_per_slip",
            unit="1",
            low=0.0,
            high=2.0,
            rows=(*EVERY_ROW, "drawbar_pull", "sinkage"),
            source="Ding, Gao, Deng et al. 2011: n = n0 + n1 s",
            law=soil.DugSinkage,
            of_one_wheel=soil.SlipSinkage,
            competing=(
                Competing(
                    name="sinkage_factor",
                    unit="1",
                    high=4.0,
                    source="Lyasko 2010: z = z0 (1 + s) / (1 - 0.5 s)",
                    law=soil.SinkageFactor,
                ),
                Competing(
                    name="sinkage_growth",
                    unit="1",
                    high=4.0,
                    source="Lyasko 2010, linear form as in Lines 2021: z = z0 (1 + S s)",
                    law=depth.SinkageGrowth,
                ),
            ),
        ),
        Description(
            name="multipass",
            sentence=(
                "A wheel that follows rolls in the compacted rut of the wheels before it, on "
                "stiffer soil."
            ),
            coefficient="stiffening_per_pass",
            unit="1",
            low=0.0,
            high=4.0,
            rows=EVERY_ROW,
            source="Wong 2008, repetitive loading of terrain",
            law=soil.Multipass,
        ),
        Description(
            name="odometry_scale",
            sentence="Slip is computed with a wheel radius that is too large by a constant share.",
            coefficient="radius_error",
            unit="1",
            low=-0.2,
            high=0.2,
            rows=EVERY_ROW,
            source="Borenstein and Feng 1996 (UMBmark): unequal and mistaken wheel diameters",
            law=sensing.OdometryScale,
        ),
        Description(
            name="failed_wheel",
            sentence=(
                "The coupling of one axle's motors passes on a part of the torque only; with 1 its "
                "wheels roll freely."
            ),
            coefficient="lost_torque_share",
            unit="1",
            low=0.0,
            high=1.0,
            rows=EVERY_ROW,
            source="drive failures of the Mars Exploration Rovers; contact as Wong and Reece 1967",
            law=vehicle.FailedWheel,
            by_axle=True,
        ),
        Description(
            name="sinkage_bias",
            sentence="The camera finds the edge of the soil on the rim too high by a constant.",
            coefficient="sinkage_bias_m",
            unit="m",
            low=-0.02,
            high=0.02,
            rows=(*EVERY_ROW, "sinkage"),
            source="Brooks and Iagnemma 2009 (visual sinkage measurement)",
            law=sensing.SinkageBias,
        ),
        Description(
            name="latency",
            sentence=(
                "Slip and sinkage come from images and are reported as present when they are older."
            ),
            coefficient="latency_s",
            unit="s",
            low=0.0,
            high=1.0,
            rows=EVERY_ROW,
            source="pipelines of visual odometry: 20 to 300 ms",
            law=sensing.Latency,
        ),
        Description(
            name="rate_dependence",
            sentence=(
                "Soil that is loaded faster is stiffer (or softer): a power of the circumferential "
                "speed."
            ),
            coefficient="speed_exponent",
            unit="1",
            low=-1.0,
            high=1.0,
            rows=(*EVERY_ROW, "drawbar_pull", "sinkage"),
            source="Pope 1969; measurements with wheels of 0.01 to 1 m/s",
            law=soil.RateDependence,
        ),
        Description(
            name="exit_angle",
            sentence="Soil springs back behind the axle, so that contact does not end below it.",
            coefficient="rebound_share",
            unit="1",
            low=0.0,
            high=1.0,
            rows=(*EVERY_ROW, "drawbar_pull", "sinkage"),
            source="Ishigami, Miwa, Nagatani and Yoshida 2007: theta_r = acos(1 - lambda z / r)",
            law=soil.ExitAngle,
            competing=(
                Competing(
                    name="exit_by_entry",
                    unit="1",
                    high=1.0,
                    source="Pavlov and Johnson (3d-terramechanics): theta_r = theta_f (b0 + b1 s)",
                    law=depth.ExitByEntry,
                ),
            ),
        ),
        Description(
            name="contact_law_scm",
            sentence=(
                "The ground follows the contact law scm: it presses along its normal, counts shear"
                " at a fixed place, and keeps ruts and shear for the wheels behind."
            ),
            coefficient="share_of_scm",
            unit="1",
            low=0.0,
            high=1.0,
            rows=EVERY_ROW,
            source="Krenn and Hirzinger 2009; Tasora et al. 2019 (SCM)",
            law=contact.ScmContact,
        ),
        Description(
            name="lateral_bulldozing",
            sentence="The side of a wheel that moves at a slip angle ploughs through the soil.",
            coefficient="side_resistance_n_per_m3",
            unit="N/m^3",
            low=0.0,
            high=4e5,
            rows=("lateral_force",),
            source="Hegedus 1960; Ishigami, Miwa, Nagatani and Yoshida 2007",
            law=soil.LateralBulldozing,
            planar=False,
            competing=(
                Competing(
                    name="hegedus_side",
                    unit="1",
                    high=2.0,
                    source="Hegedus 1960; Ishigami et al. 2007, with cohesion",
                    law=wedges.HegedusSide,
                ),
            ),
        ),
    )
}
"""All effects by name."""


def describe(name: str) -> Description:
    """Return the effect of that name. Raises ConfigError that lists the names."""
    if name not in EFFECTS:
        raise ConfigError(f"unknown effect {name!r}; known effects are {', '.join(EFFECTS)}")
    return EFFECTS[name]


def make_effect(name: str, size: Size, axle: int | None = None) -> SimulatedEffect:
    """Return the named effect for a simulation.

    ``size`` is a number or a tensor [batch]; 0 has no effect. ``axle`` goes to an effect of one
    axle, 0 is the front. Raises ConfigError for a name that is unknown or not simulated.
    """
    description = describe(name)
    if not description.planar:
        raise ConfigError(f"effect {name} acts sideways, which a planar rover does not simulate")
    return description.acting(description.values(size), axle)
