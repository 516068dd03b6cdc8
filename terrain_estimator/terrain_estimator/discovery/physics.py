# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of a run under a hypothesis: the nominal rows with named effects of terramechanics in them.

Nothing is linearised in the size of an effect. Contact, push, payload and friction are the very functions that the
simulator calls; what an effect does to a sensor is undone on the measured inputs.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.prior import uncertain_constants
from terrain_estimator.rows import (
    MOMENT_VARIANCE,
    PA_PER_UNIT,
    Contact,
    Rows,
    agreeing_inputs,
    changes,
    expanded_wheels,
    measured_forces,
    rows_of_forces,
    values_alone,
    varied_inputs,
)
from terramechanics import plant
from terramechanics.contact import MAX_SLIP, MIN_SLIP, quadrature, wheel_forces
from terramechanics.effects import make_effect
from terramechanics.effects.soil import GROUSER_SLIP, Grousers, Multipass
from terramechanics.plant import Effect, Payload, Plant, Situation
from terramechanics.rover import Rover
from terramechanics.soil import Soil
from terramechanics.suspension import Body, Geometry, geometry_of

CONSTANTS_SD = 0.05 / math.sqrt(3.0)
"""[1] Relative prior deviation of each soil constant: uniform within 5 %."""

_POINTS = 4
"""Of the quadrature: forces within about 1e-4, far below what noise allows to see, for two thirds of the time."""


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
        return make_effect(self.name, self.size(values[0]), self.axle)


