# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of the sensors."""

import dataclasses
import math

import torch
from torch import Tensor

from terramechanics.simulation.plant import Effect
from terramechanics.simulation.sample import Sample
from terramechanics.vehicle.rover import Rover

WARM_UP = 15.0
"""[s] Time constant with which a sensor reaches its working temperature."""
WEAR = (0.7, 1.0, 1.3)
"""[1] Wear of the wheels from front to rear, in units of the mean."""


class Sensed(Effect):
    """An effect between the truth and the sensors, with one size for each episode of a batch."""

    def __init__(self, sizes: Tensor) -> None:
        self.sizes = sizes
        self.gravity, self.radius = math.nan, math.nan

    def begin(self, rover: Rover, batch: int) -> None:
        assert self.sizes.shape == (batch,)
        self.gravity, self.radius = rover.gravity, rover.wheel_radius


class TiltedUnit(Sensed):
    """Tilt of the inertial unit by size, in attitude and accelerometer; less while it is cold."""

    def sensed(self, sample: Sample) -> Sample:
        tilt = self.sizes * (1.0 - 0.3 * torch.exp(-sample.time / WARM_UP))
        pitch = sample.pitch + tilt
        read = sample.acceleration * torch.cos(tilt) + self.gravity * torch.sin(pitch)
        # A sample carries dv/dt; what the accelerometer reads is that and g sin of the sample's
        # pitch.
        return dataclasses.replace(
            sample, pitch=pitch, acceleration=read - self.gravity * torch.sin(pitch)
        )


class UnevenWear(Sensed):
    """Slip computed with the radius of a new wheel, while the axles' wheels are worn unevenly."""

    def sensed(self, sample: Sample) -> Sample:
        loss = self.sizes.unsqueeze(-1) * torch.tensor(WEAR, dtype=torch.float64)
        return dataclasses.replace(sample, slip=1.0 - (1.0 - sample.slip) * (1.0 - loss))


class RimAngle(Sensed):
    """Sinkage from the entry angle of the rim, measured too large by size."""

    def sensed(self, sample: Sample) -> Sample:
        angle = torch.acos(
            (1.0 - sample.sinkage / self.radius).clamp(-1.0, 1.0)
        ) + self.sizes.unsqueeze(-1)
        return dataclasses.replace(sample, sinkage=self.radius * (1.0 - torch.cos(angle)))


class Smoothed(Sensed):
    """Low-pass filter of slip and sinkage with time constant size, linear between samples."""

    def begin(self, rover: Rover, batch: int) -> None:
        super().begin(rover, batch)
        self.before: tuple[Tensor, Tensor] | None = (
            None  # [2, batch, axles] what went in and what came out
        )
        self.time = 0.0

    def sensed(self, sample: Sample) -> Sample:
        now = torch.stack([sample.slip, sample.sinkage])
        step, self.time = float(sample.time[0]) - self.time, float(sample.time[0])
        time_constant = self.sizes.clamp(min=1e-12).unsqueeze(-1)
        kept = torch.exp(-step / time_constant)
        last, filtered = self.before or (now, now)
        # The answer to a ramp: it follows behind by the time constant.
        smooth = now - time_constant / step * (1.0 - kept) * (now - last) + kept * (filtered - last)
        self.before = (now, smooth)
        return dataclasses.replace(sample, slip=smooth[0], sinkage=smooth[1])
