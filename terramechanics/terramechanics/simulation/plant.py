# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Effects in the simulation: in the contact, on wheels and body, in drives and sensors.

An :class:`Effect` overrides the methods of the places where it physically acts; the others do
nothing. A :class:`Plant` is the effects of one simulation, in the order in which they act. Without
a plant the simulation is the nominal model.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import NamedTuple

import torch
from torch import Tensor

from terramechanics.contact.laws import contact_law
from terramechanics.contact.scm import Rut
from terramechanics.contact.stresses import compiled_wheel_torque
from terramechanics.simulation.sample import Sample
from terramechanics.terrain.soil import WONG_REECE
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import BodyLoad

Size = float | Tensor
"""Size of an effect: one for all episodes, or a tensor [batch] with one for each."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Inputs of forces besides slip and sinkage, constant within a step, of some episodes."""

    rover: Rover
    time: float  # [s] at the end of the step
    episode: Tensor  # [rows] number of each episode in the batch
    place: Tensor  # [rows, axles] [m] horizontal place at which the wheel touches the ground
    # [rows, axles] [rad/s] commanded wheel rate; under torque commands that of the step before
    rate: Tensor
    velocity: Tensor  # [rows] [m/s] at the start of the step
    # [rows, axles] wheels that rolled there before; None: those ahead, as of one that drives on
    passes: Tensor | None = None

    def rows(self, index: Tensor) -> "Situation":
        """Return the same for some of the episodes."""
        return dataclasses.replace(
            self,
            episode=self.episode[index],
            place=self.place[index],
            rate=self.rate[index],
            velocity=self.velocity[index],
            passes=None if self.passes is None else self.passes[index],
        )

    @property
    def order(self) -> Tensor:
        """Number of wheels that rolled over the same ground before, [axles] or [rows, axles]."""
        if self.passes is not None:
            return self.passes
        return torch.arange(self.rover.axles, dtype=torch.float64)

    @property
    def speed(self) -> Tensor:
        """Circumferential speed r w [rows, axles] [m/s]."""
        return self.rover.wheel_radius * self.rate


class ContactInputs(NamedTuple):
    """Inputs of the stress integrals of wheels. Shapes [..., rows, axles] that broadcast."""

    slip: Tensor  # [1]
    sinkage: Tensor  # [m]
    constants: Tensor  # [..., 6] in the order of CONSTANTS
    strength: Tensor  # [..., 2] c [Pa] and tan(phi) [1]
    # [rad] contact reaches so far behind the axle; None: it ends below the axle
    exit_angle: Tensor | None = None
    # [rad] between heading and way, positive where the wheel moves to the right; None: none
    slip_angle: Tensor | None = None
    rut: Rut | None = None  # of the wheels before; None: fresh ground

    def coefficients(
        self, radius: float, width: float, nodes: Tensor, law: str = WONG_REECE
    ) -> Tensor:
        """Return the forces of a wheel for these inputs, affine in the strength, [..., 3, 3]."""
        return contact_law(law)(
            self.slip,
            self.sinkage,
            self.constants,
            radius,
            width,
            nodes,
            self.exit_angle,
            self.slip_angle,
            self.rut,
        )

    def forces(self, radius: float, width: float, nodes: Tensor, law: str = WONG_REECE) -> Tensor:
        """Return N, T [N] and M [N m] of one wheel, [..., rows, axles, 3], by the stress integrals.

        At a slip angle there are four: the lateral force [N] is the last.
        """
        coefficients = self.coefficients(radius, width, nodes, law)
        return (
            torch.matmul(coefficients[..., :2], self.strength.unsqueeze(-1)).squeeze(-1)
            + coefficients[..., 2]
        )

    def torque(self, radius: float, width: float, nodes: Tensor) -> Tensor:
        """Return the M [N m] of :meth:`forces` on fresh ground of Wong and Reece, [..., axles]."""
        coefficients = compiled_wheel_torque()(
            self.slip,
            self.sinkage,
            self.constants,
            radius,
            width,
            nodes,
            self.exit_angle,
            self.slip_angle,
        )
        return (coefficients * self.strength).sum(-1)

    def expanded(self) -> "ContactInputs":
        """Return the same with all leading dimensions spelled out."""
        parts = (self.slip, self.sinkage, self.constants[..., 0], self.strength[..., 0])
        slip, sinkage, *_ = torch.broadcast_tensors(*parts)  # type: ignore[no-untyped-call]
        return ContactInputs(
            slip,
            sinkage,
            self.constants.expand(*slip.shape, 6),
            self.strength.expand(*slip.shape, 2),
            None if self.exit_angle is None else self.exit_angle.expand_as(slip),
            None if self.slip_angle is None else self.slip_angle.expand_as(slip),
            None if self.rut is None else Rut(*(part.expand_as(slip) for part in self.rut)),
        )

    def wheels(self, chosen: Tensor) -> "ContactInputs":
        """Return the wheels of expanded inputs where ``chosen`` [axles] or [..., axles] is set.

        One mask for all rows keeps the leading dimensions; any other one flattens them.
        """
        index = (..., chosen) if chosen.dim() == 1 else chosen
        every = (..., chosen, slice(None)) if chosen.dim() == 1 else chosen
        return ContactInputs(
            self.slip[index],
            self.sinkage[index],
            self.constants[every],
            self.strength[every],
            None if self.exit_angle is None else self.exit_angle[index],
            None if self.slip_angle is None else self.slip_angle[index],
            None if self.rut is None else Rut(*(part[index] for part in self.rut)),
        )


