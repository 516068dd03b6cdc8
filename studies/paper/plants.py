# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The two plants of the paper, that of its text and that of its code.

Ground is level, torques are drawn every step.

INTEGRATED: the rover of terramechanics on the stress integrals, schedule S2, with suspension, load
transfer and six wheels.

CLOSED_FORM: the closed form f0 to f4, as in the authors' public code. Three wheels have the loads
of its suspension. Slip and sinkage are the least-squares compromise between load, torque, and a
traction of torque / r.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import torch
from torch import Tensor

from studies.baselines.drives import LevelDrives, Vehicle
from terrain_estimator.learning.tasks import PAPER, StrengthRange, degrees
from terramechanics.contact.stresses import in_range, wheel_forces_linear_stress
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.schedules import BAND_DURATION
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover


class PaperPlant(Enum):
    """Plant that moves the rover."""

    CLOSED_FORM = "closed form"
    INTEGRATED = "integrated"


@dataclass(frozen=True, slots=True)
class PaperNoise:
    """Noise as in the authors' code: relative deviations of slip and sinkage, level attitude."""

    slip: float = 0.05
    sinkage: float = 0.05
    velocity: float = 0.01  # [m/s]


@dataclass(frozen=True, slots=True)
class Draw(StrengthRange):
    """Range of strength, with each soil constant wrong by up to ``spread`` [1]."""

    spread: float = 0.0


TRAINING = Draw(PAPER.cohesion, PAPER.angle)
TESTING = Draw(((700.0, 1300.0),), (degrees(20.0, 45.0),), spread=0.05)
NARROW = Draw(((700.0, 1300.0),), (degrees(25.0, 40.0),))
"""The band of the authors' code, with exact soil constants."""


@dataclass(frozen=True, slots=True)
class TrueMotion:
    """True motion of a batch of drives; shapes as in LevelDrives."""

    slip: Tensor
    sinkage: Tensor
    torque: Tensor
    load: Tensor
    velocity: Tensor  # [batch, time + 1]
    good: Tensor  # [batch] bool: always moving, every wheel in the model's range


@dataclass(frozen=True, slots=True)
class Batch:
    """Drives that reached their end, and their share of all drives begun."""

    drives: LevelDrives
    kept: float


def vehicle(rover: Rover, plant: PaperPlant) -> Vehicle:
    """Return a rover for the methods; on the closed form it has one wheel an axle."""
    wheels = rover.wheels_per_axle if plant is PaperPlant.INTEGRATED else 1
    return Vehicle(rover.mass, wheels, rover.wheel_radius, rover.wheel_width, TIME_STEP)


def draw_drives(
    plant: PaperPlant,
    rover: Rover,
    soil: Soil,
    draw: Draw,
    duration_s: float,
    count: int,
    generator: torch.Generator,
    noise: PaperNoise | None = None,
) -> Batch:
    """Draw and measure ``count`` drives that reach their end.

    Raises ValueError where hardly any drive does.
    """
    parts: list[LevelDrives] = []
    begun = found = 0
    while found < count:
        size = max(8, count - found)
        share = [torch.rand(size, generator=generator, dtype=torch.float64) for _ in range(2)]
        strength = draw.strength(torch.stack(share, 1))
        error = 2.0 * torch.rand(size, 6, generator=generator, dtype=torch.float64) - 1.0
        constants = soil.constants() * (1.0 + draw.spread * error)
        motion = _MOTIONS[plant](rover, constants, strength, duration_s, generator)
        parts.append(
            measured(motion, strength, constants, noise or PaperNoise(), generator).subset(
                motion.good
            )
        )
        begun, found = begun + size, found + int(motion.good.sum())
        if begun > 20 * count + 200:
            raise ValueError(
                f"{soil.name}, {plant.value} plant: only {found} of {begun} drives went to their"
                " end; choose stronger ground"
            )
    return Batch(_joined(parts).subset(torch.arange(count)), found / begun)


