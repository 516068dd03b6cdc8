# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one observation, affine in (c [kPa], tan phi), and their noise.

Rows (A axles, p wheels per axle, m mass, g gravity, al = contact angle relative to the body, ab =
pitch)::

    0       dv/dt + g sin ab = SUM_k p (T_k cos al_k - N_k sin al_k) / m      [m/s^2]
    1       cos ab           = SUM_k p (N_k cos al_k + T_k sin al_k) / (m g)  [1]
    2..A+1  torque_k         = M_k                                            [N m]
    A+2     acceleration     = SUM_k p (T_k cos al_k - N_k sin al_k) / m      [m/s^2]
    A+3     0                = moment of the rover about its centre of mass / (m g b)  [1]
    A+4..   0                = moment of a joint about its pivot / (m g b), J rows     [1]

They are the longitudinal balance, the balance normal to the body, the drive torque of one wheel,
the specific force of the imu, and the moments of rover and joints; b is the wheelbase. A rover
without a joint ends at A+3.

(Banerjee et al. eqs. 1, 15 and 17 with gravity along the slope; Iagnemma et al. 2004 for the
torque; the moments are those of terramechanics.vehicle.suspension.) The load and moment rows need
no force sensor: together they give the load of each axle. Each measured slip, sinkage and angle
enters several rows, so its error is carried along as one unit-variance source per value and turned
into the full covariance of the rows, not into a variance of each. The bogie's encoder counts as
exact.

The rows are linear in those errors only near the true inputs: a sinkage of 1.3 mm measured to 0.3
mm is far from them, and forces that are convex in it come out 1.5 % too large. So they are expanded
not where the inputs were measured but where all rows of the instant agree best (``agreement``), as
orthogonal distance regression does in every iteration. That place is still in doubt, with
covariance P in deviations. With h the row, x the true input, d the error of the place and e that of
the measurement, what is used is h(x + d) + h'(x + d) (e - d) = h(x) + h'(x) e + h'' (d e - d^2 /
2), and as d is the part of e that the rows do not tell, E[d e] = E[d^2] = P: the mean is h'' P / 2
too large, which is taken off. It is small beside the noise of one row and has the same sign in all,
so it would come to outweigh the noise of a long drive.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

from terrain_estimator.model.packing import PackedView, view_of, with_stand_in
from terrain_estimator.model.stencil import OWN, Stencil
from terramechanics.contact.stresses import in_range, wheel_forces
from terramechanics.vehicle.suspension import (
    Geometry,
    along_body,
    axle_places,
    balances,
    directions,
)

PA_PER_UNIT = 1000.0
"""c is carried in kPa, so that both parameters are of order one."""

MOMENT_VARIANCE = 1e-6
"""[1] Variance of a moment row of one observation, (0.1 % of m g b)^2.

It covers the friction of the joints and a rolling wheel's own inertia.
"""


class Rows(NamedTuple):
    """The rows of n observations: R = A + 4 + J rows for J joints, E = 3 A + 1 sources of noise.

    Each source is of unit variance. The leading C = 1 + M: first the values, then their change for
    one prior deviation of each uncertain soil constant.
    """

    features: Tensor  # [C, n, R, 3] columns c [kPa], tan phi, 1
    # change of a row for one standard deviation of a source, affine in (c, tan phi)
    noise: Tensor  # [C, n, R, E, 3]
    target: Tensor  # [n, R] what the row has to equal; row 0: g sin ab, to be subtracted from dv/dt
    variance: Tensor  # [n, R] of the target itself
    used: Tensor  # [n, R] 1 where the row holds, else 0
    # [n, R, K] multiples of the K balances that were taken off, see unmeasured; K = 0: of none
    taken: Tensor


def balances_of(rows: Tensor, dim: int, axles: int) -> Tensor:
    """Return the balances among R rows along ``dim``: load, moment, and that of each joint."""
    first = axles + 3
    return torch.cat(
        [rows.narrow(dim, 1, 1), rows.narrow(dim, first, rows.shape[dim] - first)], dim
    )


class ContactModel(NamedTuple):
    """The numbers of rover and soil that the rows need."""

    constants: Tensor  # [6] or [n, 1, 6] of the soil, in the order of stresses.CONSTANTS
    # nothing, then a thousandth of the prior deviation of each of M uncertain constants
    varied: Tensor  # [C, 6]
    stencil: Stencil
    nodes: Tensor  # of terramechanics.contact.stresses.quadrature
    column_unit: Tensor  # [3] Pa per kPa, 1, 1
    geometry: Geometry
    # [3 + J] or [n, 3 + J] p / m [1/kg], p / (m g) [1/N], then p / (m g b) [1/(N m)]
    body_scale: Tensor
    moment_variance: float  # [1] of the moment rows themselves
    stand_in: Tensor  # [8, 1] harmless values of the packed groups, for a wheel that is not usable
    gravity: float  # [m/s^2]
    radius: float  # [m]
    width: float  # [m]


