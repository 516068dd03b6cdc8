# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden effects outside the library of named effects: the right verdict is "unknown"."""

import dataclasses

import torch
from torch import Tensor

from terramechanics.simulation.plant import ContactInputs, Pull, Situation
from terramechanics.simulation.sample import Sample
from terramechanics.vehicle.rover import Rover
from tests.hidden.sensing import Sensed
from tests.hidden.soil import Sized

TETHER_LENGTH = 10.0
"""[m] Distance at which a tether pulls with size."""
TETHER_MOUNT = (-0.8, 0.5)
"""[m] Place along the body and height at which it is fastened."""
DRIFT_TIME = 60.0
"""[s] Time after which a torque gain has drifted by size."""
EDGE = 0.1
"""[m] Length of track over which a crust gives way."""
MEMORY = 100
"""Samples that a slow clock can be behind."""
ROCK_SPACING, ROCK_LENGTH = 0.9, 0.08
"""[m] Distance of buried rocks along the track, and half length of one."""
FLEX_AT = 300.0
"""[N] Load at which a flexible wheel flattens by size."""


class Tether(Sized):
    """Pull of a tether behind the rover, growing with distance: size x / (10 m)."""

    def pull(self, where: Situation) -> Pull:
        driven = where.place[:, -1].clamp(min=0.0)
        force = self.sizes[where.episode] * driven / TETHER_LENGTH
        return Pull(-force, torch.zeros_like(force), *TETHER_MOUNT)


class GainDrift(Sensed):
    """Drifting gain of the torque measurement: (1 + size t / (60 s))."""

    def sensed(self, sample: Sample) -> Sample:
        gain = 1.0 + self.sizes * sample.time / DRIFT_TIME
        return dataclasses.replace(sample, torque=sample.torque * gain.unsqueeze(-1))


class Crust(Sized):
    """Crust that makes the ground (1 + size) times as stiff, up to the place where it breaks."""

    def __init__(self, sizes: Tensor, ends: Tensor) -> None:
        super().__init__(sizes)
        self.ends = ends  # [batch] [m]

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        whole = torch.sigmoid((self.ends[where.episode, None] - where.place) / EDGE)
        return stiffer(contact, 1.0 + self.size(where) * whole)


class Rocks(Sized):
    """Rocks below the surface, over which the ground is up to (1 + size) times as stiff."""

    def __init__(self, sizes: Tensor, first: Tensor) -> None:
        super().__init__(sizes)
        self.first = first  # [batch] [m] place of one of them

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        away = where.place - self.first[where.episode, None]
        away = away - ROCK_SPACING * torch.round(away / ROCK_SPACING)
        return stiffer(contact, 1.0 + self.size(where) * torch.exp(-((away / ROCK_LENGTH) ** 2)))


class FlexibleWheel(Sized):
    """Wheel that flattens: a longer patch carries more, and the hub is lower by the deflection.

    The deflection is size r per FLEX_AT of load; the patch carries (1 + 8 size) times as much, as
    that of a wheel with a larger radius.
    """

    def begin(self, rover: Rover, batch: int) -> None:
        super().begin(rover, batch)
        self.radius = rover.wheel_radius

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        return stiffer(contact, 1.0 + 8.0 * self.size(where))

    def sensed(self, sample: Sample) -> Sample:
        deflection = self.sizes.unsqueeze(-1) * self.radius * sample.normal / FLEX_AT
        return dataclasses.replace(sample, sinkage=sample.sinkage + deflection)


class CurrentLimit(Sensed):
    """Torque sensor that saturates: T / (1 + size |T|)."""

    def sensed(self, sample: Sample) -> Sample:
        more = 1.0 + self.sizes.unsqueeze(-1) * sample.torque.abs()
        return dataclasses.replace(sample, torque=sample.torque / more)


def stiffer(contact: ContactInputs, factor: Tensor) -> ContactInputs:
    """Return contact with k_c and k_phi ``factor`` times as large, [rows, axles or 1]."""
    columns = contact.constants.expand(*contact.slip.shape, 6).unbind(-1)
    constants = torch.stack(
        [columns[0], columns[1] * factor, columns[2] * factor, *columns[3:]], dim=-1
    )
    return contact._replace(constants=constants)


class SlowClock(Sensed):
    """Clock of odometry and inertial unit that loses size seconds each second.

    Wheel signals of the same stamp are then older than those of the body, by size t.
    """

    def begin(self, rover: Rover, batch: int) -> None:
        super().begin(rover, batch)
        self.count = 0
        self.past: list[dict[str, Tensor]] = []

    def sensed(self, sample: Sample) -> Sample:
        names = ("slip", "sinkage", "contact_angle", "wheel_rate", "torque")
        self.past.append({name: getattr(sample, name) for name in names})
        self.past = self.past[-MEMORY:]
        self.count += 1
        step = float(sample.time[0]) / self.count
        back = (self.sizes * sample.time / step).clamp(0.0, len(self.past) - 1.0)
        whole, episode = back.floor().long(), torch.arange(back.shape[0])
        share = (back - whole).unsqueeze(-1)
        late: dict[str, Tensor] = {}
        for name in names:
            series = torch.stack([entry[name] for entry in reversed(self.past)])
            older = series[(whole + 1).clamp(max=len(self.past) - 1), episode]
            late[name] = torch.lerp(series[whole, episode], older, share)
        return dataclasses.replace(sample, **late)
