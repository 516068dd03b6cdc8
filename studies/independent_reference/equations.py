# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the simulator's equations say of one instant, given its true inputs and the ground.

A world psi [P, 4] is (c [Pa], tan phi, mass, centre): mass [1] relative to the rover file's and
more, centre of mass [m] ahead of the file's. The inputs of an instant are the slips and contact
angles of its W axles, the pitch, and the friction of its K = W - 1 moments. From these and a world
the sinkages follow, at which the W balances of load and moments hold, and then torques and
acceleration. Forces and balances are those of ``terramechanics.contact.stresses`` and
``terramechanics.vehicle.suspension``; nothing here is from ``terrain_estimator``.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from terramechanics.contact.stresses import many_wheel_forces, quadrature
from terramechanics.simulation.sample import Measurement
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import (
    Geometry,
    axle_places,
    balances,
    directions,
    geometry_of,
)

POINTS = 12
"""Quadrature points of the forces, those of the simulator: 2e-8 of the largest force."""
FRICTION = 1e-3
"""[m g L] Deviation of each moment: friction of joints, inertia of wheels (docs/method.md)."""


class Seen(NamedTuple):
    """What is measured at T instants, with the stated deviations."""

    slip: Tensor  # [T, W]
    slip_sd: Tensor
    sinkage: Tensor  # [T, W] [m]
    sinkage_sd: Tensor
    angle: Tensor  # [T, W] [rad] contact angles
    angle_sd: Tensor
    torque: Tensor  # [T, W] [N m] less what turns the wheel's own inertia
    torque_sd: Tensor
    pitch: Tensor  # [T] [rad]
    pitch_sd: Tensor
    velocity: Tensor  # [T] [m/s]
    velocity_sd: Tensor
    bogie_angle: Tensor  # [T] [rad] exact


class Inputs(NamedTuple):
    """True inputs [P, T, N, ...] of P worlds, T instants and N samples."""

    slip: Tensor  # [..., W]
    angle: Tensor  # [..., W] [rad]
    pitch: Tensor  # [...] [rad]
    friction: Tensor  # [..., K] in FRICTION


class Balances(NamedTuple):
    """Balances of each instant, B = 2 + K: acceleration [m/s^2], load [m g], moments [m g L]."""

    matrix: Tensor  # [..., B, W, 3] what N, T [N] and M [N m] of one wheel add
    target: Tensor  # [..., B] what the sums have to be, with zero acceleration


@dataclass(frozen=True, slots=True)
class Equations:
    """The equations of a rover on one soil with exact constants."""

    rover: Rover
    constants: Tensor  # [6]
    nodes: Tensor  # [2, POINTS]
    geometry: Geometry

    @classmethod
    def of(cls, rover: Rover, soil: Soil) -> "Equations":
        """Return the equations of ``rover`` on ``soil``."""
        return cls(rover, soil.constants(), quadrature(POINTS), geometry_of(rover))

    @property
    def inputs(self) -> int:
        """Return the number E of inputs of an instant."""
        return 3 * self.rover.axles

    def at(self, seen: Seen, error: Tensor) -> Inputs:
        """Return the inputs that differ from the measured ones by ``error`` [P, T, N, E].

        It is in stated deviations, in the order of Inputs.
        """
        axles = self.rover.axles
        slip, angle, pitch, friction = error.split_with_sizes([axles, axles, 1, axles - 1], -1)
        return Inputs(
            seen.slip.unsqueeze(1) + seen.slip_sd.unsqueeze(1) * slip,
            seen.angle.unsqueeze(1) + seen.angle_sd.unsqueeze(1) * angle,
            seen.pitch.unsqueeze(1) + seen.pitch_sd.unsqueeze(1) * pitch.squeeze(-1),
            friction,
        )

    def forces(self, world: Tensor, slip: Tensor, log_depth: Tensor) -> Tensor:
        """Return N, T [N] and M [N m] of one wheel of each axle [P, T, N, W, 3].

        ``log_depth`` is the logarithm of the sinkage [m].
        """
        by_strength = many_wheel_forces(
            slip, log_depth.exp(), self.constants, self.rover.wheel_radius,
            self.rover.wheel_width, self.nodes,
        )  # fmt: skip
        strength = torch.cat([world[:, :2], torch.ones_like(world[:, :1])], 1)
        return (by_strength * strength.view(-1, 1, 1, 1, 1, 3)).sum(-1)

    def balances(self, world: Tensor, seen: Seen, inputs: Inputs) -> Balances:
        """Return the balances of the body of each world at these inputs."""
        ahead = self.geometry.centre[0] + world[:, 3]
        centre = torch.stack([ahead, self.geometry.centre[1].expand_as(ahead)], -1)
        geometry = self.geometry._replace(centre=centre.view(-1, 1, 1, 1, 2))
        joints = self.geometry.carried.shape[0]
        axle = axle_places(geometry, seen.bogie_angle.view(-1, 1, 1)[..., :joints])
        matrix = balances(geometry, axle, directions(inputs.angle))
        gravity, load = self.rover.gravity, torch.cos(inputs.pitch)
        head = torch.stack([gravity * torch.sin(inputs.pitch), load], -1)
        target = torch.cat([head, FRICTION * inputs.friction], -1)
        return Balances(matrix * self._unit(world), target)

    def _unit(self, world: Tensor) -> Tensor:
        """Return what turns forces of single wheels into the rows' units [P, 1, 1, B, 1, 1]."""
        rover, moments = self.rover, self.rover.axles - 1
        base = rover.axle_x[0] - rover.axle_x[-1]
        by_weight = [1.0 / rover.gravity] + [1.0 / (rover.gravity * base)] * moments
        unit = torch.tensor([1.0, *by_weight], dtype=torch.float64)
        mass = rover.mass * (1.0 + world[:, 2])
        return rover.wheels_per_axle * unit.view(1, 1, 1, -1, 1, 1) / mass.view(-1, 1, 1, 1, 1, 1)


def excess(balance: Balances, forces: Tensor) -> Tensor:
    """Return the acceleration [m/s^2] and what load and moments have too much [P, T, N, B]."""
    return torch.einsum("...bwf,...wf->...b", balance.matrix, forces) - balance.target


def seen_of(measurement: Measurement, rover: Rover, index: int, step_s: float) -> Seen:
    """Return what one drive of a measured batch shows, T instants ``step_s`` apart.

    The part of the torque that turns a wheel's inertia is unknown before the first instant, and
    taken as zero.
    """
    time = measurement.velocity.shape[1]
    gain = torch.diff(measurement.wheel_rate[index], dim=0) / step_s
    spin = torch.nn.functional.pad(gain, [0, 0, 1, 0])
    return Seen(
        measurement.slip[index], measurement.slip_sd[index],
        measurement.sinkage[index], measurement.sinkage_sd[index],
        measurement.contact_angle[index], measurement.contact_angle_sd[index],
        measurement.torque[index] - rover.wheel_inertia * spin, measurement.torque_sd[index],
        measurement.pitch[index], measurement.pitch_sd[index],
        measurement.velocity[index], measurement.velocity_sd[index],
        measurement.bogie_angle.expand(len(measurement.velocity), time)[index],
    )  # fmt: skip
