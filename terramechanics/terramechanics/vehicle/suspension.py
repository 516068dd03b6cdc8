# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Planar rocker-bogie: kinematics on a terrain profile, and the balances of its two bodies.

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
    bogie_angle: Tensor  # [batch] of the bogie relative to the body, nose-up
    contact: Tensor  # [batch, axles] horizontal place at which the wheel touches the ground
    contact_angle: Tensor  # [batch, axles] slope of the ground there relative to the body
    axle: Tensor  # [batch, axles, 2] x and z of the axles in the body frame


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
        None  # [batch, 4] what outer forces add to the balances of :func:`balance_matrix`
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

        It acts at ``x``, ``height`` [m]; add the payload first.
        """
        moment = (x - self.x) * up - (height - self.height) * along
        force = torch.stack([along, up, moment, torch.zeros_like(along)], dim=-1)
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
    pivot: Tensor  # [2] of the bogie [m]
    radius: float  # [m] of the wheels


def geometry_of(rover: Rover) -> Geometry:
    """Return the geometry of ``rover``."""
    centre = torch.tensor(
        (rover.centre_of_mass_x, rover.centre_of_mass_height), dtype=torch.float64
    )
    pivot = torch.tensor((rover.bogie_pivot_x, rover.bogie_pivot_height), dtype=torch.float64)
    return Geometry(
        torch.tensor(rover.axle_x, dtype=torch.float64), centre, pivot, rover.wheel_radius
    )


def axle_places(geometry: Geometry, bogie: Tensor) -> Tensor:
    """Return x and z of the axles in the body frame, [..., axles, 2] [m].

    ``bogie`` [...] [rad] is the angle of the bogie, nose-up.
    """
    sine, cosine = torch.sin(bogie).unsqueeze(-1), torch.cos(bogie).unsqueeze(-1)
    arm, drop = geometry.axle_x[1:] - geometry.pivot[0], geometry.radius - geometry.pivot[1]
    along = geometry.pivot[0] + arm * cosine - drop * sine
    up = geometry.pivot[1] + arm * sine + drop * cosine
    front = torch.zeros_like(sine)
    return torch.stack(
        [
            torch.cat([front + geometry.axle_x[0], along], -1),
            torch.cat([front + geometry.radius, up], -1),
        ],
        -1,
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
    """Return the force and moment balances per N, T, M of a wheel: [..., 4, axles, 3].

    Rows: force along body x [N], force along body z [N], moment of the whole rover about its centre
    of mass [N m], moment of the bogie about its pivot [N m]. The bogie has no mass, so its row sums
    to zero; the ground acts on an axle with N, T and, by way of the motor's mount, with the moment
    M of the shear stresses. ``axle`` from :func:`axle_places`, ``action`` from :func:`directions`.
    """
    along, up, turn = action.unbind(-2)
    ahead, above = (axle - geometry.centre).unsqueeze(-1).unbind(-2)
    whole = ahead * up - above * along + turn
    ahead, above = (axle - geometry.pivot).unsqueeze(-1).unbind(-2)
    bogie = ahead * up - above * along + turn
    carried = torch.cat([torch.zeros_like(bogie[..., :1, :]), bogie[..., 1:, :]], dim=-2)
    return torch.stack([along, up, whole, carried], dim=-3)


def level_pose(rover: Rover, x: Tensor) -> Pose:
    """Return the pose on level ground at height 0, body origin at ``x`` [batch] [m].

    It is a start for :func:`solve_pose`.
    """
    zero = torch.zeros_like(x)
    axle_x = torch.tensor(rover.axle_x, dtype=x.dtype)
    axle = torch.stack([axle_x, torch.full_like(axle_x, rover.wheel_radius)], dim=-1).expand(
        *x.shape, -1, -1
    )
    contact = x.unsqueeze(-1) + axle_x
    return Pose(x, zero, zero, zero, contact, torch.zeros_like(contact), axle)


def solve_pose(rover: Rover, profile: Profile, x: Tensor, start: Pose) -> Pose:
    """Solve the pose in which all wheels touch the profile, body origin at ``x`` [batch] [m].

    Newton in height, pitch, bogie angle and the places of contact, from ``start``. A wheel of
    radius r that touches the ground at s has its axle at (s - r sin a, h(s) + r cos a), a = atan
    h'(s). Raises TerrainError where the profile is curved more sharply than the wheel.
    """
    geometry = geometry_of(rover)
    contact, height, pitch, bogie = (
        start.contact + (x - start.x).unsqueeze(-1),
        start.height,
        start.pitch,
        start.bogie_angle,
    )
    for _ in range(MAX_ITERATIONS):
        axle = axle_places(geometry, bogie)
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
        height, pitch, bogie = _corrected(
            rover, (x_axle, z_axle), (x, height, pitch, bogie), slope, gap
        )
        if float(torch.maximum(gap.abs().max(), miss.abs().max())) < TOLERANCE:
            break
    # One more move of the contacts would change them by less than the tolerance; the angles follow
    # from the last slope.
    angle = torch.atan(profile.shape(contact)[1])
    return Pose(
        x, height, pitch, bogie, contact, angle - pitch.unsqueeze(-1), axle_places(geometry, bogie)
    )


def _to_world(point: Tensor, x: Tensor, height: Tensor, pitch: Tensor) -> tuple[Tensor, Tensor]:
    sine, cosine = torch.sin(pitch).unsqueeze(-1), torch.cos(pitch).unsqueeze(-1)
    along, up = point[..., 0], point[..., 1]
    return (
        x.unsqueeze(-1) + along * cosine - up * sine,
        height.unsqueeze(-1) + along * sine + up * cosine,
    )


def _corrected(
    rover: Rover,
    axle: tuple[Tensor, Tensor],
    state: tuple[Tensor, Tensor, Tensor, Tensor],
    slope: Tensor,
    gap: Tensor,
) -> tuple[Tensor, Tensor, Tensor]:
    """Return one Newton step of height, pitch and bogie angle that closes every ``gap``.

    ``axle`` holds x and z; shapes are [batch, 3] [m].
    """
    (x_axle, z_axle), (x, height, pitch, bogie) = axle, state
    pivot = torch.tensor([[rover.bogie_pivot_x, rover.bogie_pivot_height]], dtype=x.dtype)
    x_pivot, z_pivot = _to_world(pivot.expand(*x.shape, 1, 2), x, height, pitch)
    by_pitch = (x_axle - x.unsqueeze(-1)) + slope * (z_axle - height.unsqueeze(-1))
    by_bogie = ((x_axle - x_pivot) + slope * (z_axle - z_pivot))[..., 1:]
    # The body's height enters every gap alike: subtract the front wheel's row.
    a = by_pitch[..., 1:] - by_pitch[..., :1]
    g = gap[..., 1:] - gap[..., :1]
    determinant = a[..., 0] * by_bogie[..., 1] - a[..., 1] * by_bogie[..., 0]
    turn = (g[..., 1] * by_bogie[..., 0] - g[..., 0] * by_bogie[..., 1]) / determinant
    bend = (a[..., 1] * g[..., 0] - a[..., 0] * g[..., 1]) / determinant
    lift = -gap[..., 0] - by_pitch[..., 0] * turn
    return height + lift, pitch + turn, bogie + bend


def balance_matrix(rover: Rover, pose: Pose, body: BodyLoad | None = None) -> Tensor:
    """Return the balances per N, T, M of the wheels: shape [batch, 4, axles, 3].

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