def usable_wheels(packed: Tensor, contact: ContactModel) -> Tensor:
    """Return which wheels [n, W] of observations [n, P] are measured and in the model's range."""
    view = view_of(packed, contact.geometry.axle_x.shape[0])
    return are_usable(view.slip, view.sinkage, view.contact_angle, contact)


def are_usable(slip: Tensor, sinkage: Tensor, angle: Tensor, contact: ContactModel) -> Tensor:
    """Return which wheels with these slips, sinkages and contact angles [n, W] are usable."""
    return in_range(slip, sinkage, contact.constants, contact.radius) & (angle.abs() < float("inf"))


def drive_row(slip: Tensor, sinkage: Tensor, angle: Tensor, contact: ContactModel) -> Tensor:
    """Return row 0 of one observation whose wheels [W] are all usable, without noise: [1 + M, 3].

    First the features, then their change for one prior deviation of each uncertain constant.
    """
    constants = (contact.constants + contact.varied).unsqueeze(1)
    forces = wheel_forces(slip, sinkage, constants, contact.radius, contact.width, contact.nodes)
    row = (along_body(angle).unsqueeze(-1) * forces).sum([1, 2]) * (
        contact.column_unit * contact.body_scale[0]
    )
    values = row[:1]
    return torch.cat([values, 1e3 * (row[1:] - values)])


class Variation(NamedTuple):
    """Inputs at which the forces of n x A wheels are evaluated, K as in Stencil."""

    slip: Tensor  # [K, n, A]
    sinkage: Tensor  # [K, n, A] [m]
    constants: Tensor  # [K, n or 1, A or 1, 6]
    scale: Tensor  # [n, A] deviation of the sinkage over the one by which it is varied


def varied_inputs(place: PackedView, contact: ContactModel) -> Variation:
    """Return slip and sinkage with and without a deviation, for every set of constants.

    ``place`` holds n observations. A sinkage smaller than its deviation is varied by less.
    """
    shallow = torch.minimum(place.sinkage_sd, 0.9 * place.sinkage)
    faster, deeper = contact.stencil.moves.view(-1, 2, 1, 1).unbind(1)
    constants = contact.constants + contact.varied.index_select(0, contact.stencil.constants).view(
        -1, 1, 1, 6
    )
    return Variation(
        torch.addcmul(place.slip, faster, place.slip_sd),
        torch.addcmul(place.sinkage, deeper, shallow),
        constants,
        place.sinkage_sd / shallow,
    )


class Forces(NamedTuple):
    """Forces of n x A wheels as ``wheel_forces`` has them, but by c in kPa. C as in Rows."""

    values: Tensor  # [C, n, A, 3, 3]
    by_slip: Tensor  # [C, n, A, 3, 3] change for one standard deviation
    by_sinkage: Tensor  # [C, n, A, 3, 3] change for one standard deviation


def changes(forces: Tensor, scale: Tensor, contact: ContactModel) -> Forces:
    """Return forces and their changes from those [K, n, A, 3, 3] at the inputs of a Variation.

    ``scale`` is the variation's.
    """
    weights = contact.stencil.weights
    read = (weights.flatten(0, 1) @ (forces * contact.column_unit).flatten(1)).view(
        weights.shape[:2] + forces.shape[1:]
    )
    values, by_slip, by_sinkage = read.unbind(0)
    return Forces(values, by_slip, by_sinkage * scale.unsqueeze(-1).unsqueeze(-1))


def values_alone(contact: ContactModel, own: int = OWN) -> ContactModel:
    """Return the contact model without the changes for uncertain constants.

    TorchScript has no ``_replace``.
    """
    stencil = contact.stencil
    first = Stencil(
        stencil.moves[:own],
        stencil.constants[:own],
        stencil.weights[:, :1, :own],
        stencil.curvature[:, :own],
    )
    return ContactModel(
        contact.constants, contact.varied[:1], first, contact.nodes, contact.column_unit,
        contact.geometry, contact.body_scale, contact.moment_variance, contact.stand_in,
        contact.gravity, contact.radius, contact.width,
    )  # fmt: skip