def with_constants(
    inputs: ContactInputs, exponent: Tensor | None, stiffness: Tensor | None
) -> ContactInputs:
    """Return the inputs with sinkage exponent and stiffness times factors [..., rows, axles]."""
    n, k_c, k_phi, shear_modulus, c1, c2 = inputs.constants.unbind(-1)
    if exponent is not None:
        n = n * exponent
    if stiffness is not None:
        k_c, k_phi = k_c * stiffness, k_phi * stiffness
    parts = (n, k_c, k_phi, shear_modulus, c1, c2)
    columns = torch.broadcast_tensors(*parts)  # type: ignore[no-untyped-call]
    return ContactInputs(
        inputs.slip,
        inputs.sinkage,
        torch.stack(columns, -1),
        inputs.strength,
        inputs.exit_angle,
        inputs.slip_angle,
        inputs.rut,
    )


def with_exponent(inputs: ContactInputs, factor: Tensor) -> ContactInputs:
    """Return the inputs with the sinkage exponent times ``factor`` [..., rows, axles]."""
    return with_constants(inputs, factor, None)


def with_stiffness(inputs: ContactInputs, factor: Tensor) -> ContactInputs:
    """Return the inputs with the whole pressure-sinkage law times ``factor``."""
    return with_constants(inputs, None, factor)


def with_depth(inputs: ContactInputs, factor: Tensor) -> ContactInputs:
    """Return the inputs with the depth of the contact times ``factor`` [..., rows, axles]."""
    return ContactInputs(
        inputs.slip, inputs.sinkage * factor, inputs.constants, inputs.strength,
        inputs.exit_angle, inputs.slip_angle, inputs.rut,
    )  # fmt: skip


