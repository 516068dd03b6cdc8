# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Observations of simulated drives, by axle and by wheel, which an estimator takes one by one."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from terrain_estimator.observation import Floats, Observation
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.sample import TIME_STEP, Measurement, Sample
from terramechanics.simulation.sensors import LATERAL_SD, YAW_RATE_SD, Noise, measure_drive
from terramechanics.simulation.spatial import BodySample
from terramechanics.vehicle.rover import Rover

STEP_NS = 100_000_000


def observations_of(
    measurement: Measurement, index: int, step_ns: int = STEP_NS
) -> list[Observation]:
    """Return the observations of one drive of a measured batch, the first after one step [ns].

    What tells whether a rover is planar is not measured: a simulated one is.
    """
    batch, time = measurement.velocity.shape
    names = {field.name for field in dataclasses.fields(Observation)}
    shared = [each.name for each in dataclasses.fields(measurement) if each.name in names]
    columns = {name: getattr(measurement, name) for name in shared}
    series = {
        name: value[index] if value.ndim == 3 else value.expand(batch, time)[index]
        for name, value in columns.items()
    }
    fields = ({name: _plain(value[k]) for name, value in series.items()} for k in range(time))
    return [
        Observation(stamp * step_ns, **values)  # type: ignore[arg-type]
        for stamp, values in enumerate(fields, 1)
    ]


def _plain(value: Tensor) -> object:
    return value.numpy() if value.ndim else float(value)


def turning_observations_of(
    measured: Measurement,
    roll: Tensor,
    lateral_velocity: Tensor,
    yaw_rate: Tensor,
    generator: torch.Generator,
) -> list[list[Observation]]:
    """Return the observations of every drive, with the simulator node's noise of these motions.

    ``measured`` is of all drives [drives, time], as are the true ``roll`` [rad], lateral velocity
    [m/s] and yaw rate [rad/s].
    """

    def seen(true: Tensor, deviation: float) -> Floats:
        noise = torch.randn(true.shape, generator=generator, dtype=torch.float64)
        return np.asarray(true + deviation * noise)

    lean = seen(roll, Noise().pitch)
    aside, turn = seen(lateral_velocity, LATERAL_SD), seen(yaw_rate, YAW_RATE_SD)
    return [
        [
            dataclasses.replace(
                one,
                roll=float(lean[drive, step]),
                roll_sd=Noise().pitch,
                lateral_velocity=float(aside[drive, step]),
                lateral_velocity_sd=LATERAL_SD,
                yaw_rate=float(turn[drive, step]),
                yaw_rate_sd=YAW_RATE_SD,
            )
            for step, one in enumerate(observations_of(measured, drive))
        ]
        for drive in range(roll.shape[0])
    ]


def observed(
    rover: Rover,
    driven: Sequence[BodySample],
    order: Sequence[int],
    generator: torch.Generator,
    effects: BodyPlant | None = None,
    shift: float = 0.0,
) -> list[list[Observation]]:
    """Return the observations by wheel of each drive, with the noise of every sensor.

    ``driven`` are the samples of all drives, step by step. ``order`` [W] has each wheel's place in
    them. ``effects`` are those of sensors; the centre of mass is ``shift`` [m] ahead of the rover
    file's.
    """

    def stacked(name: str) -> Tensor:
        return torch.stack([getattr(sample, name) for sample in driven], 1)

    def wheels(name: str) -> Tensor:
        return stacked(name)[:, :, order]

    velocity, slip, forces = stacked("velocity"), wheels("slip"), wheels("forces")
    before = torch.cat([torch.zeros_like(velocity[:, :1]), velocity[:, :-1]], 1)
    turned = velocity[..., 2] * TIME_STEP
    ahead = torch.cos(turned) * before[..., 0] + torch.sin(turned) * before[..., 1]
    level, never = torch.zeros_like(turned), torch.zeros_like(turned, dtype=torch.bool)
    bogies = 2 * len(rover.suspension)  # left and right, before the differential
    bogie = stacked("joints")[..., :bogies].mean(-1) if bogies else level
    sample = Sample(
        time=stacked("time"),
        position=stacked("position")[..., 0],
        height=level,
        velocity=velocity[..., 0],
        acceleration=(velocity[..., 0] - ahead) / TIME_STEP,
        pitch=stacked("pitch"),
        bogie_angle=bogie,
        stuck=never,
        standing=never,
        slip=slip,
        sinkage=wheels("sinkage"),
        contact=torch.zeros_like(slip),
        contact_angle=wheels("contact_angle"),
        wheel_rate=wheels("rim") / rover.wheel_radius,
        torque=wheels("torque"),
        normal=forces[..., 0],
        traction=forces[..., 1],
        ground_torque=forces[..., 2],
        valid=torch.isfinite(slip),
        constants=torch.full((*slip.shape, 6), math.nan, dtype=torch.float64),  # no sensor's
        strength=torch.full((*slip.shape, 2), math.nan, dtype=torch.float64),
    )
    sample = sample if effects is None else effects.sensed(sample)
    measured = measure_drive(rover, sample, Noise(), generator)
    aside = velocity[..., 1] - (rover.centre_of_mass_x + shift) * velocity[..., 2]
    observations = turning_observations_of(
        measured, stacked("roll"), aside, velocity[..., 2], generator
    )
    steering = wheels("steering").numpy()
    return [
        [dataclasses.replace(one, steering=steering[drive, step]) for step, one in enumerate(each)]
        for drive, each in enumerate(observations)
    ]