def with_body(contact: ContactModel, geometry: Geometry, body_scale: Tensor) -> ContactModel:
    """Return the contact model with another body."""
    return ContactModel(
        contact.constants, contact.varied, contact.stencil, contact.nodes, contact.column_unit,
        geometry, body_scale, contact.moment_variance, contact.stand_in, contact.gravity,
        contact.radius, contact.width,
    )  # fmt: skip


def without_excess(
    forces: Forces, evaluated: Tensor, scale: Tensor, doubt: Tensor, contact: ContactModel
) -> Forces:
    """Return the forces without their mean excess where slip and sinkage are in ``doubt``.

    ``doubt`` [n, 3, A] is as in Agreement. ``evaluated`` [K, n, A, 3, 3] are the forces at the
    inputs of a Variation with its ``scale``.
    """
    weights = contact.stencil.curvature
    halves = (weights @ (evaluated * contact.column_unit).flatten(1)).view(
        weights.shape[:1] + evaluated.shape[1:]
    )
    share = doubt * torch.stack([torch.ones_like(scale), scale * scale, scale], 1)
    excess = (halves * share.transpose(0, 1).unsqueeze(-1).unsqueeze(-1)).sum(0, keepdim=True)
    values = torch.cat(
        [
            forces.values.narrow(0, 0, 1) - excess,
            forces.values.narrow(0, 1, forces.values.shape[0] - 1),
        ]
    )
    return Forces(values, forces.by_slip, forces.by_sinkage)


def read_forces(
    evaluated: Tensor, scale: Tensor, contact: ContactModel, doubt: Tensor | None = None
) -> Forces:
    """Return what :func:`changes` returns, without the excess where inputs are in ``doubt``."""
    forces = changes(evaluated, scale, contact)
    return forces if doubt is None else without_excess(forces, evaluated, scale, doubt, contact)


class Frame(NamedTuple):
    """The parts of n observations' rows that do not depend on the forces, R as in Rows."""

    measured: PackedView  # of n observations, harmless where a wheel is not usable
    usable: Tensor  # [n, A] bool
    # effect of N, T, M of a wheel in a row, and its change for one deviation of the contact angle
    levers: Tensor  # [n, A, 2, R, 3]
    tilt: Tensor  # [n, R] change of a row for one standard deviation of the pitch
    target: Tensor  # as in Rows
    variance: Tensor
    used: Tensor


def frame_of(packed: Tensor, contact: ContactModel) -> Frame:
    """Return the frame of observations [n, P].

    Where a wheel is not usable, no row that needs it holds.
    """
    axles = contact.geometry.axle_x.shape[0]
    usable = usable_wheels(packed, contact)
    view = view_of(with_stand_in(packed, usable, contact.stand_in), axles)
    known, every = torch.isfinite(view.bogie_angle), usable.all(1, keepdim=True)
    joints = contact.geometry.carried.shape[0]
    placed = (every & known.unsqueeze(1)).expand(-1, 1 + joints)
    angle = torch.where(known, view.bogie_angle, 0.0).unsqueeze(1).narrow(1, 0, joints)

    sine, cosine = torch.sin(view.pitch), torch.cos(view.pitch)
    balance = torch.stack([contact.gravity * sine, cosine], 1)
    tilt = torch.stack([-contact.gravity * cosine, sine], 1) * view.pitch_sd.unsqueeze(1)
    sensed = torch.cat([view.torque, view.acceleration.unsqueeze(1)], 1)
    sensed_sd = torch.cat([view.torque_sd, view.acceleration_sd.unsqueeze(1)], 1)
    holds = torch.isfinite(sensed) & torch.isfinite(sensed_sd) & torch.cat([usable, every], 1)
    sensed, own = torch.where(holds, sensed, 0.0), torch.where(holds, sensed_sd**2, 0.0)
    return Frame(
        measured=view,
        usable=usable,
        levers=lever_arms(view.contact_angle, view.contact_angle_sd, angle, contact),
        tilt=nn.functional.pad(tilt, [0, axles + 2 + joints]),
        target=nn.functional.pad(torch.cat([balance, sensed], 1), [0, 1 + joints]),
        variance=nn.functional.pad(
            nn.functional.pad(own, [2, 0]), [0, 1 + joints], value=contact.moment_variance
        ),
        used=torch.cat([every, every, holds, placed], 1).to(packed.dtype),
    )


