# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of a run under a hypothesis: the nominal rows with named effects of terramechanics in them.

Nothing is linearised in the size of an effect. Contact, push, payload and friction are the very
functions that the simulator calls; what an effect does to a sensor is undone on the measured
inputs.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses.parts import Part, plant_of, undone
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.model.agreement import agreement
from terrain_estimator.model.packing import view_of, with_torque
from terrain_estimator.model.prior import uncertain_constants
from terrain_estimator.model.rows import (
    MOMENT_VARIANCE,
    PA_PER_UNIT,
    ContactModel,
    Rows,
    changes,
    frame_of,
    measured_forces,
    places,
    rows_of_forces,
    values_alone,
    varied_inputs,
)
from terrain_estimator.model.stencil import stencil
from terramechanics.contact.stresses import quadrature, wheel_forces
from terramechanics.simulation import plant
from terramechanics.simulation.plant import Plant, Situation
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import BodyLoad, Geometry, geometry_of

CONSTANTS_SD = 0.05 / math.sqrt(3.0)
"""[1] Relative prior deviation of each soil constant: uniform within 5 %."""

_POINTS = 4
"""Of the quadrature: forces within about 1e-4, far below what noise allows to see, for two thirds of the time."""


@dataclass(frozen=True, slots=True)
class Nominal:
    """Rover and soil as their files say."""

    rover: Rover
    soil: Soil
    contact: ContactModel
    uncertain: Tensor  # [M, 6] prior deviations of the uncertain soil constants


def nominal_of(rover: Rover, soil: Soil) -> Nominal:
    """The nominal model; its rows know how they change with each uncertain soil constant."""
    uncertain = uncertain_constants(soil.constants().unsqueeze(0), CONSTANTS_SD, rover.wheel_width)[
        0
    ]
    stand_in = torch.tensor(
        [0.1, 0.01, 0.01 * rover.wheel_radius, 1e-3 * rover.wheel_radius, 0.0, 0.0, 0.0, 0.0],
        dtype=torch.float64,
    )
    contact = ContactModel(
        constants=soil.constants(),
        varied=torch.cat([torch.zeros(1, 6, dtype=torch.float64), 1e-3 * uncertain]),
        stencil=stencil(uncertain.shape[0]),
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
class LinearizationPoint:
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
        self._kept: tuple[tuple[Tensor, ...], Tensor] | None = None
        count = self._flat.shape[0]
        axles = nominal.rover.axles
        self._where = Situation(
            rover=nominal.rover,
            time=math.nan,
            episode=torch.arange(count),
            place=torch.full((count, axles), math.nan, dtype=torch.float64),
            rate=blocks.wheel_rate.flatten(0, 1),
            velocity=view_of(self._flat, axles).velocity,
        )

    def likely(self, place: LinearizationPoint, chosen: Tensor) -> Tensor:
        """How far the inputs are, where all rows agree best, from the measured ones: [n, P], see ``agreement``."""
        plant_, contact, packed = self._at(place)
        rows = self._rows(packed, packed, values_alone(contact), place, plant_)
        theta = torch.cat([place.theta, torch.ones_like(place.theta[:1])])
        return agreement(rows, packed, contact, theta, chosen).inputs - packed

    def rows(self, place: LinearizationPoint, away: Tensor, *, changes_too: bool) -> Rows:
        """Rows expanded ``away`` from the measured inputs; with their changes by the soil constants where asked for."""
        plant_, contact, packed = self._at(place)
        return self._rows(
            packed, packed + away, contact if changes_too else values_alone(contact), place, plant_
        )

    def _at(self, place: LinearizationPoint) -> tuple[Plant, ContactModel, Tensor]:
        acting, where, nominal = plant_of(self.parts, place.values), self._where, self._nominal
        contact = nominal.contact._replace(
            constants=nominal.contact.constants + place.kappa @ nominal.uncertain
        )
        if any(effect.payload(where) is not None for effect in acting.effects):
            contact = _loaded(contact, nominal.rover, acting.body(where))
        packed = undone(self.parts, place.values, self._flat, self._blocks)
        torque = view_of(packed, nominal.rover.axles).torque - acting.friction(where)
        return acting, contact, with_torque(packed, torque)

    def _rows(
        self,
        packed: Tensor,
        likely: Tensor,
        contact: ContactModel,
        place: LinearizationPoint,
        acting: Plant,
    ) -> Rows:
        frame = frame_of(packed, contact)
        expanded = places(likely, frame, contact)
        varied = varied_inputs(expanded, contact)
        strength = place.theta * contact.column_unit[:2]
        touching = plant.ContactInputs(
            varied.slip, varied.sinkage, varied.constants, strength.view(1, 1, 2)
        )
        touching = acting.contact(self._where, touching)
        forces = self._forces(touching, contact)
        push = acting.push(self._where, touching, torch.zeros_like(forces[..., 0]))
        forces = torch.cat([forces[..., :2], (forces[..., 2] + push).unsqueeze(-1)], -1)
        return rows_of_forces(
            frame, measured_forces(frame, expanded, changes(forces, varied.scale, contact))
        )

    def _forces(self, touching: plant.ContactInputs, contact: ContactModel) -> Tensor:
        """The stress integrals, those of the last call where nothing that they depend on has changed: many effects act elsewhere."""
        changing = (touching.slip, touching.sinkage, touching.constants)
        kept = self._kept
        if (
            touching.exit_angle is None
            and kept
            and all(torch.equal(one, other) for one, other in zip(kept[0], changing, strict=True))
        ):
            return kept[1]
        forces = _integrated(touching, contact)
        self._kept = None if touching.exit_angle is not None else (changing, forces)
        return forces


def _integrated(touching: plant.ContactInputs, contact: ContactModel) -> Tensor:
    """Stress integrals of braked wheels and of the others, each by themselves: those of braked wheels need twice the nodes."""
    shape = touching.slip.shape
    exits = touching.exit_angle
    found = torch.empty(touching.slip.numel(), 3, 3, dtype=torch.float64)
    columns = (touching.slip, touching.sinkage, *([] if exits is None else [exits]))
    flat = [column.expand(shape).reshape(-1) for column in columns]
    constants = touching.constants.expand(*shape, 6).reshape(-1, 6)
    braked = flat[0] < 0.0
    for chosen in (braked, ~braked):
        index = chosen.nonzero().squeeze(1)
        slip, sinkage, *angle = (column[index] for column in flat)
        found[index] = wheel_forces(
            slip, sinkage, constants[index], contact.radius, contact.width, contact.nodes, *angle
        )
    return found.view(*shape, 3, 3)


def _loaded(contact: ContactModel, rover: Rover, body: BodyLoad) -> ContactModel:
    mass, x, height = (
        float(torch.as_tensor(value).flatten()[0]) for value in (body.mass, body.x, body.height)
    )
    centre = torch.tensor([x, height], dtype=torch.float64)
    geometry = contact.geometry
    return contact._replace(
        body_scale=_body_scale(rover, mass),
        geometry=Geometry(geometry.axle_x, centre, geometry.pivot, geometry.radius),
    )
