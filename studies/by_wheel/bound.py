# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of a minute beside their Cramer-Rao bound, with what the estimator is not told exactly."""

import dataclasses
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from studies import lateral
from studies.by_wheel.drives import SEED, ended, model_by_wheel
from studies.by_wheel.motions import TYPICAL, YAW_RATES, Motion, driven_of, motions
from studies.off_plane import SAMPLES, SOIL, Kind
from terrain_estimator.learning.by_wheel import ROLL_BIAS_SD
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.physics import UNCERTAIN, uncertain_constants
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.contact.rolling import WheelMotion
from terramechanics.contact.stresses import quadrature
from terramechanics.presets import load_rover
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import LATERAL_SD, YAW_RATE_SD, Noise
from terramechanics.simulation.spatial import BodySample
from terramechanics.vehicle.body_rows import body_rows
from terramechanics.vehicle.chassis import Chassis, Stance
from terramechanics.vehicle.rover import Rover, Wheel
from terramechanics.vehicle.stance import turned
from terramechanics.vehicle.wheel_balances import motion_across
from terramechanics.vehicle.wheel_places import WheelPlaces

TURNING = (0.0, 0.3, 0.6)
"""[rad/s] Largest commanded yaw rates of the drives beside the bound."""
SKID = Rover(
    name="skid",
    mass=lateral.SKID.mass,
    gravity=lateral.SKID.gravity,
    wheel_radius=lateral.SKID.wheel_radius,
    wheel_width=lateral.SKID.wheel_width,
    wheel_inertia=lateral.SKID.wheel_inertia,
    axle_x=(0.3, -0.3),
    centre_of_mass_x=0.0,
    centre_of_mass_height=lateral.SKID.centre[2],
    cruise_speed=(0.1, 0.3),
    sinkage_noise_floor=lateral.SINKAGE_FLOOR,
    wheels=tuple(
        Wheel(f"{end}_{side}", axle, side)
        for axle, end in enumerate(("front", "rear"))
        for side in ("left", "right")
    ),
)
"""The rover of lateral, whose wheels are in the order of wheel_order."""


@dataclasses.dataclass(frozen=True, slots=True)
class Known:
    """The rover and the ground of a bound, and what is known of them."""

    chassis: Chassis = lateral.SKID
    sinkage_floor: float = lateral.SINKAGE_FLOOR  # [m] constant part of the sinkage's deviation
    constants: Tensor | None = None  # [drives, 6] of the ground, by default those of SOIL
    constants_sd: float = 0.0  # [1] relative deviation of each; 0: exact


def standing(chassis: Chassis, steering: Tensor, joints: Tensor, angle: Tensor) -> Stance:
    """Return how the wheels stand at contact angles ``angle`` [drives, wheels] [rad].

    The ground leans along their headings alone. ``steering`` [drives, wheels] and the angles of the
    ``joints`` [drives, J] are in rad.
    """
    hub, pivots = turned(chassis, joints)
    ahead = torch.stack([torch.cos(steering), torch.sin(steering)], -1)
    normal = torch.cat(
        [-torch.sin(angle).unsqueeze(-1) * ahead, torch.cos(angle).unsqueeze(-1)], -1
    )
    return Stance(hub, normal, torch.zeros_like(angle), pivots)


def information(sample: BodySample, strength: Tensor, known: Known = Known()) -> lateral.Matrices:
    """Return what lateral.information does, with the errors that a model by wheel is told.

    Motion across comes from one lateral velocity and one yaw rate; contact angles are measured, and
    how the ground leans aside is known. Mass, centre of mass, along and to the left, and a constant
    error of the roll are four parameters more, and the soil constants where they are not exact.
    """
    noise, chassis = Noise(), known.chassis
    ground = SOIL.constants() if known.constants is None else known.constants.unsqueeze(-2)
    slip = sample.slip
    theta = torch.cat([strength, torch.ones_like(strength[:, :1])], -1).unsqueeze(-1)
    places = torch.tensor(chassis.wheel_x, dtype=torch.float64)
    from_centre = places - chassis.centre[0]
    left = sample.velocity[:, 1:2] + sample.velocity[:, 2:3] * from_centre

    def rows(slip: Tensor, left: Tensor, sinkage: Tensor, angle: Tensor, ground: Tensor) -> Tensor:
        rolled, along, across = motion_across(slip, sample.rim, sample.steering, left)
        speed = sample.rim.abs()
        motion = WheelMotion(rolled * speed, along * speed, across * speed)
        return body_rows(
            chassis, motion, sinkage, sample.steering, ground, quadrature(6),
            stance=standing(chassis, sample.steering, sample.joints, angle),
        )  # fmt: skip

    def spread(value: Tensor, relative: float, floor: float) -> Tensor:
        return torch.sqrt((relative * value) ** 2 + floor**2)

    inputs = [slip, left, sample.sinkage, sample.contact_angle, ground]
    at, columns, unknown = rows(*inputs), [], []
    small, none = 1e-4, torch.zeros_like(slip)

    def change(step: Tensor, which: int) -> Tensor:
        moved = [value + small * step if k == which else value for k, value in enumerate(inputs)]
        return ((rows(*moved) - at) @ theta).squeeze(-1) / small

    spreads = {
        0: spread(slip, noise.slip_relative, noise.slip),
        2: spread(sample.sinkage, noise.sinkage_relative, known.sinkage_floor),
        3: none + noise.contact_angle,
    }
    columns = [change(none + LATERAL_SD, 1), change(YAW_RATE_SD * places + none, 1)]
    for wheel in range(chassis.wheels):
        own = torch.zeros_like(slip)
        own[:, wheel] = 1.0
        columns += [change(own * spreads[which], which) for which in spreads]
    if known.constants_sd:
        varied = uncertain_constants(SOIL.constants().unsqueeze(0), known.constants_sd,
                                     chassis.wheel_width)[0]  # fmt: skip
        unknown = [change(step, 4).unsqueeze(-1) for step in varied]
    jacobian = torch.stack(columns, -1)
    unit = 0.3 * chassis.wheel_radius * chassis.weight / chassis.wheels
    torque = spread(sample.forces[..., 2], noise.torque_relative, noise.torque_of_load * unit)
    rates = [
        chassis.mass * noise.velocity,
        chassis.mass * LATERAL_SD,
        chassis.yaw_inertia * YAW_RATE_SD,
        *([0.0] * (at.shape[-2] - 3)),
    ]
    by_velocity = torch.tensor(rates, dtype=torch.float64).expand(len(slip), -1) / TIME_STEP
    own = 2.0 * by_velocity**2
    tilt = chassis.weight * noise.pitch
    own = own + torch.nn.functional.pad(torque**2, [at.shape[-2] - chassis.wheels, 0])
    own[:, :2] += tilt**2
    body = torch.zeros(len(slip), at.shape[-2], 4, dtype=torch.float64)
    for parameter, row in enumerate((3, 4, 5, 1)):
        body[:, row, parameter] = -chassis.weight
    features = torch.cat([at[..., :2], body, *unknown], -1)
    return features, jacobian @ jacobian.mT + own.diag_embed(), -(by_velocity**2).diag_embed()


