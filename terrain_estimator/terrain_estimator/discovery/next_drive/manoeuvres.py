# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Short drives that could come next, and their simulated measurements."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.runs import RecordedRun
from terrain_estimator.model.packing import pack_measurement
from terramechanics.contact.sinkage import drawbar_capability
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.schedules import Command
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import Hills

SECONDS = 40.0
STEEPEST = math.radians(5.0)
"""[rad] Of a slope, and no more than half of what the ground's drawbar pull allows."""
WAVELENGTH = 4.0
"""[m] From one crest to the next."""
SWING, SWING_PERIOD = 0.3, 14.0
"""[1], [s] By which the rates of axles swing by themselves, a third of a period apart."""
FIRM_START, FIRMER = 2.0, 10.0
"""[m], [1] Where firm ground begins, and by how much stiffer it is."""


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """One drive."""

    name: str
    words: str
    legs: tuple[float, float] = (
        1.0,
        1.0,
    )  # speed of its two halves, in units of the cruising speed
    swing: float = 0.0  # [1] of each axle's rate by itself
    square: tuple[float, float] = (
        0.0,
        4.0,
    )  # [1] amplitude, [s] period of a square wave in all rates
    hilly: bool = False
    firm: bool = False


MANOEUVRES = (
    Manoeuvre("steady", "straight on level ground with all wheels at one rate"),
    Manoeuvre(
        "two_speeds", "straight on level ground, half of it at a third of the speed", (0.5, 1.5)
    ),
    Manoeuvre("starts", "starting and stopping sharply on level ground", square=(0.5, 4.0)),
    Manoeuvre(
        "axles_apart",
        "on level ground with each axle's rate swinging by itself, so that wheels slip differently",
        swing=SWING,
    ),
    Manoeuvre("slopes", "up and down slopes with all wheels at one rate", hilly=True),
    Manoeuvre(
        "slopes_apart",
        "up and down slopes with each axle's rate swinging by itself",
        swing=SWING,
        hilly=True,
    ),
    Manoeuvre(
        "firm_ground",
        "from the loose ground on to firm ground with each axle's rate swinging by itself",
        swing=SWING,
        firm=True,
    ),
    Manoeuvre(
        "firm_slopes", "over slopes of firm ground at two speeds", (0.5, 1.5), hilly=True, firm=True
    ),
)


@dataclass(slots=True)
class Commands:
    """Schedule of a batch of manoeuvres."""

    start_velocity: Tensor  # [batch] [m/s]
    radius: float  # [m]
    axles: int
    manoeuvres: Sequence[Manoeuvre]
    kind: Command = Command.RATE

    def command(self, time: float) -> Tensor:
        """Return the wheel rates at a time, as :class:`Schedule`."""
        phase = (
            2.0
            * math.pi
            * (time / SWING_PERIOD + torch.arange(self.axles, dtype=torch.float64) / self.axles)
        )
        factors = []
        for each in self.manoeuvres:
            amplitude, period = each.square
            high = math.floor(2.0 * time / period - 5e-7) % 2 == 0
            leg = each.legs[0 if time <= SECONDS / 2.0 else 1]
            factors.append(
                leg
                * (1.0 + (amplitude if high else -amplitude))
                * (1.0 + each.swing * torch.sin(phase))
            )
        return (self.start_velocity / self.radius).unsqueeze(1) * torch.stack(factors)


def drive(
    nominal: Nominal, strength: Tensor, manoeuvres: Sequence[Manoeuvre], plant: Plant, seed: int
) -> list[RecordedRun]:
    """Simulate the measurements of each manoeuvre with the effects of ``plant``.

    ``strength`` is c [Pa] and tan phi of the ground.
    """
    rover, batch = nominal.rover, len(manoeuvres)
    generator = torch.Generator().manual_seed(seed)
    constants, here = nominal.soil.constants().expand(batch, 6), strength.expand(batch, 2)
    firm = torch.tensor(
        [[FIRMER if each.firm else 1.0] for each in manoeuvres], dtype=torch.float64
    )
    stiffer = torch.cat([constants[:, :1], constants[:, 1:3] * firm, constants[:, 3:]], 1)
    ground = Ground(
        [
            Patch(constants, here, law=nominal.soil.law),
            Patch(stiffer, here, start=FIRM_START, transition=0.5, law=nominal.soil.law),
        ]
    )
    slope = (drawbar_capability(rover, constants, here).clamp(min=0.0) / 2.0).clamp(
        max=math.tan(STEEPEST)
    )
    hilly = torch.tensor([float(each.hilly) for each in manoeuvres], dtype=torch.float64)
    one = torch.ones(batch, 1, dtype=torch.float64)
    profile = Hills(
        0.0 * one, (slope * hilly).unsqueeze(1), 2.0 * math.pi / WAVELENGTH * one, 0.0 * one
    )
    cruise = torch.full((batch,), sum(rover.cruise_speed) / 2.0, dtype=torch.float64)
    commands = Commands(cruise, rover.wheel_radius, rover.axles, manoeuvres)
    driven = simulate(rover, ground, commands, SECONDS, generator, batch, profile, plant)
    gain = (
        torch.diff(driven.seen.wheel_rate, dim=1, prepend=driven.seen.wheel_rate[:, :1]) / TIME_STEP
    )
    seen = replace(driven.seen, torque=driven.seen.torque - rover.wheel_inertia * gain)
    packed = pack_measurement(measure_drive(rover, seen, Noise(), generator))
    time = TIME_STEP * torch.arange(packed.shape[1], dtype=torch.float64)
    moving = (~driven.sample.stuck).sum(1).tolist()
    return [
        RecordedRun(each.name, packed[k, :end], driven.seen.wheel_rate[k, :end], time[:end])
        for k, (each, end) in enumerate(zip(manoeuvres, moving, strict=True))
    ]
