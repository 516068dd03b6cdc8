# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator's parameters: names, meanings, units, ranges and defaults."""

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from rover_parameters.records import entry, number
from terramechanics.terrain.soil import Soil

FOLLOW, FOLLOW_WHEELS = "cmd_vel", "wheel_commands"
"""The schedule that follows velocity commands."""
UNDISTURBED, LOCAL = "undisturbed", "local"
SINKAGE_REFERENCES = (UNDISTURBED, LOCAL)
"""Grounds that sinkages are measured from."""


def _override(name: str) -> Any:  # noqa: ANN401 (a dataclass field of type float)
    """Return the field of Soil with that name, with nan as its default."""
    original = next(item for item in dataclasses.fields(Soil) if item.name == name)
    return field(
        default=math.nan,
        metadata={
            **original.metadata,
            "description": f"{original.metadata['description']}; nan: the soil's",
        },
    )


@dataclass(frozen=True, slots=True)
class SoilOverrides:
    """Values that replace those of the soil; nan keeps the soil's."""

    n: float = _override("n")
    k_c: float = _override("k_c")
    k_phi: float = _override("k_phi")
    shear_modulus: float = _override("shear_modulus")
    c1: float = _override("c1")
    c2: float = _override("c2")
    cohesion: float = _override("cohesion")
    tan_phi: float = _override("tan_phi")

    def given(self) -> dict[str, float]:
        """Return the values that are not nan."""
        return {
            name: value for name, value in dataclasses.asdict(self).items() if not math.isnan(value)
        }


@dataclass(frozen=True, slots=True)
class GroundChange:
    """A second soil further along the track."""

    soil: str = entry("soil beyond the change, a name or a YAML file; empty: no change", "")
    position: float = number(
        "position along the track at which the change begins", "m", 0.0, 1e6, default=5.0
    )
    transition: float = number(
        "length of the transition; 0: a sharp change", "m", 0.0, 1e6, default=0.0
    )


@dataclass(frozen=True, slots=True)
class SimulatorConfig:
    """Parameters of the simulator."""

    rover: str = entry("rover, a name or a YAML file", "mars_rover")
    soil: str = entry("soil, a name or a YAML file", "loose_sand")
    soil_overrides: SoilOverrides = field(default_factory=SoilOverrides)
    change: GroundChange = field(default_factory=GroundChange)
    schedule: str = entry(
        "drive: S1, S2, S3, S4, or cmd_vel to follow velocity commands; with steering also"
        " wheel_commands, to follow rates and steering angles of every wheel",
        "S1",
    )
    profile: str = entry(
        "terrain: flat, hills, ramp or step; empty: that of the schedule (cmd_vel: flat)", ""
    )
    ramp_grade: float = number(
        "slope of the ramp, positive uphill", "rad", -0.5, 0.5, default=math.radians(3.0)
    )
    step_rise: float = number("height of the step, which is 1 m long", "m", -0.3, 0.3, default=0.05)
    steering: str = entry(
        "how velocity commands turn the rover: skid, all_wheels (each is steered) or ackermann;"
        " empty: it drives straight, by every schedule",
        "",
    )
    cross_slope: float = number(
        "slope of the ground across the way at the start, positive rising to the left; with"
        " steering alone",
        "rad",
        -0.5,
        0.5,
        default=0.0,
    )
    yaw_inertia: float = number(
        "yaw inertia of a rover with steering; 0: of its mass spread evenly between the wheels",
        "kg m^2",
        0.0,
        1e6,
        default=0.0,
    )
    effect: str = entry(
        "effect that the nominal model lacks, a name from docs/effects.md; empty: none", ""
    )
    effect_size: float = number(
        "size of the effect, in its unit, needed where one is named; 0: it does not act",
        "unit of the effect",
        default=math.nan,
    )
    effect_axle: int = number(
        "axle on which the effect acts, counted from the front, if it acts on one",
        "1",
        0,
        2,
        default=2,
    )
    noise: float = number(
        "factor on the sensors' standard deviations; 0: exact values", "1", 0.0, 100.0, default=1.0
    )
    sinkage_sensor: bool = entry(
        "measure sinkages; false: publish NaN, as a rover without such a sensor", default=True
    )
    sinkage_reference: str = entry(
        "ground that sinkages are measured from: undisturbed, or local, the ground right before"
        " each wheel, in the tracks of the wheels ahead",
        UNDISTURBED,
    )
    contact_angle_sensor: bool = entry(
        "measure contact angles; false: publish NaN, as a rover without such a sensor", default=True
    )
    seed: int = number(
        "seed of everything random: the same seed gives the same run", "1", 0, 2**31 - 1, default=0
    )
    duration: float = number(
        "simulated time after which the simulator ends; 0: it runs until it is stopped",
        "s",
        0.0,
        1e6,
        default=0.0,
    )
    rate: float = number("samples per second of simulated time", "Hz", 1.0, 50.0, default=10.0)
    real_time_factor: float = number("simulated seconds per second", "1", 0.01, 1000.0, default=1.0)
    publish_clock: bool = entry(
        "publish simulated time on /clock; always done if real_time_factor is not 1", default=False
    )
    epoch: float = number(
        "simulated time of the start, if it is published on /clock",
        "s",
        0.0,
        2.0**31 - 1e6,
        default=0.0,
    )
    body_frame: str = entry("frame of the rover's body", "base_link")
    odom_frame: str = entry("frame of the odometry", "odom")
    publish_tf: bool = entry(
        "publish the transform from odom_frame to body_frame on /tf; false where another node does",
        default=True,
    )
    publish_markers: bool = entry(
        "publish the wheels and the true forces on them, for RViz, on wheel_markers", default=True
    )
    track_width: float = number(
        "distance of left and right wheels, of a rover with steering and in wheel_markers, as in"
        " export_urdf; 0: three quarters of the wheelbase",
        "m",
        0.0,
        100.0,
        default=0.0,
    )
    wait_for_subscribers: int = number(
        "number of subscribers that every topic must have before the drive starts",
        "1",
        0,
        100,
        default=0,
    )
    wait_timeout: float = number(
        "time after which waiting for subscribers is an error", "s", 0.1, 3600.0, default=30.0
    )
    cmd_vel_timeout: float = number(
        "simulated time after which a velocity command is stale and the rover stops",
        "s",
        0.1,
        60.0,
        default=0.5,
    )
    cmd_vel_acceleration: float = number(
        "limit of the commanded acceleration", "m/s^2", 0.001, 10.0, default=0.2
    )
    cmd_vel_limit: float = number(
        "highest velocity command that is accepted", "m/s", 0.001, 10.0, default=1.0
    )

    @property
    def owns_clock(self) -> bool:
        """True where this run publishes simulated time."""
        return self.publish_clock or self.real_time_factor != 1.0

    @property
    def steps(self) -> int:
        """Number of samples after which the simulator ends; 0: it runs until it is stopped."""
        return max(round(self.duration * self.rate), 1) if self.duration > 0.0 else 0
