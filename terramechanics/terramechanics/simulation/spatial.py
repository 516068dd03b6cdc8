# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Dynamics of rovers with any number of wheels on uneven ground: driving, turning, crabbing.

The planar rover of simulation.py is the special case of equal wheels left and right that drive
straight ahead. As there, motion normal to the ground is quasi-static, steps are implicit, and each
step first moves the rover by its velocity and then solves the contacts at its new place. Rim speeds
and steering angles are commanded. Effects act as ``body_plant`` has them.

Ground is a plane slope and what rises above it. Places and headings are those along the plane; the
body leans from the plane by as much as the ground does.
"""

from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from terramechanics.contact.stresses import quadrature
from terramechanics.contact.tracks import Tracks
from terramechanics.simulation.body_plant import BodyPlant, WheelEffects
from terramechanics.simulation.sample import SLOWEST, TIME_STEP
from terramechanics.terrain.field import GroundField, Uniform
from terramechanics.terrain.soil import CONSTANTS
from terramechanics.terrain.surface import Level, Surface
from terramechanics.vehicle.body_step import BodyContacts, BodyStep, solve_body
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.stance import Attitude, solve_stance

POINTS, COARSE_POINTS = 12, 3
"""Quadrature points of the forces and of the Jacobian, as in simulation.py."""
LONG_STEP = 1e3
"""[s] Step in which a drive reaches its steady state."""

_nodes = cache(quadrature)
_STIFFNESS = [CONSTANTS.index("k_c"), CONSTANTS.index("k_phi")]


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane that rises by these slopes [1] along the world's x and y, [batch] or numbers."""

    slope_x: float | Tensor = 0.0
    slope_y: float | Tensor = 0.0

    def gravity(self, gravity: float) -> Tensor:
        """Return gravity [m/s^2] in the frame of the plane, [3] or [batch, 3].

        Its x is the plane's steepest line above the world's x, its z the normal. ``gravity``
        [m/s^2] is positive.
        """
        x, y = (torch.as_tensor(s, dtype=torch.float64) for s in (self.slope_x, self.slope_y))
        level, whole = torch.sqrt(1.0 + x**2), torch.sqrt(1.0 + x**2 + y**2)
        along = (-x / level).expand_as(whole)
        return gravity * torch.stack([along, -y / (level * whole), -1.0 / whole], -1)


@dataclass(frozen=True, slots=True)
class BodySample:
    """True values at the end of a step; forces and torques hold over the step."""

    time: Tensor  # [batch] [s]
    position: Tensor  # [batch, 2] [m] of the centre of mass, along the plane
    heading: Tensor  # [batch] [rad], to the left
    velocity: Tensor  # [batch, 3] v_x, v_y [m/s] of the centre of mass, yaw rate [rad/s]
    gravity: Tensor  # [batch, 3] in the body's frame [m/s^2]
    rim: Tensor  # [batch, wheels] r w [m/s]
    steering: Tensor  # [batch, wheels] [rad], to the left
    contact_angle: Tensor  # [batch, wheels] [rad] of the ground along each heading, from the body
    joints: Tensor  # [batch, J] [rad] angles of the passive joints, nose-up
    along: Tensor  # [batch, wheels] velocity of the hub along its heading [m/s]
    across: Tensor  # [batch, wheels] and to the left of it [m/s]
    depth: Tensor  # [batch, wheels] [m] in the ground, negative where a wheel is lifted
    forces: Tensor  # [batch, wheels, 4] N, T [N], M [N m], Y [N] of each wheel
    torque: Tensor  # [batch, wheels] [N m] drive torque: M + wheel_inertia dw/dt
    solved: Tensor  # [batch] bool: the balances have been solved

    @property
    def sinkage(self) -> Tensor:
        """Sinkage [batch, wheels] [m], zero where a wheel is lifted."""
        return self.depth.clamp(min=0.0)

    @property
    def slip(self) -> Tensor:
        """Slip 1 - v_x / (r w) [batch, wheels] [1], not finite where the wheel is locked."""
        return 1.0 - self.along / self.rim

    @property
    def pitch(self) -> Tensor:
        """Pitch [batch] [rad], nose-up."""
        return torch.asin(-self.gravity[:, 0] / self.gravity.norm(dim=-1))

    @property
    def roll(self) -> Tensor:
        """Angle of the body's y axis above the horizon [batch] [rad], left side up."""
        return torch.asin(-self.gravity[:, 1] / self.gravity.norm(dim=-1))


