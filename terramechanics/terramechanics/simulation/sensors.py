# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sensor noise: measured values of a true sample, with the published standard deviations.

Every deviation is computed from the MEASURED value, since a sensor does not know the true one.
"""

import dataclasses
import math
from dataclasses import dataclass

import torch
from torch import Tensor

from rover_parameters.records import number
from terramechanics.simulation.sample import Measurement, Sample
from terramechanics.vehicle.rover import Rover


@dataclass(frozen=True, slots=True)
class Noise:
    """Standard deviations of a sample, independent; relative and constant parts in quadrature."""

    slip_relative: float = number("part of the slip", "1", 0.0, default=0.05)
    slip: float = number("constant part of the slip's deviation", "1", 0.0, default=0.005)
    sinkage_relative: float = number(
        "part of the sinkage; the constant part is in the rover file", "1", 0.0, default=0.05
    )
    velocity: float = number("velocity", "m/s", 0.0, default=0.01)
    pitch: float = number("pitch", "rad", 0.0, default=math.radians(0.3))
    contact_angle: float = number("contact angles", "rad", 0.0, default=math.radians(0.3))
    torque_relative: float = number("part of the motor torque", "1", 0.0, default=0.03)
    torque_of_load: float = number(
        "constant part of the torque, in units of 0.3 r m g / wheels", "1", 0.0, default=0.01
    )
    acceleration: float = number("acceleration, and its constant bias", "m/s^2", 0.0, default=0.02)
    factor: float = number(
        "factor of all of them, for what is added to the true values", "1", 0.0, default=1.0
    )


LEAST_FACTOR = 1e-3
"""[1] Least factor of the published deviations: none is zero."""
LATERAL_SD, YAW_RATE_SD = 0.005, 0.003
"""[m/s], [rad/s] Deviations of the lateral velocity and of the gyroscope."""


def per_wheel(rover: Rover, sample: Sample) -> Sample:
    """Return the sample with a value for every wheel, in the order of the rover file."""
    axle = torch.tensor(rover.wheel_axle)
    names = (
        "slip",
        "sinkage",
        "contact",
        "contact_angle",
        "wheel_rate",
        "torque",
        "normal",
        "traction",
        "ground_torque",
        "valid",
    )
    values = {name: getattr(sample, name)[..., axle] for name in names}
    return dataclasses.replace(
        sample,
        constants=sample.constants[..., axle, :],
        strength=sample.strength[..., axle, :],
        **values,
    )


def acceleration_bias(noise: Noise, batch: int, generator: torch.Generator) -> Tensor:
    """Draw the constant bias of the accelerometers of a batch of rovers, [batch] [m/s^2]."""
    return (
        noise.factor
        * noise.acceleration
        * torch.randn(batch, generator=generator, dtype=torch.float64)
    )


def measure(
    rover: Rover,
    sample: Sample,
    noise: Noise,
    bias: Tensor,
    generator: torch.Generator,
    correlation: float = 0.0,
) -> Measurement:
    """Measure one sample or a whole drive.

    ``bias`` from :func:`acceleration_bias` broadcasts against the sample's velocity.

    ``correlation`` [1] of the noise of two samples that follow each other; other than 0 needs a
    whole drive.
    """
    torque_unit = 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)

    def measured(true: Tensor, relative: float, constant: float) -> tuple[Tensor, Tensor]:
        spread = torch.sqrt((relative * true) ** 2 + constant**2)
        white = torch.randn(true.shape, generator=generator, dtype=torch.float64)
        value = true + noise.factor * spread * (
            coloured(white, correlation) if correlation else white
        )
        claimed = torch.sqrt((relative * value) ** 2 + constant**2) * max(
            noise.factor, LEAST_FACTOR
        )
        return value, claimed

    slip, slip_sd = measured(sample.slip, noise.slip_relative, noise.slip)
    sinkage, sinkage_sd = measured(
        sample.sinkage, noise.sinkage_relative, rover.sinkage_noise_floor
    )
    angle, angle_sd = measured(sample.contact_angle, 0.0, noise.contact_angle)
    torque, torque_sd = measured(
        sample.torque, noise.torque_relative, noise.torque_of_load * torque_unit
    )
    velocity, velocity_sd = measured(sample.velocity, 0.0, noise.velocity)
    pitch, pitch_sd = measured(sample.pitch, 0.0, noise.pitch)
    force, force_sd = measured(sample.specific_force(rover.gravity) + bias, 0.0, noise.acceleration)
    return Measurement(
        slip, slip_sd, sinkage, sinkage_sd, angle, angle_sd, sample.wheel_rate, torque, torque_sd,
        velocity, velocity_sd, pitch, pitch_sd, force, math.sqrt(2.0) * force_sd,
        sample.bogie_angle,
    )  # fmt: skip


def measure_drive(
    rover: Rover, sample: Sample, noise: Noise, generator: torch.Generator, correlation: float = 0.0
) -> Measurement:
    """Measure a batch of drives [batch, time, ...], each with its own accelerometer bias.

    ``correlation`` as in :func:`measure`.
    """
    bias = acceleration_bias(noise, sample.velocity.shape[0], generator)
    return measure(rover, sample, noise, bias.unsqueeze(-1), generator, correlation)


def coloured(white: Tensor, correlation: float) -> Tensor:
    """Draw noise of unit variance [batch, time, ...] with ``correlation`` between neighbours."""
    fresh = math.sqrt(1.0 - correlation**2)
    series = [white[:, 0]]
    for now in white[:, 1:].unbind(1):
        series.append(correlation * series[-1] + fresh * now)
    return torch.stack(series, dim=1)
