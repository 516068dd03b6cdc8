# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Planar suspension: kinematics on a terrain profile, and the balances of body and joints.

It is that of the rover file: A axles and J = A - 2 passive joints, each of which carries some of
the axles; the body carries the others. Heights, pitch and angles of the joints follow from A
contacts, loads from the balances of force and moment of the rover and the moment of each joint.

Frames: x forward, z up, rotations nose-up positive. The body frame has its origin on the ground
line below the middle of the body. Wheels roll on the undisturbed profile: sinkage is small beside
the wheels and does not turn the body.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from terramechanics.terrain.profile import Profile
from terramechanics.vehicle.rover import Rover

TOLERANCE = 1e-11
"""[m] Gap between wheels and ground at which the kinematics has converged."""
MAX_ITERATIONS = 30


class TerrainError(ValueError):
    """A terrain over which the rover cannot roll."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Pose of the rover on the profile. Angles in rad, lengths in m."""

    x: Tensor  # [batch] horizontal place of the body's origin
    height: Tensor  # [batch] of the body's origin
    pitch: Tensor  # [batch] nose-up
    joint_angle: Tensor  # [batch, joints] of each joint relative to the body, nose-up
    contact: Tensor  # [batch, axles] horizontal place at which the wheel touches the ground
    contact_angle: Tensor  # [batch, axles] slope of the ground there relative to the body
    axle: Tensor  # [batch, axles, 2] x and z of the axles in the body frame

    @property
    def bogie_angle(self) -> Tensor:
        """Angle of the only joint, 0 of a rover without one [batch]."""
        return self.joint_angle[..., 0] if self.joint_angle.shape[-1] else 0.0 * self.pitch


def shifted_centre(centre: Tensor, moment: Tensor, mass: Tensor) -> Tensor:
    """Return the centre of mass [m] of a body of ``mass`` [kg] with a load.

    ``moment`` [kg m] is that of the load about ``centre``.
    """
    return centre + moment / mass


@dataclass(frozen=True, slots=True)
class BodyLoad:
    """Mass of the rover and outer forces on it: numbers, or tensors [batch]."""

    gravity: float  # [m/s^2]
    mass: float | Tensor  # [kg]
    x: float | Tensor  # [m] centre of mass along the body
    height: float | Tensor  # [m] of the centre of mass
    outer: Tensor | None = (
        None  # [batch, 3] what outer forces add to the first balances of :func:`balance_matrix`
    )

    @classmethod
    def of(cls, rover: Rover) -> "BodyLoad":
        """Return the body as the rover file has it."""
        return cls(rover.gravity, rover.mass, rover.centre_of_mass_x, rover.centre_of_mass_height)

    @property
    def weight(self) -> float | Tensor:
        """Weight m g [N]."""
        return self.mass * self.gravity

    def loaded(self, mass: Tensor, x: Tensor, height: Tensor) -> "BodyLoad":
        """Return the body with ``mass`` [batch] [kg] more at ``x`` and ``height`` [batch] [m]."""
        total = self.mass + mass
        old = (
            torch.as_tensor(self.x, dtype=torch.float64),
            torch.as_tensor(self.height, dtype=torch.float64),
        )
        centre = [
            shifted_centre(here, mass * (there - here), total)
            for here, there in zip(old, (x, height), strict=True)
        ]
        return BodyLoad(self.gravity, total, centre[0], centre[1], self.outer)

    def pulled(self, along: Tensor, up: Tensor, x: float, height: float) -> "BodyLoad":
        """Return the body with a force more, ``along`` and ``up`` [batch] [N].

        It acts on the body at ``x``, ``height`` [m], so on no joint; add the payload first.
        """
        moment = (x - self.x) * up - (height - self.height) * along
        force = torch.stack([along, up, moment], dim=-1)
        return BodyLoad(
            self.gravity,
            self.mass,
            self.x,
            self.height,
            force if self.outer is None else self.outer + force,
        )

    def rows(self, index: Tensor) -> "BodyLoad":
        """Return the body in some of the episodes."""
        if self.outer is None and not isinstance(self.mass, Tensor):
            return self
        mass, x, height = (
            value[index] if isinstance(value, Tensor) else value
            for value in (self.mass, self.x, self.height)
        )
        return BodyLoad(
            self.gravity, mass, x, height, None if self.outer is None else self.outer[index]
        )


