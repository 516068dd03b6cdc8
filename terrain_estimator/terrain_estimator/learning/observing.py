# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Observations of simulated drives, by axle and by wheel, which an estimator takes one by one."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from terrain_estimator.observation import Floats, Observation
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.by_wheel import sample_by_wheel
from terramechanics.simulation.sample import Measurement
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

    velocity, sample = stacked("velocity"), sample_by_wheel(rover, driven, order)
    sample = sample if effects is None else effects.sensed(sample)
    measured = measure_drive(rover, sample, Noise(), generator)
    aside = velocity[..., 1] - (rover.centre_of_mass_x + shift) * velocity[..., 2]
    observations = turning_observations_of(
        measured, stacked("roll"), aside, velocity[..., 2], generator
    )
    steering = stacked("steering")[:, :, order].numpy()
    return [
        [dataclasses.replace(one, steering=steering[drive, step]) for step, one in enumerate(each)]
        for drive, each in enumerate(observations)
    ]