def measured(
    motion: TrueMotion,
    strength: Tensor,
    constants: Tensor,
    noise: PaperNoise,
    generator: torch.Generator,
) -> LevelDrives:
    """Add the noise of the sensors; deviations follow from the measured values."""

    def shaken(true: Tensor) -> Tensor:
        return torch.randn(true.shape, generator=generator, dtype=torch.float64)

    slip = motion.slip * (1.0 + noise.slip * shaken(motion.slip))
    sinkage = (motion.sinkage * (1.0 + noise.sinkage * shaken(motion.sinkage))).clamp(min=1e-9)
    velocity = motion.velocity + noise.velocity * shaken(motion.velocity)
    return LevelDrives(
        slip=slip,
        slip_sd=noise.slip * slip.abs(),
        sinkage=sinkage,
        sinkage_sd=noise.sinkage * sinkage,
        torque=motion.torque,
        load=motion.load,
        velocity=velocity,
        velocity_sd=torch.tensor(noise.velocity, dtype=torch.float64),
        true_velocity=motion.velocity,
        true_slip=motion.slip,
        true_sinkage=motion.sinkage,
        strength=strength,
        true_constants=constants,
    )


def _joined(parts: list[LevelDrives]) -> LevelDrives:
    first = parts[0]
    names = first.__slots__
    values = {
        name: torch.cat([getattr(part, name) for part in parts])
        for name in names
        if name != "velocity_sd"
    }
    return LevelDrives(velocity_sd=first.velocity_sd, **values)


def integrated_motion(
    rover: Rover, constants: Tensor, strength: Tensor, duration_s: float, generator: torch.Generator
) -> TrueMotion:
    """Simulate the rover of terramechanics.

    The ground has ``constants`` [batch, 6] and ``strength`` [batch, 2].
    """
    drive = simulate(
        rover, Ground([Patch(constants, strength)]), "S2", duration_s, generator, constants.shape[0]
    )
    sample = drive.sample
    velocity = torch.cat([drive.start_velocity.unsqueeze(1), sample.velocity], 1)
    return TrueMotion(
        sample.slip,
        sample.sinkage,
        sample.ground_torque,
        sample.normal,
        velocity,
        drive.measurable().all(1),
    )


FIRST_BAND, SECOND_BAND = (0.9, 1.2), (0.3, 0.6)
"""[N m] Torques of one wheel in the authors' code, drawn anew for every wheel and step."""
SLIPS, DEPTHS = (-0.5, 0.9), (math.log(1e-6), math.log(0.2))
"""[1] and log of [m]: ranges of the search for slip and sinkage."""
LM_STEPS = 40
"""Levenberg-Marquardt steps of a wheel's compromise."""


def closed_form_motion(
    rover: Rover, constants: Tensor, strength: Tensor, duration_s: float, generator: torch.Generator
) -> TrueMotion:
    """Simulate the closed form of the authors' code, from rest, with torques of its two bands."""
    batch, steps = constants.shape[0], round(duration_s / TIME_STEP)
    share = torch.rand(batch, steps, rover.axles, generator=generator, dtype=torch.float64)
    first = (torch.arange(1, steps + 1) * TIME_STEP <= BAND_DURATION + 1e-6).view(1, -1, 1)
    torque = torch.where(
        first, torch.lerp(*_ends(FIRST_BAND), share), torch.lerp(*_ends(SECOND_BAND), share)
    )
    load = authors_loads(rover.weight, torque / rover.wheel_radius)
    slip, sinkage = _compromise(rover, torque.flatten(1), load.flatten(1), constants, strength)
    shape = (batch, steps, rover.axles)
    forces = closed_form_wheels(rover, slip, sinkage, constants, strength).view(*shape, 3)
    change = TIME_STEP / rover.mass * forces[..., 1].sum(-1)
    velocity = torch.cat([torch.zeros(batch, 1, dtype=torch.float64), change.cumsum(1)], 1)
    inside = in_range(slip, sinkage, constants.unsqueeze(1), rover.wheel_radius).all(1)
    good = inside & torch.isfinite(velocity).all(1) & (velocity[:, 1:] > 0.0).all(1)
    return TrueMotion(
        slip.view(shape), sinkage.view(shape), forces[..., 2], forces[..., 0], velocity, good
    )


_MOTIONS: dict[
    PaperPlant, Callable[[Rover, Tensor, Tensor, float, torch.Generator], TrueMotion]
] = {
    PaperPlant.CLOSED_FORM: closed_form_motion,
    PaperPlant.INTEGRATED: integrated_motion,
}