class BodySimulation:
    """Simulation of a batch of rovers; the same inputs give the same samples."""

    def __init__(
        self,
        chassis: Chassis,
        constants: Tensor,
        strength: Tensor,
        plane: Plane | None = None,
        heading: Tensor | None = None,
        time_step: float = TIME_STEP,
        slowest: float = SLOWEST,
        surface: Surface | None = None,
        effects: BodyPlant | None = None,
        field: GroundField | None = None,
    ) -> None:
        """Start at rest at the origin, with ``heading`` [batch] [rad], 0 by default.

        ``surface`` is what rises above the plane, by default nothing; ``effects`` are what the
        nominal model lacks. Raises ConfigError for effects that are not simulated here.

        Soil ``constants`` [batch, 6] in the order of CONSTANTS and ``strength`` [batch, 2], c [Pa]
        and tan(phi), are the mean of the ``field``, by default the same everywhere. A step lasts
        ``time_step`` [s]. ``slowest`` [m/s] is that of rolling_forces: rovers at rest creep by less
        than it.
        """
        batch = strength.shape[0]
        chassis = chassis if effects is None else effects.begin(chassis, batch)
        self.chassis, self.plane, self.time_step = chassis, plane or Plane(), time_step
        self._effects = effects
        self._slowest = slowest
        wheels = (batch, chassis.wheels)
        self._constants = constants.unsqueeze(-2).expand(*wheels, 6)
        self._strength = strength.unsqueeze(-2).expand(*wheels, 2)
        self.steps = 0
        zero = torch.zeros(batch, dtype=torch.float64)
        self.heading = zero.clone() if heading is None else heading.clone()
        self.position = torch.zeros(batch, 2, dtype=torch.float64)
        self.velocity = torch.zeros(batch, 3, dtype=torch.float64)
        self.rim = torch.zeros(wheels, dtype=torch.float64)
        self._depth = torch.full(wheels, 0.1 * chassis.wheel_radius, dtype=torch.float64)
        self._surface: Surface = surface or Level()
        self._field: GroundField = field or Uniform()
        self._attitude = Attitude.flat(chassis, self.position)
        self._gravity = self.plane.gravity(chassis.gravity)
        axes = self._attitude.rotation(self.heading)
        self._tracks = Tracks(
            self.wheel_places(), -2.0 * chassis.reach * axes[:, :2, 0], chassis.wheel_width
        )

    def settle(self, rim: Tensor, steering: Tensor, guess: Tensor) -> BodyContacts:
        """Start in the steady state of a command, near the velocity ``guess`` [batch, 3].

        ``rim`` [m/s] and ``steering`` [rad] are [batch, wheels].
        """
        self.velocity = guess
        effects = self._acting(rim)
        contacts = self._contacts(rim, steering, guess, LONG_STEP, effects, steady=True)
        self.velocity, self.rim = contacts.velocity, rim
        self._depth = contacts.depth
        return contacts

    def step(self, rim: Tensor, steering: Tensor) -> BodySample:
        """Simulate a step under rim speeds [m/s] and steering angles [rad], [batch, wheels]."""
        self._move()
        start = self.velocity
        effects = self._acting(rim)
        contacts = self._contacts(rim, steering, start, self.time_step, effects, steady=False)
        self.steps += 1
        torque = contacts.forces[..., 2] + self.chassis.wheel_inertia * (rim - self.rim) / (
            self.chassis.wheel_radius * self.time_step
        )
        if effects is not None:
            torque = torque + effects.friction()
            self._tracks.remember(self.wheel_places())
        self.velocity, self.rim, self._depth = contacts.velocity, rim, contacts.depth
        return BodySample(
            time=torch.full_like(self.heading, self.steps * self.time_step),
            position=self.position,
            heading=self.heading,
            velocity=self.velocity,
            gravity=self._felt(),
            rim=rim,
            steering=steering,
            contact_angle=self._stance.contact_angle(steering),
            joints=self._attitude.joints,
            along=contacts.motion.along,
            across=contacts.motion.across,
            depth=contacts.depth,
            forces=contacts.forces,
            torque=torque,
            solved=contacts.solved,
        )

    def wheel_places(self) -> Tensor:
        """Return the places of the wheels along the plane [batch, wheels, 2] [m]."""
        axes = self._attitude.rotation(self.heading)[:, :2, :2]
        return self.position.unsqueeze(1) + self.chassis.places() @ axes.mT

    def _acting(self, rim: Tensor) -> WheelEffects | None:
        """Return the effects of the step to come."""
        if self._effects is None:
            return None
        passes = self._tracks.passes(self.wheel_places())
        time = (self.steps + 1) * self.time_step
        return self._effects.step(time, rim, self.velocity[:, 0], passes)

    def _felt(self) -> Tensor:
        """Return gravity in the frame of the body [batch, 3] [m/s^2]."""
        axes = self._attitude.rotation(self.heading)
        return (axes.mT @ self._gravity.unsqueeze(-1)).squeeze(-1)

    def _move(self) -> None:
        """Move by the velocity of the last step, and turn it into the frame after the move."""
        along, left, turn = self.velocity.unbind(-1)
        angle = turn * self.time_step
        lean = self._attitude
        turned = angle * torch.cos(lean.roll) / torch.cos(lean.pitch)
        axes = lean.rotation(self.heading + 0.5 * turned)
        way = (axes[..., :2] @ self.velocity[:, :2].unsqueeze(-1)).squeeze(-1)
        self.position = self.position + self.time_step * way[:, :2]
        self.heading = self.heading + turned
        sine, cosine = torch.sin(angle), torch.cos(angle)
        self.velocity = torch.stack(
            [cosine * along + sine * left, cosine * left - sine * along, turn], -1
        )

    def _contacts(
        self,
        rim: Tensor,
        steering: Tensor,
        guess: Tensor,
        duration: float,
        effects: WheelEffects | None,
        *,
        steady: bool,
    ) -> BodyContacts:
        self._attitude, self._stance = solve_stance(
            self.chassis, self._surface, self.position, self.heading, self._attitude
        )
        factors = self._field.factors(self.wheel_places())
        constants = self._constants.clone()
        constants[..., _STIFFNESS] *= factors[..., 2:]
        step = BodyStep.of(
            self.chassis,
            constants,
            self._strength * factors[..., :2],
            _nodes(POINTS),
            _nodes(COARSE_POINTS),
            self._felt(),
            rim,
            steering,
            self.velocity,
            duration,
            self._slowest,
            steady=steady,
            stance=self._stance,
            effects=effects,
        )
        return solve_body(step, self._depth, guess)
