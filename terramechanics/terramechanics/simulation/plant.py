# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Where an effect that the nominal model lacks can act in the simulation: in the contact, on wheels and body, in drives and sensors.

An :class:`Effect` overrides the methods of the places where it physically acts, the others do
nothing. A :class:`Plant` is the effects of one simulation, in the order in which they act. Without
a plant the simulation is the nominal model.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import torch
from torch import Tensor

from terramechanics.contact.stresses import CONSTANTS, wheel_forces
from terramechanics.simulation.sample import Sample
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import BodyLoad

Size = float | Tensor
"""Size of an effect: one for all episodes, or a tensor [batch] with one for each."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Of some episodes: all that forces may depend on besides slip and sinkage. It does not change within a step."""

    rover: Rover
    time: float  # [s] at the end of the step
    episode: Tensor  # [rows] number of each episode in the batch
    place: Tensor  # [rows, axles] [m] horizontal place at which the wheel touches the ground
    rate: Tensor  # [rows, axles] [rad/s] commanded wheel rate; under torque commands that of the step before
    velocity: Tensor  # [rows] [m/s] at the start of the step

    def rows(self, index: Tensor) -> "Situation":
        """The same for some of the episodes."""
        return dataclasses.replace(
            self,
            episode=self.episode[index],
            place=self.place[index],
            rate=self.rate[index],
            velocity=self.velocity[index],
        )

    def of(self, size: Size) -> Tensor:
        """The size of an effect for each wheel, as [rows, 1] or []."""
        if isinstance(size, Tensor):
            return size[self.episode].unsqueeze(-1) if size.dim() else size
        return torch.tensor(size, dtype=torch.float64)

    @property
    def order(self) -> Tensor:
        """Number of wheels that rolled over the same ground before, [axles]."""
        return torch.arange(self.rover.axles, dtype=torch.float64)

    @property
    def speed(self) -> Tensor:
        """Circumferential speed r w [rows, axles] [m/s]."""
        return self.rover.wheel_radius * self.rate


@dataclass(frozen=True, slots=True)
class ContactInputs:
    """What the stress integrals of wheels are evaluated at. Shapes [..., rows, axles] that broadcast."""

    slip: Tensor  # [1]
    sinkage: Tensor  # [m]
    constants: Tensor  # [..., 6] in the order of CONSTANTS
    strength: Tensor  # [..., 2] c [Pa] and tan(phi) [1]
    exit_angle: Tensor | None = (
        None  # [rad] contact reaches so far behind the axle; None: it ends below the axle
    )
    slip_angle: Tensor | None = (
        None  # [rad] between heading and way, positive where the wheel moves to the right; None: straight ahead
    )

    def with_constants(self, **factors: Tensor) -> "ContactInputs":
        """The same with soil constants, by their names, multiplied by ``factors`` [..., rows, axles]."""
        columns = list(self.constants.unbind(-1))
        for name, factor in factors.items():
            columns[CONSTANTS.index(name)] = columns[CONSTANTS.index(name)] * factor
        alike = torch.broadcast_tensors(*columns)  # type: ignore[no-untyped-call]
        return dataclasses.replace(self, constants=torch.stack(alike, dim=-1))

    def stiffened(self, factor: Tensor) -> "ContactInputs":
        """The same with the whole pressure-sinkage law multiplied by ``factor`` [..., rows, axles]."""
        return self.with_constants(k_c=factor, k_phi=factor)

    def forces(self, radius: float, width: float, nodes: Tensor) -> Tensor:
        """N, T [N] and M [N m] of one wheel from the stress integrals, [..., rows, axles, 3]; at a slip angle the lateral force [N] too."""
        coefficients = wheel_forces(
            self.slip,
            self.sinkage,
            self.constants,
            radius,
            width,
            nodes,
            self.exit_angle,
            self.slip_angle,
        )
        return (
            torch.matmul(coefficients[..., :2], self.strength.unsqueeze(-1)).squeeze(-1)
            + coefficients[..., 2]
        )

    def expanded(self) -> "ContactInputs":
        """The same with all leading dimensions spelled out."""
        parts = (self.slip, self.sinkage, self.constants[..., 0], self.strength[..., 0])
        slip, sinkage, *_ = torch.broadcast_tensors(*parts)  # type: ignore[no-untyped-call]
        angles = (
            None if angle is None else angle.expand_as(slip)
            for angle in (self.exit_angle, self.slip_angle)
        )
        return ContactInputs(
            slip,
            sinkage,
            self.constants.expand(*slip.shape, 6),
            self.strength.expand(*slip.shape, 2),
            *angles,
        )

    def part(self, mask: Tensor) -> "ContactInputs":
        """The wheels of an expanded contact where ``mask`` is set."""
        angles = (
            None if angle is None else angle[mask] for angle in (self.exit_angle, self.slip_angle)
        )
        return ContactInputs(
            self.slip[mask], self.sinkage[mask], self.constants[mask], self.strength[mask], *angles
        )


