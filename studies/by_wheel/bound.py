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
from studies.off_plane import SOIL
from terrain_estimator.learning.by_wheel import ROLL_BIAS_SD
from terrain_estimator.learning.observing import observed
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.contact.rolling import WheelMotion
from terramechanics.contact.stresses import quadrature
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import LATERAL_SD, YAW_RATE_SD, Noise
from terramechanics.simulation.spatial import BodySample
from terramechanics.vehicle.body_rows import body_rows
from terramechanics.vehicle.rover import Rover, Wheel
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


def information(sample: BodySample, strength: Tensor) -> lateral.Matrices:
    """Return what lateral.information does, with the errors that a model by wheel is told.

    Motion across comes from one lateral velocity and one yaw rate. Mass, centre of mass, along and
    to the left, and a constant error of the roll are four parameters more.
    """
    noise, constants = Noise(), SOIL.constants()
    slip, chassis = sample.slip, lateral.SKID
    theta = torch.cat([strength, torch.ones_like(strength[:, :1])], -1).unsqueeze(-1)
    places = torch.tensor(chassis.wheel_x, dtype=torch.float64)
    hub = sample.velocity[:, 1:2] + sample.velocity[:, 2:3] * places

    def rows(slip: Tensor, hub: Tensor, sinkage: Tensor) -> Tensor:
        motion = WheelMotion(sample.rim, sample.rim * (1.0 - slip), hub)
        return body_rows(chassis, motion, sinkage, sample.steering, constants, quadrature(6))

    def spread(value: Tensor, relative: float, floor: float) -> Tensor:
        return torch.sqrt((relative * value) ** 2 + floor**2)

    at, columns = rows(slip, hub, sample.sinkage), []
    small, none = 1e-4, torch.zeros_like(slip)
    slips = spread(slip, noise.slip_relative, noise.slip)
    sinkages = spread(sample.sinkage, noise.sinkage_relative, lateral.SINKAGE_FLOOR)
    moves = [(LATERAL_SD * torch.ones_like(hub), 1), (YAW_RATE_SD * places + none, 1)]
    for wheel in range(chassis.wheels):
        own = torch.zeros_like(slip)
        own[:, wheel] = 1.0
        moves += [(own * slips, 0), (own * sinkages, 2)]
    for step, which in moves:
        inputs = [slip, hub, sample.sinkage]
        inputs[which] = inputs[which] + small * step
        columns.append(((rows(*inputs) - at) @ theta).squeeze(-1) / small)
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
    features = torch.cat([at[..., :2], body], -1)
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