def lever_arms(angle: Tensor, angle_sd: Tensor, joints: Tensor, contact: ContactModel) -> Tensor:
    """Return the effect of N, T, M of each wheel in each row [n, A, 2, R, 3].

    It is at contact angles [n, A] and angles of the ``joints`` [n, J] [rad]; then follows its
    change for one deviation of the contact angles.
    """
    axles = angle.shape[1]
    action = directions(angle)
    along, up, turn = action.unbind(-2)
    turned = torch.stack([-up, along, torch.zeros_like(turn)], -2) * angle_sd.unsqueeze(
        -1
    ).unsqueeze(-1)
    body = balances(
        contact.geometry, axle_places(contact.geometry, joints), torch.stack([action, turned])
    )
    velocity, load, moments = (
        body * contact.body_scale.unsqueeze(-1).unsqueeze(-1)
    ).split_with_sizes([1, 1, 1 + joints.shape[1]], 2)
    torque = nn.functional.pad(torch.eye(axles, dtype=angle.dtype).unsqueeze(-1), [2, 0])
    torques = (
        torch.stack([torque, torch.zeros_like(torque)])
        .unsqueeze(1)
        .expand(-1, angle.shape[0], -1, -1, -1)
    )
    return torch.cat([velocity, load, torques, velocity, moments], 2).permute(1, 3, 0, 2, 4)


def places(likely: Tensor, frame: Frame, contact: ContactModel) -> PackedView:
    """Return the view of observations ``likely`` [n, P], harmless where a wheel is not usable."""
    return view_of(with_stand_in(likely, frame.usable, contact.stand_in), frame.usable.shape[1])


def measured_forces(frame: Frame, place: PackedView, forces: Forces) -> Forces:
    """Return ``forces`` at ``place`` with the values moved, to first order, to measured inputs."""
    measured = frame.measured
    faster = (measured.slip - place.slip) / measured.slip_sd
    deeper = (measured.sinkage - place.sinkage) / measured.sinkage_sd
    values = torch.addcmul(forces.values, faster.unsqueeze(-1).unsqueeze(-1), forces.by_slip)
    return Forces(
        torch.addcmul(values, deeper.unsqueeze(-1).unsqueeze(-1), forces.by_sinkage),
        forces.by_slip,
        forces.by_sinkage,
    )


def regression_rows(packed: Tensor, likely: Tensor, contact: ContactModel) -> Rows:
    """Return the rows of observations [n, P], expanded around the inputs of ``likely`` [n, P]."""
    return rows_at(frame_of(packed, contact), likely, contact)


def rows_at(
    frame: Frame, likely: Tensor, contact: ContactModel, doubt: Tensor | None = None
) -> Rows:
    """Return the rows in a frame, expanded at ``likely`` [n, P], less the excess of ``doubt``."""
    place = places(likely, frame, contact)
    where = varied_inputs(place, contact)
    evaluated = wheel_forces(
        where.slip, where.sinkage, where.constants, contact.radius, contact.width, contact.nodes
    )
    return rows_of_forces(
        frame, measured_forces(frame, place, read_forces(evaluated, where.scale, contact, doubt))
    )


def features_of(frame: Frame, values: Tensor) -> Tensor:
    """Return features [..., n, R, F] of forces [..., n, A, 3, F]."""
    return (frame.levers[:, :, 0] @ values).sum(-3)


def rows_of_forces(frame: Frame, forces: Forces) -> Rows:
    """Return rows of n observations, given the forces of :func:`measured_forces`."""
    n, axles, _, rows, _ = frame.levers.shape
    by_source = torch.stack([forces.by_slip, forces.by_sinkage, forces.values]).permute(
        2, 3, 4, 0, 1, 5
    )  # [n, A, 3, 3, C, 3]
    moved = (frame.levers.flatten(2, 3) @ by_source.flatten(3)).view(n, axles, 2, rows, 3, -1, 3)
    acting, turned = moved.unbind(2)
    features = acting.select(3, 2).sum(1).permute(2, 0, 1, 3)
    noise = (
        torch.cat([acting.narrow(3, 0, 2), turned.narrow(3, 2, 1)], 3)
        .permute(4, 0, 2, 3, 1, 5)
        .flatten(3, 4)
    )
    tilt = frame.tilt.view(1, n, rows, 1, 1)
    tilt = nn.functional.pad(tilt, [2, 0, 0, 0, 0, 0, 0, 0, 0, noise.shape[0] - 1])
    none = torch.zeros(n, rows, 0, dtype=features.dtype)
    noise = torch.cat([noise, tilt], 3)
    return Rows(features, noise, frame.target, frame.variance, frame.used, none)
