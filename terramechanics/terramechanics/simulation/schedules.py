# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Named drives: the commands to the wheels, and the terrain.

The accuracy of an estimate depends on them more than on the method.

S1 every axle at its own wheel rate, a sum of two slow sines, over random hills S2 wheel torques
redrawn every step from one band for 20 s, then from one of half the torque, on level ground S3
equal constant wheel rates on level ground: tells least, above all by velocity alone S4 as S1, with
a square wave of +-50 % and a period of 2 s in all wheel rates
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import torch
from torch import Tensor

from terramechanics.contact.sinkage import (
    WheelGround,
    drawbar_capability,
    equilibrium_sinkage,
    free_rolling,
)
from terramechanics.contact.stresses import quadrature
from terramechanics.terrain.ground import Ground
from terramechanics.terrain.profile import Flat, Profile, random_hills
from terramechanics.vehicle.rover import Rover

SCHEDULES = ("S1", "S2", "S3", "S4")
PROFILES = ("flat", "hills")
"""Profiles that a name is enough for."""


class Command(Enum):
    """Meaning of the numbers of a command."""

    RATE = "wheel rate [rad/s]"
    TORQUE = "torque of one wheel [N m]"


class Schedule(Protocol):
    """Commands over time."""

    kind: Command
    start_velocity: Tensor
    """Velocity with which a drive starts, [batch] [m/s]."""

    def command(self, time: float) -> Tensor:
        """Return the command of every axle [batch, axles] for the step that ends at ``time`` [s].

        The steps are asked for in order.
        """
        ...


@dataclass(slots=True)
class SineRates:
    """Wheel rates of S1, S3 and S4: two sines and a square wave.

    w = (v0 / r) (1 + depth (0.6 sin(2 pi f1 t + p1) + 0.4 sin(2 pi f2 t + p2))) (1 + square wave)
    """

    start_velocity: Tensor  # [batch] v0
    radius: float  # [m]
    frequency: Tensor  # [2, batch, axles] [Hz]
    phase: Tensor  # [2, batch, axles] [rad]
    depth: float  # [1]
    square: float = 0.0  # [1] amplitude of the square wave
    kind: Command = Command.RATE

    def command(self, time: float) -> Tensor:
        """Return the wheel rates [batch, axles] [rad/s] at ``time`` [s]."""
        wave = torch.sin(2.0 * math.pi * self.frequency * time + self.phase)
        rate = (self.start_velocity / self.radius).unsqueeze(-1) * (
            1.0 + self.depth * (0.6 * wave[0] + 0.4 * wave[1])
        )
        # Samples lie on the flanks: half a microsecond keeps rounding from moving a flank by a
        # step.
        high = math.floor(time / (SQUARE_PERIOD / 2.0) - 5e-7) % 2 == 0
        return rate * (1.0 + (self.square if high else -self.square))


@dataclass(slots=True)
class TorqueBands:
    """Torques of S2, uniform between ``low`` and ``high`` [batch] [N m], drawn for every step.

    In the second band they are halved.
    """

    start_velocity: Tensor
    low: Tensor
    high: Tensor
    axles: int
    generator: torch.Generator
    kind: Command = Command.TORQUE

    def command(self, time: float) -> Tensor:
        """Return the wheel torques [batch, axles] [N m] at ``time`` [s], drawn anew."""
        part = 1.0 if time <= BAND_DURATION + 1e-6 else SECOND_BAND
        share = torch.rand(
            self.low.shape[0], self.axles, generator=self.generator, dtype=torch.float64
        )
        return part * torch.lerp(self.low.unsqueeze(-1), self.high.unsqueeze(-1), share)


FREQUENCIES = (0.03, 0.12)
"""[Hz] Range of the two sines of S1."""
SWING = 0.25
"""[1] Amplitude of the two sines of S1 together."""
SQUARE_WAVE = 0.5
"""[1] Amplitude of the square wave of S4."""
SQUARE_PERIOD = 2.0
"""[s] Its period."""
BAND_DURATION = 20.0
"""[s] Time for which S2 stays in its first band."""
SECOND_BAND = 0.5
"""[1] Torques of the second band of S2 in units of the first: there the rover loses speed."""
HIGHEST_TORQUE = 1.6
"""[1] Upper end of the first band, in units of the free-rolling torque."""
HIGHEST_SLIP = 0.6
"""[1] Slip that no torque of S2 exceeds under an even load."""


def make_schedule(
    name: str, rover: Rover, ground: Ground, batch: int, generator: torch.Generator
) -> Schedule:
    """Make a named schedule, random numbers drawn. Raises ValueError that lists the names."""
    if name not in SCHEDULES:
        raise ValueError(f"unknown schedule {name!r}; known schedules are {', '.join(SCHEDULES)}")
    slowest, fastest = rover.cruise_speed
    cruise = slowest + (fastest - slowest) * torch.rand(
        batch, generator=generator, dtype=torch.float64
    )
    if name == "S2":
        return TorqueBands(cruise, *_first_band(rover, ground, batch), rover.axles, generator)
    unit = torch.rand(2, 2, batch, rover.axles, generator=generator, dtype=torch.float64)
    frequency = FREQUENCIES[0] + (FREQUENCIES[1] - FREQUENCIES[0]) * unit[0]
    depth = 0.0 if name == "S3" else SWING
    square = SQUARE_WAVE if name == "S4" else 0.0
    return SineRates(cruise, rover.wheel_radius, frequency, 2.0 * math.pi * unit[1], depth, square)


def make_profile(
    name: str, schedule: str, rover: Rover, ground: Ground, batch: int, generator: torch.Generator
) -> Profile:
    """Make flat ground or random hills; "" is the profile of the schedule. Raises ValueError."""
    name = name or ("hills" if schedule in ("S1", "S4") else "flat")
    if name == "flat":
        return Flat()
    if name != "hills":
        raise ValueError(f"unknown profile {name!r}; known profiles are {', '.join(PROFILES)}")
    capability = torch.full((batch,), math.inf, dtype=torch.float64)
    for patch in ground.patches:
        strength = patch.strength.expand(batch, 2)
        capability = torch.minimum(
            capability, drawbar_capability(rover, patch.constants.expand(batch, 6), strength)
        )
    return random_hills(batch, capability, generator)


def _first_band(rover: Rover, ground: Ground, batch: int) -> tuple[Tensor, Tensor]:
    """Return the ends [batch] [N m] of the first band of S2.

    On the first patch and under an even load every torque in it pulls.

    The upper end is HIGHEST_TORQUE times the free-rolling torque, on weak ground the torque at
    HIGHEST_SLIP.
    """
    first = ground.patches[0]
    constants, strength = first.constants.expand(batch, 6), first.strength.expand(batch, 2)
    wheel = WheelGround(rover.wheel_radius, rover.wheel_width, constants, strength, quadrature(8))
    load = torch.full((batch,), rover.weight / len(rover.wheels), dtype=torch.float64)
    slip = torch.full_like(load, HIGHEST_SLIP)
    most = wheel.forces(slip, equilibrium_sinkage(wheel, slip, load))[..., 2]
    free = wheel.forces(*free_rolling(wheel, load))[..., 2]
    high = torch.minimum(HIGHEST_TORQUE * free, most)
    return torch.lerp(free, high, 1.0 / 3.0), high