_ROOTED = ("exit_angle",)  # the angle goes like the root of the rebound
_BESIDE = {
    "payload": (Beside("moment along the body", "kg m", 10.0), Beside("moment of height", "kg m", 10.0)),
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
        mass = torch.full_like(where.velocity, self.mass if abs(self.mass) > _LIGHTEST else _LIGHTEST)
        body = where.rover
        return Payload(mass, body.centre_of_mass_x + self.along / mass, body.centre_of_mass_height + self.above / mass)


_LIGHTEST = 1e-6  # [kg] of a load that has a place


@dataclass(frozen=True, slots=True)
class Nominal:
    """Rover and soil as their files say."""

    rover: Rover
    soil: Soil
    contact: Contact
    uncertain: Tensor  # [M, 6] prior deviations of the uncertain soil constants


def nominal_of(rover: Rover, soil: Soil) -> Nominal:
    """The nominal model; its rows know how they change with each uncertain soil constant."""
    uncertain = uncertain_constants(soil.constants().unsqueeze(0), CONSTANTS_SD, rover.wheel_width)[0]
    stand_in = torch.tensor([0.1, 0.01, 0.01 * rover.wheel_radius, 1e-3 * rover.wheel_radius, 0.0, 0.0, 0.0, 0.0], dtype=torch.float64)
    contact = Contact(
        constants=soil.constants(),
        varied=torch.cat([torch.zeros(1, 6, dtype=torch.float64), 1e-3 * uncertain]),
        nodes=quadrature(_POINTS),
        column_unit=torch.tensor([PA_PER_UNIT, 1.0, 1.0], dtype=torch.float64),
        geometry=geometry_of(rover),
        body_scale=_body_scale(rover, rover.mass),
        moment_variance=MOMENT_VARIANCE,
        stand_in=stand_in.unsqueeze(1),
        gravity=rover.gravity,
        radius=rover.wheel_radius,
        width=rover.wheel_width,
    )
    return Nominal(rover, soil, contact, uncertain)


def _body_scale(rover: Rover, mass: float) -> Tensor:
    wheels, weight = rover.wheels_per_axle, mass * rover.gravity
    by_moment = wheels / (weight * (rover.axle_x[0] - rover.axle_x[-1]))
    return torch.tensor([wheels / mass, wheels / weight, by_moment, by_moment], dtype=torch.float64)


@dataclass(frozen=True, slots=True)
class Place:
    """Where the rows of a run are evaluated."""

    theta: Tensor  # [2] c [kPa], tan phi
    kappa: Tensor  # [M] soil constants, in prior deviations
    values: tuple[float, ...]  # of the hypothesis' parts, see Part.size


class Laws:
    """The rows of one run under one hypothesis, at any place."""

    def __init__(self, nominal: Nominal, blocks: Blocks, parts: tuple[Part, ...]) -> None:
        """Prepare what does not depend on the place."""
        self._nominal, self._blocks, self.parts = nominal, blocks, parts
        self._flat = blocks.packed.flatten(0, 1)
        count = self._flat.shape[0]
        axles = nominal.rover.axles
        self._where = Situation(
            rover=nominal.rover,
            time=math.nan,
            episode=torch.arange(count),
            place=torch.full((count, axles), math.nan, dtype=torch.float64),
            rate=blocks.wheel_rate.flatten(0, 1),
            velocity=self._flat[:, 8 * axles],
        )

    def likely(self, place: Place, chosen: Tensor) -> Tensor:
        """How far the inputs are, where all rows agree best, from the measured ones: [n, 8 A + 9], see ``likely_inputs``."""
        plant_, contact, packed = self._at(place)
        rows = self._rows(packed, packed, values_alone(contact), place, plant_)
        theta = torch.cat([place.theta, torch.ones_like(place.theta[:1])])
        return agreeing_inputs(rows, packed, contact, theta, chosen) - packed

    def rows(self, place: Place, away: Tensor, *, changes_too: bool) -> Rows:
        """Rows expanded ``away`` from the measured inputs; with their changes by the soil constants where asked for."""
        plant_, contact, packed = self._at(place)
        return self._rows(packed, packed + away, contact if changes_too else values_alone(contact), place, plant_)

    def _split(self, values: tuple[float, ...]) -> list[tuple[float, ...]]:
        rest = iter(values)
        return [tuple(next(rest) for _ in range(1 + len(part.beside))) for part in self.parts]

    def _at(self, place: Place) -> tuple[Plant, Contact, Tensor]:
        values = self._split(place.values)
        effects = [part.effect(own) for part, own in zip(self.parts, values, strict=True)]
        acting, where, nominal = Plant(effects), self._where, self._nominal
        contact = nominal.contact._replace(constants=nominal.contact.constants + place.kappa @ nominal.uncertain)
        if any(effect.payload(where) is not None for effect in effects):
            contact = _loaded(contact, nominal.rover, acting.body(where))
        packed = self._flat
        for part, own in zip(self.parts, values, strict=True):
            packed = undone(part, own, packed, self._blocks)
        axles = nominal.rover.axles
        torque = packed[:, 6 * axles : 7 * axles] - acting.friction(where)
        return acting, contact, torch.cat([packed[:, : 6 * axles], torque, packed[:, 7 * axles :]], 1)

    def _rows(self, packed: Tensor, likely: Tensor, contact: Contact, place: Place, acting: Plant) -> Rows:
        wheels = expanded_wheels(packed, likely, contact)
        varied = varied_inputs(wheels.place, contact)
        strength = place.theta * contact.column_unit[:2]
        touching = plant.Contact(varied.slip, varied.sinkage, varied.constants, strength.view(1, 1, 2))
        touching = acting.contact(self._where, touching)
        forces = wheel_forces(
            touching.slip, touching.sinkage, touching.constants, contact.radius, contact.width, contact.nodes, touching.exit_angle
        )
        push = acting.push(self._where, touching, torch.zeros_like(forces[..., 0]))
        forces = torch.cat([forces[..., :2], (forces[..., 2] + push).unsqueeze(-1)], -1)
        return rows_of_forces(packed, wheels, measured_forces(wheels, changes(forces, varied.scale, contact)), contact)


def _loaded(contact: Contact, rover: Rover, body: Body) -> Contact:
    mass, x, height = (float(torch.as_tensor(value).flatten()[0]) for value in (body.mass, body.x, body.height))
    centre = torch.tensor([x, height], dtype=torch.float64)
    geometry = contact.geometry
    return contact._replace(
        body_scale=_body_scale(rover, mass), geometry=Geometry(geometry.axle_x, centre, geometry.pivot, geometry.radius)
    )


def undone(part: Part, values: tuple[float, ...], packed: Tensor, blocks: Blocks) -> Tensor:
    """Packed observations [n, 8 A + 9] with what an effect does to the sensors taken back."""
    if part.name == "odometry_scale":
        return _without_scale(packed, values[0], values[1], blocks)
    return _UNDO[part.name](packed, values[0], blocks) if part.name in _UNDO else packed


def _axle_part(packed: Tensor, blocks: Blocks, index: int) -> tuple[slice, Tensor]:
    axles = blocks.wheel_rate.shape[-1]
    here = slice(index * axles, (index + 1) * axles)
    return here, packed[:, here]


def _with(packed: Tensor, here: slice, value: Tensor) -> Tensor:
    changed = packed.clone()
    changed[:, here] = value
    return changed


def _without_tilt(packed: Tensor, size: float, blocks: Blocks) -> Tensor:
    pitch = 8 * blocks.wheel_rate.shape[-1] + 2
    return _with(packed, slice(pitch, pitch + 1), packed[:, pitch : pitch + 1] - size)


def _in_slip_range(slip: Tensor) -> Tensor:
    return slip.clamp(MIN_SLIP, MAX_SLIP)


def _without_scale(packed: Tensor, size: float, unevenness: float, blocks: Blocks) -> Tensor:
    """i = (1 + e) reported - e; so is its deviation. e of an axle is size, more or less by its place from front to rear."""
    here, slip = _axle_part(packed, blocks, 0)
    spread, sd = _axle_part(packed, blocks, 1)
    middle = 0.5 * (slip.shape[1] - 1)
    error = size * (1.0 + unevenness * (torch.arange(slip.shape[1], dtype=torch.float64) - middle))
    return _with(_with(packed, here, _in_slip_range((1.0 + error) * slip - error)), spread, (1.0 + error) * sd)


_SHALLOWEST = 0.2
"""[1] Share of the reported sinkage that is left at least: a wheel on the ground has some."""


def _without_depth(packed: Tensor, size: float, blocks: Blocks) -> Tensor:
    here, sinkage = _axle_part(packed, blocks, 2)
    return _with(packed, here, torch.maximum(sinkage - size, _SHALLOWEST * sinkage))


def _without_delay(packed: Tensor, size: float, blocks: Blocks) -> Tensor:
    """Slip and sinkage moved on by ``size`` [s] along their slope between the neighbouring blocks."""
    here, slip = _axle_part(packed, blocks, 0)
    depth, sinkage = _axle_part(packed, blocks, 2)
    per_block = blocks.packed.shape[1]
    faster, deeper = (rate.repeat_interleave(per_block, 0) for rate in (blocks.signals.slip_rate, blocks.signals.sinkage_rate))
    moved = _with(packed, here, _in_slip_range(slip + size * faster))
    return _with(moved, depth, torch.maximum(sinkage + size * deeper, _SHALLOWEST * sinkage))


_UNDO: dict[str, Callable[[Tensor, float, Blocks], Tensor]] = {
    "slope_bias": _without_tilt,
    "sinkage_bias": _without_depth,
    "latency": _without_delay,
}