class Geometry(NamedTuple):
    """Points of action of the forces in the body frame, for functions compiled by TorchScript."""

    axle_x: Tensor  # [axles] [m]
    centre: Tensor  # [2] centre of mass [m], or [n, 1, 2]
    # [axles, 2] [m] about which the axle turns: the pivot of its joint, the origin without one
    pivot: Tensor
    carried: Tensor  # [joints, axles] 1 where the joint carries the axle, else 0
    radius: float  # [m] of the wheels


def geometry_of(rover: Rover) -> Geometry:
    """Return the geometry of ``rover``."""
    centre = torch.tensor(
        (rover.centre_of_mass_x, rover.centre_of_mass_height), dtype=torch.float64
    )
    pivot = torch.zeros(rover.axles, 2, dtype=torch.float64)
    carried = torch.zeros(len(rover.suspension), rover.axles, dtype=torch.float64)
    for index, joint in enumerate(rover.suspension):
        carried[index, list(joint.axles)] = 1.0
        pivot[list(joint.axles)] = torch.tensor((joint.x, joint.height), dtype=torch.float64)
    return Geometry(
        torch.tensor(rover.axle_x, dtype=torch.float64), centre, pivot, carried, rover.wheel_radius
    )


def axle_places(geometry: Geometry, angle: Tensor) -> Tensor:
    """Return x and z of the axles in the body frame, [..., axles, 2] [m].

    ``angle`` [..., joints] [rad] is that of each joint, nose-up. An axle without a joint turns by
    sine 0 and cosine 1 about the origin, so that it stands exactly where the rover file has it.
    """
    sine = torch.sin(angle) @ geometry.carried
    cosine = torch.cos(angle) @ geometry.carried + (1.0 - geometry.carried.sum(0))
    pivot_x, pivot_z = geometry.pivot.unbind(-1)
    arm, drop = geometry.axle_x - pivot_x, geometry.radius - pivot_z
    return torch.stack(
        [pivot_x + arm * cosine - drop * sine, pivot_z + arm * sine + drop * cosine], -1
    )


def along_body(contact_angle: Tensor) -> Tensor:
    """Return the components of N, T, M along body x: [..., axles, 3] for angles [..., axles]."""
    return torch.stack(
        [-torch.sin(contact_angle), torch.cos(contact_angle), torch.zeros_like(contact_angle)],
        dim=-1,
    )


def directions(contact_angle: Tensor) -> Tensor:
    """Return the components of N, T, M along body x and z and about the axle.

    Shape [..., axles, 3, 3] for angles [..., axles].
    """
    along = along_body(contact_angle)
    minus_sine, cosine, zero = along.unbind(-1)
    up = torch.stack([cosine, -minus_sine, zero], dim=-1)
    return torch.stack([along, up, torch.stack([zero, zero, zero + 1.0], dim=-1)], dim=-2)


def balances(geometry: Geometry, axle: Tensor, action: Tensor) -> Tensor:
    """Return the force and moment balances per N, T, M of a wheel: [..., 3 + joints, axles, 3].

    Rows: force along body x [N], force along body z [N], moment of the whole rover about its centre
    of mass [N m], moment of each joint about its pivot [N m]. A joint has no mass, so its row sums
    to zero; the ground acts on an axle with N, T and, by way of the motor's mount, with the moment
    M of the shear stresses. ``axle`` from :func:`axle_places`, ``action`` from :func:`directions`.
    """
    along, up, turn = action.unbind(-2)
    ahead, above = (axle - geometry.centre).unsqueeze(-1).unbind(-2)
    whole = ahead * up - above * along + turn
    ahead, above = (axle - geometry.pivot).unsqueeze(-1).unbind(-2)
    about_pivot = (ahead * up - above * along + turn).unsqueeze(-3)
    joints = torch.where(geometry.carried.unsqueeze(-1) > 0.0, about_pivot, 0.0)
    return torch.cat([torch.stack([along, up, whole], dim=-3), joints], dim=-3)