BOUND_HEAD = (
    "commanded yaw rates",
    "used",
    "bound, c / tan phi",
    "stated deviation over the bound",
    "error over the bound's",
    "c / tan phi in their interval",
)


def bound_lines(drives: int = lateral.DRIVES) -> Iterator[tuple[str, ...]]:
    """Yield the lines of the table of drives of a minute beside their Cramer-Rao bound."""
    prior = dataclasses.replace(DEFAULT_PRIOR, constants_sd=0.0)
    places = WheelPlaces(2.0 * lateral.SKID.wheel_y[0], lateral.SKID.yaw_inertia)
    with tempfile.TemporaryDirectory() as folder:
        model = model_by_wheel(SKID, places, prior, Path(folder) / "model.pt")
    known = (
        *lateral.PRIOR_SD, prior.mass_sd, prior.centre_of_mass_sd, prior.centre_of_mass_sd,
        ROLL_BIAS_SD,
    )  # fmt: skip
    for turning in TURNING:
        samples, strength = lateral.drive(turning)
        matrices = [information(sample, strength) for sample in samples]
        rows = tuple(range(matrices[0][0].shape[-2]))
        bound = lateral.bound(matrices, rows, known)[:drives, :2].numpy()
        generator = torch.Generator().manual_seed(SEED)
        found = observed(SKID, samples, range(len(SKID.wheels)), generator)[:drives]
        result = ended(model, found, strength.numpy()[:drives])
        error = np.median(np.abs(result.mean - result.truth) / result.truth, 0)
        least = np.median(bound / result.truth, 0)
        spread = np.median(result.deviation / bound, 0)
        over = error / (HALF * least)
        held = result.holds.sum(0)
        yield (
            f"to {turning:g} rad/s" if turning else "none",
            f"{100.0 * result.used:.0f} %",
            f"{100.0 * least[0]:.1f} / {100.0 * least[1]:.2f} %",
            f"{spread[0]:.2f} / {spread[1]:.2f}",
            f"{over[0]:.2f} / {over[1]:.2f}",
            f"{held[0]} / {held[1]} of {drives}",
        )


HALF = 0.6745
"""Median of the absolute value of a standard normal variable."""


MOTION_BOUND_HEAD = ("motion", "bound, c / tan phi", "over that of straight drives on such ground")


def motion_bound_lines(kind: Kind, samples: int = SAMPLES) -> Iterator[tuple[str, ...]]:
    """Yield the bound of turns and of straight drives on each ground of a rover's table.

    They are the drives of that table, with its prior of the soil constants.
    """
    rover, prior = load_rover(kind.rover), DEFAULT_PRIOR
    chassis = Chassis.of(rover, kind.track, kind.yaw_inertia)
    deviations = (
        *lateral.PRIOR_SD, prior.mass_sd, prior.centre_of_mass_sd, prior.centre_of_mass_sd,
        ROLL_BIAS_SD, *(1.0,) * len(UNCERTAIN),
    )  # fmt: skip
    straight: dict[float, Tensor] = {}
    for motion in sorted(plainly(kind), key=lambda each: each.yaw_rate):
        driven, strength, constants, _ = driven_of(kind, motion, samples)
        known = Known(chassis, rover.sinkage_noise_floor, constants, prior.constants_sd)
        matrices = [information(sample, strength, known) for sample in driven]
        rows = tuple(range(matrices[0][0].shape[-2]))
        bound = (lateral.bound(matrices, rows, deviations)[:, :2] / strength).median(0).values
        ground = motion.lengths[0] if motion.uneven else 0.0
        over = bound / straight.setdefault(ground, bound)
        yield (
            motion.words,
            f"{100.0 * float(bound[0]):.1f} / {100.0 * float(bound[1]):.2f} %",
            f"{float(over[0]):.2f} / {float(over[1]):.2f}" if motion.yaw_rate else "",
        )


def plainly(kind: Kind) -> list[Motion]:
    """Return the straight and the typical motion of a rover on each ground, every sensor there."""
    rates = (0.0, YAW_RATES[kind.rover][TYPICAL[kind.rover]])
    return [
        each
        for each in motions(kind.rover)
        if each == Motion(each.words, each.yaw_rate, uneven=each.uneven, lengths=each.lengths)
        and each.yaw_rate in rates
    ]
