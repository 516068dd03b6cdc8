# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The balances of a body per force of each of its wheels, and how each moves over the ground.

Frame of the body as in ``suspension``, with y to the left. A wheel is one of its own, at a place
across, and steered. Joints are those of the planar rover: what carries an axle carries its wheels
left and right.
"""

import torch
from torch import Tensor

from terramechanics.description.layout import wheel_sides
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.suspension import Geometry, axle_places, geometry_of
from terramechanics.vehicle.wheel_places import wheel_order


def geometry_by_wheel(rover: Rover, track_width: float) -> tuple[Geometry, Tensor]:
    """Return the geometry with one entry per wheel, and y [wheels] [m], in ``wheel_order``."""
    order, by_axle = wheel_order(rover), geometry_of(rover)
    axles = [rover.wheels[k].axle for k in order]
    sides = wheel_sides(rover, track_width)
    geometry = Geometry(
        by_axle.axle_x[axles],
        by_axle.centre,
        by_axle.pivot[axles],
        by_axle.carried[:, axles],
        by_axle.radius,
    )
    return geometry, torch.tensor([sides[k] for k in order], dtype=torch.float64)


def wheel_balances(
    geometry: Geometry, side: Tensor, steering: Tensor, angle: Tensor, joints: Tensor
) -> Tensor:
    """Return the balances per N, T, M, Y of each wheel [..., 2, 6 + J, wheels, 4].

    At ``steering`` and contact angles ``angle`` [..., wheels], and angles of the ``joints``
    [..., J] [rad]; ``side`` [wheels] [m] is y. The first of two are the balances, the second their
    change per rad of the contact angles. Rows: force along body x and y [N], yaw moment [N m],
    force along z [N], moments nose-up and left side up [N m], all moments about the centre of mass,
    and the moment of each joint about its pivot.

    N, T and M act on the axle, the lateral force Y on the ground below it, as in
    :meth:`terramechanics.vehicle.chassis.Chassis.balance_matrix`, which this is at contact angles
    of zero.
    """
    sine, cosine = torch.sin(angle), torch.cos(angle)
    left, ahead = torch.sin(steering), torch.cos(steering)
    zero, one = torch.zeros_like(sine), torch.ones_like(sine)
    # along the heading, to its left, up, and about the axle, each per N, T, M, Y
    along = torch.stack([-sine, cosine, zero, zero], -1)
    up = torch.stack([cosine, sine, zero, zero], -1)
    across = torch.stack([zero, zero, zero, one], -1)
    turn = torch.stack([zero, zero, one, zero], -1)
    both_along, both_up = torch.stack([along, -up]), torch.stack([up, along])
    kept = torch.stack([one, zero]).unsqueeze(-1)  # does not change with the contact angle

    ahead, left = ahead.unsqueeze(-1), left.unsqueeze(-1)
    force_x = both_along * ahead - kept * (across * left)
    force_y = both_along * left + kept * (across * ahead)
    nose_up, side_up = kept * (turn * ahead), kept * (turn * left)

    body = _balances(geometry, side, joints, force_x, force_y, both_up, nose_up, side_up)
    return body.movedim(0, -4)


def bank_balances(geometry: Geometry, side: Tensor, steering: Tensor, joints: Tensor) -> Tensor:
    """Return the change of the balances per rad of bank [..., 6 + J, wheels, 4].

    The bank of the ground below a wheel is its slope to the left of the heading, from the body's
    plane. It turns N to the right and lifts Y; here it and the contact angle are near zero.
    Arguments and rows as of :func:`wheel_balances`.
    """
    zero, one = torch.zeros_like(steering), torch.ones_like(steering)
    normal = torch.stack([one, zero, zero, zero], -1)
    up = torch.stack([zero, zero, zero, one], -1)
    right = torch.sin(steering).unsqueeze(-1), -torch.cos(steering).unsqueeze(-1)
    none = torch.zeros_like(normal)
    return _balances(geometry, side, joints, normal * right[0], normal * right[1], up, none, none)


def _balances(
    geometry: Geometry,
    side: Tensor,
    joints: Tensor,
    force_x: Tensor,
    force_y: Tensor,
    up: Tensor,
    nose_up: Tensor,
    side_up: Tensor,
) -> Tensor:
    """Return the balances of forces and moments per N, T, M, Y, each [..., wheels, 4]."""
    place_x, place_z = axle_places(geometry, joints).unsqueeze(-1).unbind(-2)
    # Y acts on the ground below the axle
    height = torch.cat([place_z, place_z, place_z, place_z - geometry.radius], -1)
    centre_x, centre_z = geometry.centre.unbind(-1)
    arm, y = place_x - centre_x, side.unsqueeze(-1)
    yaw = arm * force_y - y * force_x
    pitch = arm * up - (height - centre_z) * force_x + nose_up
    roll = y * up - (height - centre_z) * force_y + side_up
    pivot_x, pivot_z = geometry.pivot.unsqueeze(-1).unbind(-2)
    about = (place_x - pivot_x) * up - (height - pivot_z) * force_x + nose_up
    carried = geometry.carried.unsqueeze(-1)
    of_joints = torch.where(carried > 0.0, about.unsqueeze(-3), 0.0)
    body = torch.stack([force_x, force_y, yaw, up, pitch, roll], -3)
    return torch.cat([body, of_joints], -3)


def motion_across(
    slip: Tensor, rim: Tensor, steering: Tensor, left: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return rim, along and across [..., wheels] of wheels, in units of the rims' speeds.

    ``rim`` [..., wheels] [m/s] is r w, ``left`` [..., wheels] [m/s] the velocity of the hubs along
    the body's y, which is exact where ``slip`` [..., wheels] is: along the heading the hub moves
    with (1 - slip) r w.
    """
    sign = torch.sign(rim)
    along = (1.0 - slip) * sign
    across = (left / rim.abs() - along * torch.sin(steering)) / torch.cos(steering)
    return sign.expand_as(along), along, across