def closed_form_wheels(
    rover: Rover, slip: Tensor, sinkage: Tensor, constants: Tensor, strength: Tensor
) -> Tensor:
    """Return N, T [N] and M [N m] [batch, n, 3] of wheels [batch, n]."""
    affine = wheel_forces_linear_stress(
        slip, sinkage, constants.unsqueeze(1), rover.wheel_radius, rover.wheel_width
    )
    theta = torch.cat([strength, torch.ones_like(strength[:, :1])], 1)
    return torch.einsum("bnra,ba->bnr", affine, theta)


def _ends(band: tuple[float, float]) -> tuple[Tensor, Tensor]:
    low, high = torch.tensor(band, dtype=torch.float64)
    return low, high


def authors_loads(weight: float, traction: Tensor) -> Tensor:
    """Return the wheel loads [..., 3] of the authors' suspension under ``traction`` [..., 3], in N.

    They balance the weight and the moments of rocker and bogie about their pivots, on level ground.
    The lever arms are those of its links of 2, 1, 1.145 and 1.983 m. The bogie's second one is that
    of the code, not the true height.
    """
    total, (front, middle, rear) = traction.sum(-1), traction.unbind(-1)
    first = (0.9063 * weight + 1.3916 * front + 0.4226 * total) / 2.3205
    third = (0.5725 * (weight - first) - 0.1725 * middle - 1.3915 * rear) / 2.2898
    return torch.stack([first, weight - first - third, third], -1)


def _compromise(
    rover: Rover, torque: Tensor, load: Tensor, constants: Tensor, strength: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the slip and sinkage [batch, n] of wheels that best match ``load`` and ``torque``.

    The third condition is a traction of torque / r. Three conditions on two unknowns, in N, N and
    N m without weights, as in the authors' code.
    """
    target = torch.stack([load, torque / rover.wheel_radius, torque], -1)

    def miss(u: Tensor) -> Tensor:
        return closed_form_wheels(rover, u[..., 0], u[..., 1].exp(), constants, strength) - target

    slip = torch.full_like(torque, 0.02)
    depth = _carrying_sinkage(rover, slip, constants, strength, load).log()
    u = torch.stack([slip, depth], -1)
    left, damping = miss(u), torch.full_like(torque, 1e-2)
    small = 1e-6
    for _ in range(LM_STEPS):
        columns = [
            (miss(u + small * direction) - left) / small
            for direction in torch.eye(2, dtype=torch.float64)
        ]
        jacobian = torch.stack(columns, -1)
        normal = jacobian.transpose(-1, -2) @ jacobian
        lifted = normal + torch.diag_embed(
            damping.unsqueeze(-1) * normal.diagonal(dim1=-2, dim2=-1)
        )
        step = torch.linalg.solve(
            lifted, (jacobian.transpose(-1, -2) @ left.unsqueeze(-1))
        ).squeeze(-1)
        tried = u - step.clamp(-1.0, 1.0)
        tried = torch.cat([tried[..., :1].clamp(*SLIPS), tried[..., 1:].clamp(*DEPTHS)], -1)
        there = miss(tried)
        better = there.square().sum(-1) < left.square().sum(-1)
        u, left = (
            torch.where(better.unsqueeze(-1), tried, u),
            torch.where(better.unsqueeze(-1), there, left),
        )
        damping = (damping * torch.where(better, 0.3, 5.0)).clamp(1e-9, 1e6)
    return u[..., 0], u[..., 1].exp()


def _carrying_sinkage(
    rover: Rover, slip: Tensor, constants: Tensor, strength: Tensor, load: Tensor
) -> Tensor:
    """Return the sinkage [m] at which a wheel carries ``load`` [N] at ``slip``, both [batch, n].

    Found by bisection in its logarithm.
    """
    low, high = (torch.full_like(slip, end) for end in DEPTHS)
    for _ in range(12):  # a start, no solution
        middle = 0.5 * (low + high)
        carried = closed_form_wheels(rover, slip, middle.exp(), constants, strength)[..., 0] > load
        low, high = torch.where(carried, low, middle), torch.where(carried, middle, high)
    return (0.5 * (low + high)).exp()
