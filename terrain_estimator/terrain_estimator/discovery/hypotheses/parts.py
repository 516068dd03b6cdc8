# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Named effects as parts of a hypothesis: how each acts in the simulation, and how what it does to sensors is undone."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.packing import (
    PackedView,
    view_of,
    with_pitch,
    with_sinkage,
    with_slip,
    with_slip_and_sd,
)
from terramechanics.effects import make_effect
from terramechanics.effects.laws import (
    GROUSER_SLIP,
    SHALLOWEST,
    in_slip_range,
    reported_slip,
    sinkage_behind,
    slip_behind,
    uneven,
)
from terramechanics.effects.soil import Grousers, LateralBulldozing, Multipass
from terramechanics.simulation.plant import Effect, Payload, Plant, Situation
from terramechanics.simulation.sample import Sample


@dataclass(frozen=True, slots=True)
class Beside:
    """Something about an effect besides its size that is not known: mean zero, physical within four deviations."""

    name: str
    unit: str
    sd: float


@dataclass(frozen=True, slots=True)
class Part:
    """One named effect of a hypothesis."""

    name: str
    axle: int | None = None  # for an effect of one axle

    def size(self, value: float) -> float:
        """The effect's size for the value that a fit moves: forces are smooth in the value."""
        return value**2 if self.name in _ROOTED else value

    def value(self, size: float) -> float:
        """The inverse of ``size``."""
        return math.sqrt(size) if self.name in _ROOTED else size

    def slope(self, value: float) -> float:
        """Change of the size with the value."""
        return 2.0 * value if self.name in _ROOTED else 1.0

    @property
    def beside(self) -> tuple[Beside, ...]:
        """What else has to be known of it."""
        return _BESIDE.get(self.name, ())

    def effect(self, values: tuple[float, ...]) -> Effect:
        """The effect for the values that a fit moves: that of the size, then those of ``beside``."""
        if self.name == "payload":
            return PlacedLoad(*values)
        if self.name == "multipass":
            return Multipass(values[0], 1.0 + values[1])
        if self.name == "grousers":
            return Grousers(values[0], GROUSER_SLIP * math.exp(values[1]))
        if self.name == "odometry_scale":
            return UnevenScale(*values)
        if self.name == "lateral_bulldozing":
            return LateralBulldozing(*values)
        return make_effect(self.name, self.size(values[0]), self.axle)


_ROOTED = ("exit_angle",)  # the angle goes like the root of the rebound
_BESIDE = {
    "payload": (
        Beside("moment along the body", "kg m", 10.0),
        Beside("moment of height", "kg m", 10.0),
    ),
    "multipass": (Beside("growth with later passes, less 1", "1", 0.5),),
    "odometry_scale": (Beside("unevenness from one axle to the next behind it", "1", 0.3),),
    "grousers": (Beside("logarithm of the slip that mobilises them", "1", 0.7),),
}


@dataclass
class PlacedLoad(Effect):
    """The registry's payload wherever it lies: its moments about the rover's centre of mass are not known."""

    mass: float  # [kg]
    along: float  # [kg m] mass times its distance in front of the centre of mass
    above: float  # [kg m] mass times its height above the centre of mass

    def payload(self, where: Situation) -> Payload:
        """See Effect."""
        mass = torch.full_like(
            where.velocity, self.mass if abs(self.mass) > _LIGHTEST else _LIGHTEST
        )
        body = where.rover
        return Payload(
            mass,
            body.centre_of_mass_x + self.along / mass,
            body.centre_of_mass_height + self.above / mass,
        )


@dataclass
class UnevenScale(Effect):
    """The registry's odometry_scale with wheels that are worn unevenly: of each axle by its place from front to rear."""

    size: float  # [1]
    unevenness: float  # [1]

    def error(self, axles: int) -> Tensor:
        """Of the radius of each axle's wheels, [axles]."""
        size, unevenness = (
            torch.tensor(value, dtype=torch.float64) for value in (self.size, self.unevenness)
        )
        return uneven(size, unevenness, torch.arange(axles, dtype=torch.float64))

    def sensed(self, sample: Sample) -> Sample:
        """See Effect."""
        return dataclasses.replace(
            sample, slip=reported_slip(sample.slip, self.error(sample.slip.shape[-1]))
        )


_LIGHTEST = 1e-6  # [kg] of a load that has a place


def _split(parts: tuple[Part, ...], values: tuple[float, ...]) -> list[tuple[float, ...]]:
    rest = iter(values)
    return [tuple(next(rest) for _ in range(1 + len(part.beside))) for part in parts]


def plant_of(parts: tuple[Part, ...], values: tuple[float, ...]) -> Plant:
    """The effects for the values that a fit moves, in a simulation."""
    return Plant([part.effect(own) for part, own in zip(parts, _split(parts, values), strict=True)])


def undone(
    parts: tuple[Part, ...], values: tuple[float, ...], packed: Tensor, blocks: Blocks
) -> Tensor:
    """Packed observations [n, P] with what the effects do to the sensors taken back."""
    for part, own in zip(parts, _split(parts, values), strict=True):
        if part.name == "odometry_scale":
            packed = _without_scale(packed, own[0], own[1], blocks)
        elif part.name in _UNDO:
            packed = _UNDO[part.name](packed, own[0], blocks)
    return packed


def _view(packed: Tensor, blocks: Blocks) -> PackedView:
    return view_of(packed, blocks.wheel_rate.shape[-1])


def _without_tilt(packed: Tensor, size: float, blocks: Blocks) -> Tensor:
    pitch = _view(packed, blocks).pitch - size
    return with_pitch(packed, pitch, blocks.wheel_rate.shape[-1])


def _without_scale(packed: Tensor, size: float, unevenness: float, blocks: Blocks) -> Tensor:
    view = _view(packed, blocks)
    error = UnevenScale(size, unevenness).error(view.slip.shape[1])
    return with_slip_and_sd(packed, slip_behind(view.slip, error), (1.0 + error) * view.slip_sd)


def _without_depth(packed: Tensor, size: float, blocks: Blocks) -> Tensor:
    sinkage = _view(packed, blocks).sinkage
    return with_sinkage(packed, sinkage_behind(sinkage, torch.tensor(size, dtype=torch.float64)))


def _without_delay(packed: Tensor, size: float, blocks: Blocks) -> Tensor:
    """Slip and sinkage moved on by ``size`` [s] along their slope between the neighbouring blocks."""
    view = _view(packed, blocks)
    per_block = blocks.packed.shape[1]
    faster, deeper = (
        rate.repeat_interleave(per_block, 0)
        for rate in (blocks.signals.slip_rate, blocks.signals.sinkage_rate)
    )
    moved = with_slip(packed, in_slip_range(view.slip + size * faster))
    depth = torch.maximum(view.sinkage + size * deeper, SHALLOWEST * view.sinkage)
    return with_sinkage(moved, depth)


_UNDO: dict[str, Callable[[Tensor, float, Blocks], Tensor]] = {
    "slope_bias": _without_tilt,
    "sinkage_bias": _without_depth,
    "latency": _without_delay,
}
