# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of the sensors: what they are given is not the true sample."""

import dataclasses
from collections import deque
from dataclasses import dataclass, field

import torch
from torch import Tensor

from terramechanics.effects.laws import reported_slip
from terramechanics.simulation.plant import Effect, Size
from terramechanics.simulation.sample import Sample
from terramechanics.vehicle.rover import Rover

LONGEST_DELAY = 1.0
"""[s] Latency that is remembered."""


def _wide(size: Size) -> Size:
    """[batch] as [batch, 1], for values of wheels."""
    return size.unsqueeze(-1) if isinstance(size, Tensor) and size.dim() else size


@dataclass
class SlopeBias(Effect):
    """The pitch that is reported is size too large; the accelerometer does not depend on it. [rad]."""

    size: Size
    _gravity: float = field(default=0.0, init=False)

    def begin(self, rover: Rover, batch: int) -> None:
        """See Effect."""
        del batch
        self._gravity = rover.gravity

    def sensed(self, sample: Sample) -> Sample:
        """See Effect."""
        pitch = sample.pitch + self.size
        # A sample carries dv/dt, a sensor reads dv/dt + g sin ab: what it reads must not change.
        acceleration = sample.acceleration + self._gravity * (
            torch.sin(sample.pitch) - torch.sin(pitch)
        )
        return dataclasses.replace(sample, pitch=pitch, acceleration=acceleration)


@dataclass
class OdometryScale(Effect):
    """i becomes (i + size) / (1 + size): the wheel radius that slip is computed with is too large by that share. [1]."""

    size: Size

    def sensed(self, sample: Sample) -> Sample:
        """See Effect."""
        return dataclasses.replace(
            sample,
            slip=reported_slip(sample.slip, torch.as_tensor(_wide(self.size), dtype=torch.float64)),
        )


@dataclass
class SinkageBias(Effect):
    """The sinkage that is reported is size too large. [m]."""

    size: Size

    def sensed(self, sample: Sample) -> Sample:
        """See Effect."""
        return dataclasses.replace(sample, sinkage=sample.sinkage + _wide(self.size))


@dataclass
class Latency(Effect):
    """Slip and sinkage, which cameras see, are size old when they are reported as present. [s]."""

    size: Size
    _past: deque[tuple[Tensor, Tensor]] = field(default_factory=deque, init=False)
    _count: int = field(default=0, init=False)

    def begin(self, rover: Rover, batch: int) -> None:
        """See Effect."""
        del rover, batch
        self._past.clear()
        self._count = 0

    def sensed(self, sample: Sample) -> Sample:
        """See Effect. Between two samples the values are interpolated; before the first they are the first's."""
        self._count += 1
        step = float(sample.time[0]) / self._count
        self._past.appendleft((sample.slip, sample.sinkage))
        while len(self._past) > LONGEST_DELAY / step + 2.0:
            self._past.pop()
        delay = (
            torch.as_tensor(self.size, dtype=torch.float64)
            .clamp(0.0, LONGEST_DELAY)
            .expand(sample.velocity.shape)
            / step
        )
        slip, sinkage = (
            self._at(torch.stack(list(past)), delay) for past in zip(*self._past, strict=True)
        )
        return dataclasses.replace(sample, slip=slip, sinkage=sinkage)

    @staticmethod
    def _at(past: Tensor, delay: Tensor) -> Tensor:
        """Values [age, batch, axles] at the age ``delay`` [batch] in samples."""
        oldest, episode = past.shape[0] - 1, torch.arange(delay.shape[0])
        younger = delay.floor().long()
        first, second = (
            past[younger.clamp(max=oldest), episode],
            past[(younger + 1).clamp(max=oldest), episode],
        )
        share = (delay - younger).unsqueeze(-1)
        return torch.where(share > 0.0, torch.lerp(first, second, share), first)
