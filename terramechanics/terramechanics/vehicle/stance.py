# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How a body with passive joints stands on uneven ground, and the frames of its wheels there.

Wheels touch the undisturbed ground: sinkage is small beside the wheels and does not turn the body,
as in suspension.py. Heave, pitch, roll and the angles of the joints follow. Where more wheels are
left over than these, they follow by least squares, and gaps are left between wheels and ground.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terramechanics.terrain.surface import Surface
from terramechanics.vehicle.chassis import FREE, Chassis, PassiveJoint, Stance
from terramechanics.vehicle.suspension import TerrainError

TOLERANCE = 1e-11
"""[m] Change of the gaps at which the stance has converged."""
MAX_ITERATIONS = 40


@dataclass(frozen=True, slots=True)
class Attitude:
    """Where a body is above a plane: tensors [batch], ``joints`` [batch, J]."""

    height: Tensor  # [m] of the ground line below the centre of mass
    pitch: Tensor  # [rad] nose-up, from the plane
    roll: Tensor  # [rad] left side up, from the plane
    joints: Tensor  # [rad] of each joint, nose-up where it turns by 1
    contact: Tensor  # [batch, wheels, 2] [m] where the wheels touch the ground

    @classmethod
    def flat(cls, chassis: Chassis, position: Tensor) -> "Attitude":
        """Return that on the plane itself, at ``position`` [batch, 2] [m]."""
        zero = torch.zeros_like(position[:, 0])
        joints = zero.new_zeros(len(zero), len(chassis.joints))
        return cls(zero, zero, zero, joints, position.unsqueeze(-2) + chassis.places())

    def rotation(self, heading: Tensor) -> Tensor:
        """Return the matrix [batch, 3, 3] from the frame of the body to that of the plane."""
        return rotation(heading, self.pitch, self.roll)


def rotation(heading: Tensor, pitch: Tensor, roll: Tensor) -> Tensor:
    """Return the matrix [batch, 3, 3] of a body's axes; angles [batch] [rad].

    Yaw to the left, then pitch nose-up, then roll left side up.
    """
    sine_h, cosine_h = torch.sin(heading), torch.cos(heading)
    sine_p, cosine_p = torch.sin(pitch), torch.cos(pitch)
    sine_r, cosine_r = torch.sin(roll), torch.cos(roll)
    ahead = torch.stack([cosine_h * cosine_p, sine_h * cosine_p, sine_p], -1)
    level = torch.stack([-sine_h, cosine_h, torch.zeros_like(sine_h)], -1)
    above = torch.stack([-cosine_h * sine_p, -sine_h * sine_p, cosine_p], -1)
    left = cosine_r.unsqueeze(-1) * level + sine_r.unsqueeze(-1) * above
    up = cosine_r.unsqueeze(-1) * above - sine_r.unsqueeze(-1) * level
    return torch.stack([ahead, left, up], -1)


def solve_stance(
    chassis: Chassis, surface: Surface, position: Tensor, heading: Tensor, start: Attitude
) -> tuple[Attitude, Stance]:
    """Return attitude and stance at ``position`` [batch, 2] [m] and ``heading`` [batch] [rad].

    Position is that of the ground line below the centre of mass, along the plane. Newton's method
    with the derivatives on the plane, from ``start``. Raises TerrainError where it does not
    converge.
    """
    modes = chassis.modes()
    inverse = torch.linalg.pinv(modes)
    radius = chassis.wheel_radius
    foot = torch.tensor([*chassis.centre[:2], 0.0], dtype=torch.float64)
    ways = torch.cat([torch.stack([start.height, start.pitch, start.roll], -1), start.joints], -1)
    contact = start.contact
    for _ in range(MAX_ITERATIONS):
        height, pitch, roll = ways[:, :FREE].unbind(-1)
        hub, pivots = turned(chassis, ways[:, FREE:])
        axes = rotation(heading, pitch, roll)
        place = (hub - foot) @ axes.mT
        place = place + torch.cat([position, height.unsqueeze(-1)], -1).unsqueeze(-2)
        ground, gradient = surface.shape(contact)
        steep = torch.sqrt(1.0 + gradient.square().sum(-1))
        touched = place[..., :2] + radius * gradient / steep.unsqueeze(-1)
        # To first order the ground rises by its gradient over what the contact is off.
        off = (gradient * (touched - contact)).sum(-1)
        gap = place[..., 2] - ground - off - radius / steep
        move = gap @ inverse.mT
        ways = ways - move
        missed = float(torch.maximum(move.abs().max(), (touched - contact).abs().max()))
        contact = touched
        if missed < TOLERANCE:
            break
    else:
        raise TerrainError(
            f"{chassis.name} finds no stance: the ground is curved too sharply for its wheels"
        )
    normal = torch.cat([-gradient, torch.ones_like(gradient[..., :1])], -1) / steep.unsqueeze(-1)
    height, pitch, roll = ways[:, :FREE].unbind(-1)
    attitude = Attitude(height, pitch, roll, ways[:, FREE:], contact)
    return attitude, Stance(hub, normal @ axes, gap / steep, pivots)


def turned(chassis: Chassis, angles: Tensor) -> tuple[Tensor, Tensor]:
    """Return hubs [batch, wheels, 3] and pivots [batch, J, 2], x and z, in the body's frame [m].

    ``angles`` [batch, J] [rad] are of the joints. A joint turns what it carries, pivots of the
    joints before it included.
    """
    level = chassis.level_stance()
    hub = level.hub.expand(len(angles), -1, -1)
    pivots: list[Tensor] = []
    for index, joint in enumerate(chassis.joints):
        pivot = torch.tensor([joint.pivot_x, joint.pivot_height], dtype=torch.float64)
        angle = angles[:, index : index + 1]
        turns = torch.tensor(joint.turns, dtype=torch.float64)
        sides = _about(hub[..., ::2], pivot, angle * turns)
        hub = torch.stack([sides[..., 0], hub[..., 1], sides[..., 1]], -1)
        pivots = [
            _about(before.unsqueeze(-2), pivot, angle * _carrying(joint, chassis.joints[k].turns))
            .squeeze(-2)
            for k, before in enumerate(pivots)
        ]  # fmt: skip
        pivots.append(pivot.expand(len(angles), 2))
    return hub, torch.stack(pivots, 1) if pivots else hub.new_zeros(len(angles), 0, 2)


def _about(point: Tensor, pivot: Tensor, angle: Tensor) -> Tensor:
    """Return x and z of points [batch, n, 2] turned by ``angle`` [batch, n] nose-up."""
    arm, drop = (point - pivot).unbind(-1)
    sine, cosine = torch.sin(angle), torch.cos(angle)
    return pivot + torch.stack([arm * cosine - drop * sine, arm * sine + drop * cosine], -1)


def _carrying(joint: PassiveJoint, turns: Sequence[float]) -> float:
    """Return how much ``joint`` turns the pivot of a joint that turns its wheels by ``turns``."""
    return next(
        (outer for outer, inner in zip(joint.turns, turns, strict=True) if inner != 0.0), 0.0
    )