def level_pose(rover: Rover, x: Tensor) -> Pose:
    """Return the pose on level ground at height 0, body origin at ``x`` [batch] [m].

    It is a start for :func:`solve_pose`.
    """
    zero = torch.zeros_like(x)
    joints = torch.zeros(*x.shape, len(rover.suspension), dtype=x.dtype)
    axle_x = torch.tensor(rover.axle_x, dtype=x.dtype)
    axle = torch.stack([axle_x, torch.full_like(axle_x, rover.wheel_radius)], dim=-1).expand(
        *x.shape, -1, -1
    )
    contact = x.unsqueeze(-1) + axle_x
    return Pose(x, zero, zero, joints, contact, torch.zeros_like(contact), axle)


def solve_pose(rover: Rover, profile: Profile, x: Tensor, start: Pose) -> Pose:
    """Solve the pose in which all wheels touch the profile, body origin at ``x`` [batch] [m].

    Newton in height, pitch, joints' angles and the places of contact, from ``start``. A wheel of
    radius r that touches the ground at s has its axle at (s - r sin a, h(s) + r cos a), a = atan
    h'(s). Raises TerrainError where the profile is curved more sharply than the wheel.
    """
    geometry = geometry_of(rover)
    contact, height, pitch, joints = (
        start.contact + (x - start.x).unsqueeze(-1),
        start.height,
        start.pitch,
        start.joint_angle,
    )
    for _ in range(MAX_ITERATIONS):
        axle = axle_places(geometry, joints)
        x_axle, z_axle = _to_world(axle, x, height, pitch)
        ground, slope, curvature = profile.shape(contact)
        cosine = torch.rsqrt(1.0 + slope**2)
        miss = contact - rover.wheel_radius * slope * cosine - x_axle
        stretch = 1.0 - rover.wheel_radius * curvature * cosine**3
        if bool((stretch < 0.1).any()):
            raise TerrainError(
                f"the terrain is curved too sharply for wheels of radius {rover.wheel_radius:g} m"
            )
        # To first order the axle's path has the ground's slope, so a miss along x changes the gap
        # by slope * miss.
        gap = z_axle - ground - rover.wheel_radius * cosine + slope * miss
        contact = contact - miss / stretch
        height, pitch, joints = _corrected(
            geometry, (x_axle, z_axle), (x, height, pitch, joints), slope, gap
        )
        if float(torch.maximum(gap.abs().max(), miss.abs().max())) < TOLERANCE:
            break
    # One more move of the contacts would change them by less than the tolerance; the angles follow
    # from the last slope.
    angle = torch.atan(profile.shape(contact)[1])
    return Pose(
        x, height, pitch, joints, contact, angle - pitch.unsqueeze(-1),
        axle_places(geometry, joints),
    )  # fmt: skip


def _to_world(point: Tensor, x: Tensor, height: Tensor, pitch: Tensor) -> tuple[Tensor, Tensor]:
    sine, cosine = torch.sin(pitch).unsqueeze(-1), torch.cos(pitch).unsqueeze(-1)
    along, up = point[..., 0], point[..., 1]
    return (
        x.unsqueeze(-1) + along * cosine - up * sine,
        height.unsqueeze(-1) + along * sine + up * cosine,
    )


