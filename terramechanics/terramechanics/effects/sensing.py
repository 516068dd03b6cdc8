# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects of the sensors: what they report is not the truth. Sources stand in the registry."""

from collections import deque
from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.stresses import MAX_SLIP, MIN_SLIP
from terramechanics.effects.law import (
    ExtraValue,
    Law,
    Readings,
    with_attitude,
    with_sinkage,
    with_slip,
)
from terramechanics.vehicle.rover import Rover

LONGEST_DELAY = 1.0
"""[s] Latency that is remembered."""
SHALLOWEST = 0.2
"""[1] Share of the reported sinkage that a correction leaves at least: a wheel always has some."""


class SlopeBias(Law):
    """The pitch that is reported is size too large.

    The extra value is the share of the tilt that the accelerometer has: 0 where the attitude comes
    from another sensor, 1 where the whole inertial unit sits tilted. Along its axis such a unit
    feels g (sin(ab + share size) - sin(ab)) more at the true pitch ab.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("share of the tilt that the accelerometer has", "1", 0.5),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.gravity = rover.gravity

    def felt(self, pitch: Tensor, values: Tensor) -> Tensor:
        """Return what the accelerometer reads too much, [n, 1] [m/s^2].

        ``pitch`` [n, 1] [rad] is the true one, ``values`` [n or 1, 2] are tilt [rad] and share [1].
        """
        tilted = pitch + values[:, 1:] * values[:, :1]
        return self.gravity * (torch.sin(tilted) - torch.sin(pitch))

    def reported(self, readings: Readings, values: Tensor) -> Readings:
        """Add the bias; ``values`` in [rad] and [1]."""
        pitch, more = readings.pitch, self.felt(readings.pitch, values)
        return with_attitude(readings, pitch + values[:, :1], readings.acceleration + more)

    def corrected(self, readings: Readings, values: Tensor) -> Readings:
        """Take the bias off."""
        pitch = readings.pitch - values[:, :1]
        return with_attitude(readings, pitch, readings.acceleration - self.felt(pitch, values))


class OdometryScale(Law):
    """i becomes (i + e) / (1 + e): slip is computed with a wheel radius too large by the share e.

    e is the size for the middle axle, and from one axle to the next behind it the extra value times
    the size more.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("unevenness from one axle to the next behind it", "1", 0.3),
    )

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.lowest, self.highest = MIN_SLIP, MAX_SLIP

    def error(self, values: Tensor) -> Tensor:
        """Return the relative error of the radius of each axle's wheels, [n or 1, A] [1]."""
        middle = 0.5 * (self.order.shape[0] - 1)
        return values[:, :1] * (1.0 + values[:, 1:] * (self.order - middle))

    def reported(self, readings: Readings, values: Tensor) -> Readings:
        """Compute slip with the wrong radius."""
        error = self.error(values)
        slip = (readings.slip + error) / (1.0 + error)
        return with_slip(readings, slip, readings.slip_sd / (1.0 + error))

    def corrected(self, readings: Readings, values: Tensor) -> Readings:
        """Compute slip with the true radius, within the range of the contact model."""
        error = self.error(values)
        slip = ((1.0 + error) * readings.slip - error).clamp(self.lowest, self.highest)
        return with_slip(readings, slip, (1.0 + error) * readings.slip_sd)


class SinkageBias(Law):
    """The sinkage that is reported is size too large."""

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.shallowest = SHALLOWEST

    def reported(self, readings: Readings, values: Tensor) -> Readings:
        """Add the bias; ``values`` in [m]."""
        return with_sinkage(readings, readings.sinkage + values)

    def corrected(self, readings: Readings, values: Tensor) -> Readings:
        """Take the bias off."""
        sinkage = readings.sinkage
        return with_sinkage(readings, torch.maximum(sinkage - values, self.shallowest * sinkage))


class Latency(Law):
    """Slip and sinkage, which cameras see, are size [s] old when they are reported as present.

    A law that remembers the samples of one simulation. A correction needs the rates of change,
    which a model that runs online does not have.
    """

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self._past: deque[tuple[Tensor, Tensor]] = deque()
        self._count = 0

    def reported(self, readings: Readings, values: Tensor) -> Readings:
        """Interpolate between past samples; before the first they are the first's."""
        if readings.time is None:
            raise ValueError("latency needs the time of each simulated sample")
        self._count += 1
        step = float(readings.time[0]) / self._count
        self._past.appendleft((readings.slip, readings.sinkage))
        while len(self._past) > LONGEST_DELAY / step + 2.0:
            self._past.pop()
        delay = values[:, 0].clamp(0.0, LONGEST_DELAY).expand(readings.slip.shape[0]) / step
        slip, sinkage = (
            _at_age(torch.stack(list(past)), delay) for past in zip(*self._past, strict=True)
        )
        return with_sinkage(with_slip(readings, slip, readings.slip_sd), sinkage)

    def corrected(self, readings: Readings, values: Tensor) -> Readings:
        """Move slip and sinkage on along their rates of change."""
        faster, deeper = readings.slip_rate, readings.sinkage_rate
        if faster is None or deeper is None:
            raise ValueError("latency needs the rates of slip and sinkage")
        slip = (readings.slip + values * faster).clamp(MIN_SLIP, MAX_SLIP)
        sinkage = readings.sinkage
        moved = torch.maximum(sinkage + values * deeper, SHALLOWEST * sinkage)
        return with_sinkage(with_slip(readings, slip, readings.slip_sd), moved)


def _at_age(past: Tensor, delay: Tensor) -> Tensor:
    """Return the values of ``past`` [age, batch, axles] at the age ``delay`` [batch] in samples."""
    oldest, episode = past.shape[0] - 1, torch.arange(delay.shape[0])
    younger = delay.floor().long()
    first, second = (
        past[younger.clamp(max=oldest), episode],
        past[(younger + 1).clamp(max=oldest), episode],
    )
    share = (delay - younger).unsqueeze(-1)
    return torch.where(share > 0.0, torch.lerp(first, second, share), first)