def with_exit_angle(inputs: ContactInputs, angle: Tensor) -> ContactInputs:
    """Return the inputs with contact to ``angle`` [..., rows, axles] [rad] behind the axle."""
    return ContactInputs(
        inputs.slip, inputs.sinkage, inputs.constants, inputs.strength, angle, inputs.slip_angle,
        inputs.rut,
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Pull:
    """A force on the body, [rows] each, in the body's axes, with its point of attack."""

    along: Tensor  # [N]
    up: Tensor  # [N]
    x: float = 0.0  # [m]
    height: float = 0.0  # [m] above the ground line


@dataclass(frozen=True, slots=True)
class Payload:
    """Mass that the nominal rover does not have: [rows] each."""

    mass: Tensor  # [kg]
    x: Tensor  # [m] along the body
    height: Tensor  # [m] above the ground line


class Effect:
    """An effect that the nominal model lacks. These methods leave the nominal model as it is."""

    @property
    def keeps_ruts(self) -> bool:
        """Whether it needs the ruts of the wheels before."""
        return False

    def begin(self, rover: Rover, batch: int) -> None:
        """Begin a new simulation of ``batch`` rovers: forget what was remembered."""

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """Change the inputs of the stress integrals: slip of the rim, soil, exit angle."""
        del where
        return contact

    def stresses(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """Change the forces of the contact law [..., rows, axles, 3], before other forces."""
        del where, contact
        return forces

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """Change N, T [N] and M [N m] of one wheel, [..., rows, axles, 3], which act on its axle.

        ``contact`` gave ``forces``. At a slip angle the lateral force [N] is a fourth one.
        """
        del where, contact
        return forces

    def payload(self, where: Situation) -> Payload | None:
        """Return the mass that the body carries in addition; None for none."""
        del where
        return None

    def pull(self, where: Situation) -> Pull | None:
        """Return a force on the body besides weight and wheels; None for none."""
        del where
        return None

    def friction(self, where: Situation) -> Tensor | None:
        """Return the torque lost between motor and wheel, [rows, axles] [N m]; None for none."""
        del where
        return None

    def remember(self, sample: Sample) -> None:
        """Take note at the end of a step of what later steps depend on."""

    def sensed(self, sample: Sample) -> Sample:
        """Return the sample for the sensors, before noise. Called once a step, in order."""
        return sample


class Plant:
    """The effects of a simulation, in the order in which they act."""

    def __init__(self, effects: Sequence[Effect]) -> None:
        """``effects`` remember a drive, so that a plant serves one simulation at a time."""
        self.effects = tuple(effects)

    def begin(self, rover: Rover, batch: int) -> None:
        """Begin a new simulation with every effect."""
        for effect in self.effects:
            effect.begin(rover, batch)

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """Return the inputs that all effects leave, one after the other."""
        return reduce(lambda before, effect: effect.contact(where, before), self.effects, contact)

    @property
    def keeps_ruts(self) -> bool:
        """Whether an effect needs the ruts of the wheels before."""
        return any(effect.keeps_ruts for effect in self.effects)

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """Return the wheel forces that all effects leave."""
        forces = reduce(
            lambda before, effect: effect.stresses(where, contact, before), self.effects, forces
        )
        return reduce(
            lambda before, effect: effect.push(where, contact, before), self.effects, forces
        )

    def body(self, where: Situation) -> BodyLoad:
        """Return mass, centre of mass and outer forces of every episode."""
        body = BodyLoad.of(where.rover)
        for payload in (effect.payload(where) for effect in self.effects):
            if payload is not None:
                body = body.loaded(payload.mass, payload.x, payload.height)
        for pull in (effect.pull(where) for effect in self.effects):
            if pull is not None:
                body = body.pulled(pull.along, pull.up, pull.x, pull.height)
        return body

    def friction(self, where: Situation) -> Tensor:
        """Return the sum of what the drives lose, [rows, axles] [N m]."""
        losses = (effect.friction(where) for effect in self.effects)
        return sum((loss for loss in losses if loss is not None), torch.zeros_like(where.rate))

    def remember(self, sample: Sample) -> None:
        """Pass a finished step to every effect."""
        for effect in self.effects:
            effect.remember(sample)

    def sensed(self, sample: Sample) -> Sample:
        """Return the sample that the sensors are given."""
        return reduce(lambda before, effect: effect.sensed(before), self.effects, sample)