def balance_target(body: BodyLoad, pitch: Tensor, acceleration: Tensor) -> Tensor:
    """Return the sums of the balances of :func:`balance_matrix`, [batch, 4].

    They are m (dv/dt + g sin ab), m g cos ab, 0, 0, less outer forces.
    """
    zero = torch.zeros_like(pitch)
    along = body.mass * acceleration + body.weight * torch.sin(pitch)
    target = torch.stack([along, body.weight * torch.cos(pitch), zero, zero], dim=-1)
    return target if body.outer is None else target - body.outer


def wheel_loads(
    rover: Rover, pose: Pose, traction: Tensor, torque: Tensor, body: BodyLoad | None = None
) -> Tensor:
    """Return the normal force N [batch, axles] [N] of one wheel of each axle.

    ``traction`` [N] and ``torque`` [N m] are those of one wheel.

    Solves the vertical balance, the moment of the whole rover and the moment of the bogie. A
    negative load means that the rover would lift that wheel.
    """
    body = body or BodyLoad.of(rover)
    matrix = balance_matrix(rover, pose, body)[..., 1:, :, :]
    known = (matrix[..., 1] * traction.unsqueeze(-2) + matrix[..., 2] * torque.unsqueeze(-2)).sum(
        -1
    )
    target = balance_target(body, pose.pitch, torch.zeros_like(pose.pitch))[..., 1:]
    loads: Tensor = torch.linalg.solve(matrix[..., 0], target - known)
    return loads