def _corrected(
    geometry: Geometry,
    axle: tuple[Tensor, Tensor],
    state: tuple[Tensor, Tensor, Tensor, Tensor],
    slope: Tensor,
    gap: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return one Newton step of height, pitch and joints' angles that closes every ``gap``.

    ``axle`` holds x and z; shapes are [batch, axles] [m].
    """
    (x_axle, z_axle), (x, height, pitch, joints) = axle, state
    x_pivot, z_pivot = _to_world(geometry.pivot.expand(*x.shape, -1, -1), x, height, pitch)
    about_pivot = (x_axle - x_pivot) + slope * (z_axle - z_pivot)
    moves = [(x_axle - x.unsqueeze(-1)) + slope * (z_axle - height.unsqueeze(-1))]
    moves += [torch.where(carried > 0.0, about_pivot, 0.0) for carried in geometry.carried]
    # The body's height enters every gap alike: subtract the front wheel's row.
    columns = [move[..., 1:] - move[..., :1] for move in moves]
    turns = _solved(columns, gap[..., :1] - gap[..., 1:])
    lift = -gap[..., 0]
    for move, turn in zip(moves, turns, strict=True):
        lift = lift - move[..., 0] * turn
    bend = torch.stack(turns[1:], dim=-1) if turns[1:] else torch.zeros_like(joints)
    return height + lift, pitch + turns[0], joints + bend


def _solved(columns: list[Tensor], right: Tensor) -> list[Tensor]:
    """Solve the equations with these ``columns`` [..., m], m of them, by Cramer's rule.

    There are one or two of them, and for so few a general solver is slower and rounds otherwise.
    """
    determinant = _determinant(columns)
    return [
        _determinant([*columns[:k], right, *columns[k + 1 :]]) / determinant
        for k in range(len(columns))
    ]


def _determinant(columns: list[Tensor]) -> Tensor:
    """Return the determinant of the matrix with these columns [..., m], by its minors."""
    first, others = columns[0], columns[1:]
    if not others:
        return first[..., 0]
    total = torch.zeros_like(first[..., 0])
    for row in range(len(columns)):
        kept = [k for k in range(len(columns)) if k != row]
        term = first[..., row] * _determinant([column[..., kept] for column in others])
        total = total - term if row % 2 else total + term
    return total


def balance_matrix(rover: Rover, pose: Pose, body: BodyLoad | None = None) -> Tensor:
    """Return the balances per N, T, M of the wheels: shape [batch, 3 + joints, axles, 3].

    The rows are those of :func:`balances`; all wheels of an axle are counted. ``body`` is by
    default that of the rover.
    """
    geometry = geometry_of(rover)
    if body is not None:
        geometry = geometry._replace(
            centre=torch.stack([_per_axle(body.x), _per_axle(body.height)], dim=-1)
        )
    return balances(geometry, pose.axle, directions(pose.contact_angle)) * float(
        rover.wheels_per_axle
    )


def _per_axle(value: float | Tensor) -> Tensor:
    """Return a number as it is, [batch] as [batch, 1]."""
    return (
        value.unsqueeze(-1)
        if isinstance(value, Tensor)
        else torch.tensor(value, dtype=torch.float64)
    )


def balance_target(body: BodyLoad, pitch: Tensor, acceleration: Tensor, joints: int) -> Tensor:
    """Return the sums of the balances of :func:`balance_matrix`, [batch, 3 + joints].

    They are m (dv/dt + g sin ab), m g cos ab, and 0 for every moment, less outer forces.
    """
    zero = torch.zeros_like(pitch)
    along = body.mass * acceleration + body.weight * torch.sin(pitch)
    target = torch.stack([along, body.weight * torch.cos(pitch), zero], dim=-1)
    target = target if body.outer is None else target - body.outer
    return torch.nn.functional.pad(target, [0, joints])


def wheel_loads(
    rover: Rover, pose: Pose, traction: Tensor, torque: Tensor, body: BodyLoad | None = None
) -> Tensor:
    """Return the normal force N [batch, axles] [N] of one wheel of each axle.

    ``traction`` [N] and ``torque`` [N m] are those of one wheel.

    Solves the vertical balance, the moment of the whole rover and the moment of each joint. A
    negative load means that the rover would lift that wheel.
    """
    body = body or BodyLoad.of(rover)
    matrix = balance_matrix(rover, pose, body)[..., 1:, :, :]
    known = (matrix[..., 1] * traction.unsqueeze(-2) + matrix[..., 2] * torque.unsqueeze(-2)).sum(
        -1
    )
    joints = pose.joint_angle.shape[-1]
    target = balance_target(body, pose.pitch, torch.zeros_like(pose.pitch), joints)[..., 1:]
    loads: Tensor = torch.linalg.solve(matrix[..., 0], target - known)
    return loads
