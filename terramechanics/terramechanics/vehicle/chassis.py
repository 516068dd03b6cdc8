# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A rover with any number of wheels: where they stand, how they are borne, and what that balances.

Frame of the body (REP-103): x forward, y left, z up, origin on the ground line. On a plane the
body moves along it; on uneven ground a :class:`Stance` says where the wheels are. What bears the
body follows from its passive joints. A joint that is free to turn has no
generalised force, which is one balance more (d'Alembert). Where wheels are left over, their loads
are not determined by balances. Then the rule is the stiffness of chassis and ground together::

    z_i + k N_i = h + x_i a - y_i b + SUM_joints turn_i (x_i - x_pivot) q

for some height h and angles a, b, q: the body is rigid, each wheel's support gives by k N_i, and
the ground by the sinkage z_i. k = 0 is a rigid chassis, whose wheels sink to one plane.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from terramechanics.description.layout import wheel_sides
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import chassis_places

FREE = 3
"""Ways in which a body without joints follows its wheels: heave, pitch and roll."""


@dataclass(frozen=True, slots=True)
class PassiveJoint:
    """A passive joint about an axis across the body, such as that of a bogie or a differential.

    ``turns`` [1] is how much each wheel turns with it: 1 for the wheels of a bogie, 0 for those it
    does not carry; 1 left and -1 right for the rockers on a differential.
    """

    pivot_x: float  # [m]
    pivot_height: float  # [m] above the ground line
    turns: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Chassis:
    """A rover of equal wheels. Raises ConfigError where its wheels cannot bear it."""

    name: str
    mass: float  # [kg] all of it in the body
    yaw_inertia: float  # [kg m^2] about the centre of mass
    gravity: float  # [m/s^2]
    wheel_radius: float  # [m]
    wheel_width: float  # [m]
    wheel_inertia: float  # [kg m^2] of one wheel with its drive, about its axle
    wheel_x: tuple[float, ...]  # [m]
    wheel_y: tuple[float, ...]  # [m]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.5)  # [m] centre of mass, x y z
    joints: tuple[PassiveJoint, ...] = ()
    compliance: float = 0.0  # [m/N] k, of the support of one wheel

    def __post_init__(self) -> None:
        wheels = len(self.wheel_x)
        if len(self.wheel_y) != wheels:
            raise ConfigError(f"wheel_y has {len(self.wheel_y)} values, wheel_x has {wheels}")
        for joint in self.joints:
            if len(joint.turns) != wheels:
                raise ConfigError(f"turns: {len(joint.turns)} values for {wheels} wheels")
        if self.compliance < 0.0:
            raise ConfigError(f"compliance is {self.compliance:g} m/N: it must not be negative")
        modes = self.modes()
        ways = modes.shape[1]
        if wheels < ways or int(torch.linalg.matrix_rank(modes)) < ways:
            raise ConfigError(
                f"{self.name}: {wheels} wheels cannot bear a body with {len(self.joints)} joints:"
                " give it fewer joints, or wheels that are not in one line"
            )

    @classmethod
    def of(cls, rover: Rover, track: float, yaw_inertia: float) -> "Chassis":
        """Make the chassis of a ``rover`` whose outermost wheels are +-``track`` / 2 [m] aside.

        Where it has a joint, each side has a rocker that carries a bogie and the other wheels; a
        differential below the centre of mass bears the body on both, or without one the body is
        the rocker of both. ``yaw_inertia`` [kg m^2] is about the centre of mass.
        Left wheels come first, the outermost before those further in, each of these rows from
        front to rear. Raises ConfigError where an axle has not as many wheels left as right.
        """
        sides = sorted((wheel.axle, wheel.side) for wheel in rover.wheels)
        beside = rover.wheels_per_axle // 2
        both = ("left",) * beside + ("right",) * beside
        if sides != [(axle, side) for axle in range(rover.axles) for side in both]:
            raise ConfigError(
                f"{rover.name}: every axle needs as many wheels left as right, got"
                f" {', '.join(f'{side} of axle {axle}' for axle, side in sides)}"
            )
        y = dict(zip(chassis_places(rover), wheel_sides(rover, track), strict=True))
        side = (1.0,) * (rover.axles * beside) + (-1.0,) * (rover.axles * beside)
        none = (0.0,) * (rover.axles * beside)
        joints = []
        for each in rover.suspension:
            bogie = tuple(float(axle in each.axles) for axle in range(rover.axles)) * beside
            joints += [
                PassiveJoint(each.x, each.height, bogie + none),
                PassiveJoint(each.x, each.height, none + bogie),
            ]
            if rover.differential:  # taken to be as high as the bogies
                joints.append(PassiveJoint(rover.centre_of_mass_x, each.height, side))
        return cls(
            name=rover.name,
            mass=rover.mass,
            yaw_inertia=yaw_inertia,
            gravity=rover.gravity,
            wheel_radius=rover.wheel_radius,
            wheel_width=rover.wheel_width,
            wheel_inertia=rover.wheel_inertia,
            wheel_x=rover.axle_x * (2 * beside),
            wheel_y=tuple(y[place] for place in range(len(y))),
            centre=(rover.centre_of_mass_x, 0.0, rover.centre_of_mass_height),
            joints=tuple(joints),
        )

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return len(self.wheel_x)

    @property
    def weight(self) -> float:
        """Weight m g [N]."""
        return self.mass * self.gravity

    @property
    def reach(self) -> float:
        """Distance of the furthest wheel from the centre of mass [m]."""
        return max(
            math.hypot(x - self.centre[0], y - self.centre[1])
            for x, y in zip(self.wheel_x, self.wheel_y, strict=True)
        )

    def places(self) -> Tensor:
        """Return x and y of the wheels from the centre of mass [wheels, 2] [m]."""
        places = torch.tensor([self.wheel_x, self.wheel_y], dtype=torch.float64).T
        return places - torch.tensor(self.centre[:2], dtype=torch.float64)

    def modes(self) -> Tensor:
        """Return how much each wheel rises with heave, pitch, roll and each joint [wheels, 3 + J].

        Pitch is nose-up, roll left side up.
        """
        x, y = self.places().unbind(-1)
        joints = [
            torch.tensor(joint.turns, dtype=torch.float64) * (x + self.centre[0] - joint.pivot_x)
            for joint in self.joints
        ]
        return torch.stack([torch.ones_like(x), x, y, *joints], -1)

    def closure(self) -> Tensor:
        """Return the rows [wheels - 3 - J, wheels] whose product with z + k N is zero.

        They are orthonormal, and none where balances determine every load.
        """
        modes = self.modes()
        return torch.linalg.svd(modes).U[:, modes.shape[1] :].T

    def level_stance(self) -> "Stance":
        """Return the stance on a plane; its tensors are [wheels, ...] and [J, ...]."""
        x, y = (
            torch.tensor(places, dtype=torch.float64) for places in (self.wheel_x, self.wheel_y)
        )
        zero = torch.zeros_like(x)
        pivots = torch.tensor(
            [(joint.pivot_x, joint.pivot_height) for joint in self.joints], dtype=torch.float64
        )
        return Stance(
            torch.stack([x, y, zero + self.wheel_radius], -1),
            torch.stack([zero, zero, zero + 1.0], -1),
            zero,
            pivots.view(-1, 2),
        )

    def motion_matrix(self, steering: Tensor, stance: "Stance | None" = None) -> Tensor:
        """Return the hubs' velocities along and across their headings per v_x, v_y and yaw rate.

        ``steering`` [..., wheels] [rad] is positive to the left; shape [..., wheels, 2, 3]. v is
        the velocity of the centre of mass; the steering's own rate moves no hub, nor do those of
        pitch, roll and joints but along the ground.
        """
        stance = stance or self.level_stance()
        place = stance.hub[..., :2] - torch.tensor(self.centre[:2], dtype=torch.float64)
        x, y = place.unbind(-1)
        zero, one = torch.zeros_like(x), torch.ones_like(x)
        moved = torch.stack(
            [torch.stack([one, zero, -y], -1), torch.stack([zero, one, x], -1)], -2
        )  # [..., wheels, 2, 3]: the hub's velocity along x and y
        ahead, left, up, _ = stance.axes(steering)
        ways = []
        for way in (ahead, left):
            # The hub rises with the ground below it.
            level = way[..., :2] - way[..., 2:] * up[..., :2] / up[..., 2:]
            ways.append((level.unsqueeze(-1) * moved).sum(-2))
        return torch.stack(ways, -2)

    def balance_matrix(self, steering: Tensor, stance: "Stance | None" = None) -> Tensor:
        """Return the balances per N, T, M, Y of a wheel [..., 6 + J, wheels, 4].

        Rows: force along x and y [N] and moment about z [N m], against inertia; force along z [N],
        moments nose-up and left side up [N m] about the centre of mass, and about the axis of each
        joint. N, T and M act on the axle, Y on the ground below it.
        """
        stance = stance or self.level_stance()
        ahead, left, up, axle = stance.axes(steering)
        zero = torch.zeros_like(ahead)
        force = torch.stack([up, ahead, zero, left], -1)  # [..., wheels, 3, 4] per N, T, M, Y
        below = self.wheel_radius * ahead  # of Y about the axle: -r up x left
        turn = torch.stack([zero, zero, -axle, below], -1)
        hub = stance.hub.unsqueeze(-1)
        x, y, z = (hub - torch.tensor(self.centre, dtype=torch.float64).unsqueeze(-1)).unbind(-2)
        along, beside, above = force.unbind(-2)
        about_x, about_y, about_z = turn.unbind(-2)
        rows = [
            along,
            beside,
            x * beside - y * along + about_z,
            above,
            x * above - z * along - about_y,
            y * above - z * beside + about_x,
        ]
        for index, joint in enumerate(self.joints):
            pivot_x, pivot_z = stance.pivots[..., index, :, None, None].unbind(-3)
            arm, drop = hub[..., 0, :] - pivot_x, hub[..., 2, :] - pivot_z
            turning = arm * above - drop * along - about_y
            rows.append(torch.tensor(joint.turns, dtype=torch.float64).unsqueeze(-1) * turning)
        return torch.stack(rows, -3)


@dataclass(frozen=True, slots=True)
class Stance:
    """How the wheels of a body stand on the ground, in the frame of the body."""

    hub: Tensor  # [..., wheels, 3] [m] of the axles
    normal: Tensor  # [..., wheels, 3] of the ground below each
    gap: Tensor  # [..., wheels] [m] between wheel and undisturbed ground
    pivots: Tensor  # [..., J, 2] [m] x and z of the joints

    def axes(self, steering: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return the axes of the wheels [..., wheels, 3]; ``steering`` [..., wheels] [rad].

        Along the heading and along the ground, to the left of that along the ground, the normal,
        and the axle, which is level in the body.
        """
        sine, cosine = torch.sin(steering), torch.cos(steering)
        axle = torch.stack([-sine, cosine, torch.zeros_like(sine)], -1)
        up = self.normal.expand_as(axle)
        ahead = torch.linalg.cross(axle, up)
        ahead = ahead / ahead.norm(dim=-1, keepdim=True)
        return ahead, torch.linalg.cross(up, ahead), up, axle

    def contact_angle(self, steering: Tensor) -> Tensor:
        """Return the slope of the ground along each heading from the body's plane [rad]."""
        return torch.asin(self.axes(steering)[0][..., 2])

    def rows(self, index: Tensor) -> "Stance":
        """Return the stance of some of the episodes; one of all alike is returned as it is."""
        if self.hub.dim() == 2:
            return self
        return Stance(self.hub[index], self.normal[index], self.gap[index], self.pivots[index])