@dataclass(frozen=True, slots=True)
class Pull:
    """A force on the body: [rows] each, along and up in the body's axes, with its point of attack."""

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
    """Something that the nominal model lacks. Every method here leaves the nominal model as it is."""

    def begin(self, rover: Rover, batch: int) -> None:
        """A new simulation of ``batch`` rovers begins: forget what was remembered."""

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """Change what the stress integrals are evaluated at: slip of the rim, soil, exit angle."""
        del where
        return contact

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """Change N, T [N] and M [N m] of one wheel, [..., rows, axles, 3], which act on its axle; ``contact`` gave ``forces``.

        At a slip angle there are four: the lateral force [N] is the last.
        """
        del where, contact
        return forces

    def payload(self, where: Situation) -> Payload | None:
        """Mass that the body carries in addition."""
        del where
        return None

    def pull(self, where: Situation) -> Pull | None:
        """A force on the body besides weight and wheels."""
        del where
        return None

    def friction(self, where: Situation) -> Tensor | None:
        """Torque that is lost between the motor and one wheel, [rows, axles] [N m]: the motor gives it in addition."""
        del where
        return None

    def remember(self, sample: Sample) -> None:
        """A step is over: take note of what later steps depend on."""

    def sensed(self, sample: Sample) -> Sample:
        """What the sensors are given instead of the true sample, before noise. Called once a step, in order."""
        return sample


class Plant:
    """The effects of a simulation, in the order in which they act."""

    def __init__(self, effects: Sequence[Effect]) -> None:
        """``effects`` remember what happened in a drive, so a plant serves one simulation at a time."""
        self.effects = tuple(effects)

    def begin(self, rover: Rover, batch: int) -> None:
        """See Effect."""
        for effect in self.effects:
            effect.begin(rover, batch)

    def contact(self, where: Situation, contact: ContactInputs) -> ContactInputs:
        """See Effect."""
        return reduce(lambda before, effect: effect.contact(where, before), self.effects, contact)

    def push(self, where: Situation, contact: ContactInputs, forces: Tensor) -> Tensor:
        """See Effect."""
        return reduce(
            lambda before, effect: effect.push(where, contact, before), self.effects, forces
        )

    def body(self, where: Situation) -> BodyLoad:
        """Mass, centre of mass and outer forces of every episode."""
        body = BodyLoad.of(where.rover)
        for payload in (effect.payload(where) for effect in self.effects):
            if payload is not None:
                body = body.loaded(payload.mass, payload.x, payload.height)
        for pull in (effect.pull(where) for effect in self.effects):
            if pull is not None:
                body = body.pulled(pull.along, pull.up, pull.x, pull.height)
        return body

    def friction(self, where: Situation) -> Tensor:
        """See Effect: the sum, [rows, axles] [N m]."""
        losses = (effect.friction(where) for effect in self.effects)
        return sum((loss for loss in losses if loss is not None), torch.zeros_like(where.rate))

    def remember(self, sample: Sample) -> None:
        """See Effect."""
        for effect in self.effects:
            effect.remember(sample)

    def sensed(self, sample: Sample) -> Sample:
        """See Effect."""
        return reduce(lambda before, effect: effect.sensed(before), self.effects, sample)
