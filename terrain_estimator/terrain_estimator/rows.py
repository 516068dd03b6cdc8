# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The regression rows of one observation, affine in (c [kPa], tan phi), and their noise.

Rows (A axles, p wheels per axle, m mass, g gravity, al = contact angle relative to the body, ab = pitch)::

    0        dv/dt + g sin ab = SUM_k p (T_k cos al_k - N_k sin al_k) / m       [m/s^2]   longitudinal balance
    1        cos ab           = SUM_k p (N_k cos al_k + T_k sin al_k) / (m g)   [1]       balance normal to the body
    2..A+1   torque_k         = M_k                                             [N m]     drive torque of one wheel
    A+2      acceleration     = SUM_k p (T_k cos al_k - N_k sin al_k) / m       [m/s^2]   specific force of the imu
    A+3      0                = moment of the rover about its centre of mass / (m g b)     [1]
    A+4      0                = moment of the bogie about its pivot / (m g b)              [1]       b wheelbase

(Banerjee et al. eqs. 1, 15 and 17 with gravity along the slope; Iagnemma et al. 2004 for the torque; the moments are those
of terramechanics.suspension.) The load and moment rows need no force sensor: together they say what each axle carries.
Each measured slip, sinkage and angle enters several rows, so its error is carried along as one unit-variance source per
value and turned into the full covariance of the rows, not into a variance of each. The bogie's encoder is taken for exact.

The rows are linear in those errors only near the true inputs: a sinkage of 1.3 mm measured to 0.3 mm is far from them, and
forces that are convex in it come out 1.5 % too large. So they are expanded not where the inputs were measured but where
all rows of the instant agree best (``likely_inputs``), as orthogonal distance regression does in every iteration.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terrain_estimator.gaussian import cholesky
from terramechanics.contact import in_range, wheel_forces
from terramechanics.suspension import Geometry, axle_places, balances, directions

PA_PER_UNIT = 1000.0
"""c is carried in kPa, so that both parameters are of order one."""

MOMENT_VARIANCE = 1e-6
"""[1] Of a moment row of one observation: what the joints' friction and a rolling wheel's own inertia may amount to, 0.1 % of m g b."""


class Rows(NamedTuple):
    """The rows of n observations: R = A + 5 rows, E = 3 A + 1 sources of noise, each of unit variance.

    The leading C = 1 + M: first the values, then their change for one prior deviation of each uncertain soil constant.
    """

    features: Tensor  # [C, n, R, 3] columns c [kPa], tan phi, 1
    noise: Tensor  # [C, n, R, E, 3] change of a row for one standard deviation of a source, affine in (c, tan phi)
    target: Tensor  # [n, R] what the row has to equal; row 0: g sin ab, to be subtracted from dv/dt
    variance: Tensor  # [n, R] of the target itself
    used: Tensor  # [n, R] 1 where the row holds, else 0


def row_names(axles: int) -> tuple[str, ...]:
    """Names of the rows, in their order."""
    return ("velocity", "load", *(f"torque_{k}" for k in range(axles)), "acceleration", "moment", "bogie_moment")


class Contact(NamedTuple):
    """What the rows need to know of rover and soil."""

    constants: Tensor  # [6] of the soil, in the order of terramechanics.contact.CONSTANTS; or [n, 1, 6]
    varied: Tensor  # [C, 6] nothing, then a thousandth of the prior deviation of each of M uncertain constants
    nodes: Tensor  # of terramechanics.contact.quadrature
    column_unit: Tensor  # [3] Pa per kPa, 1, 1
    geometry: Geometry
    body_scale: Tensor  # [4] p / m [1/kg], p / (m g) [1/N], and twice p / (m g b) [1/(N m)]; or [n, 4]
    moment_variance: float  # [1] of the moment rows themselves
    stand_in: Tensor  # [8, 1] harmless values of the packed groups, for a wheel that is not usable
    gravity: float  # [m/s^2]
    radius: float  # [m]
    width: float  # [m]


def usable_wheels(wheels: Tensor, contact: Contact) -> Tensor:
    """Wheels [n, A] of packed groups [n, 8, A] that are measured and inside the model's range."""
    return in_range(wheels[:, 0], wheels[:, 2], contact.constants, contact.radius) & torch.isfinite(wheels[:, 4])


def drive_row(wheels: Tensor, contact: Contact) -> Tensor:
    """Row 0 of one packed group [8, A] whose wheels are all usable, without noise: [1 + M, 3].

    First the features, then their change for one prior deviation of each uncertain constant.
    """
    constants = (contact.constants + contact.varied).unsqueeze(1)
    forces = wheel_forces(wheels[0], wheels[2], constants, contact.radius, contact.width, contact.nodes) * contact.column_unit
    along = directions(wheels[4])[:, 0].unsqueeze(-1)
    row = (along * forces).sum([1, 2]) * contact.body_scale[0]
    return torch.cat([row[:1], 1e3 * (row[1:] - row[0])])


class Variation(NamedTuple):
    """Inputs at which the forces of n x A wheels are evaluated, and what is needed to read changes from them: K = 2 + 3 C."""

    slip: Tensor  # [K, n, A]
    sinkage: Tensor  # [K, n, A] [m]
    constants: Tensor  # [K, n or 1, A or 1, 6]
    scale: Tensor  # [n, A] deviation of the sinkage over the one by which it is varied


def varied_inputs(wheels: Tensor, contact: Contact) -> Variation:
    """Slip and sinkage with and without a deviation of each, for every set of soil constants.

    ``wheels`` [n, 4 or more, A] are slip, sinkage and their deviations in the order of the packed groups. With the
    constants as given both sides are taken; for the changes by the constants one side is enough.
    """
    slip, slip_sd, sinkage, sinkage_sd = wheels[:, 0], wheels[:, 1], wheels[:, 2], wheels[:, 3]
    shallow = torch.minimum(sinkage_sd, 0.9 * sinkage)
    zero = torch.zeros_like(slip)
    slips = [torch.stack([zero, -slip_sd])] + [torch.stack([zero, slip_sd, zero])] * contact.varied.shape[0]
    sinkages = [torch.stack([-shallow, zero])] + [torch.stack([zero, zero, shallow])] * contact.varied.shape[0]
    constants = contact.constants + contact.varied.unsqueeze(1).unsqueeze(1)
    every = torch.cat([constants[:1], constants[:1], constants.repeat_interleave(3, 0)])
    return Variation(slip + torch.cat(slips), sinkage + torch.cat(sinkages), every, sinkage_sd / shallow)


def changes(forces: Tensor, scale: Tensor, contact: Contact) -> Tensor:
    """Forces and their change for one standard deviation of slip and of sinkage: [3, C, n, A, 3, 3], as ``wheel_forces``.

    ``forces`` [K, n, A, 3, 3] are those at the inputs of a Variation with its ``scale``. The change is a central difference
    over plus and minus one deviation, so that a curved law is averaged over the spread of its input; a sinkage smaller
    than its deviation is varied by less. C as in Rows.
    """
    shallower, braked = forces[0], forces[1]
    values, faster, deeper = forces[2::3], forces[3::3], forces[4::3]
    scale = scale.unsqueeze(-1).unsqueeze(-1)
    one_sided = torch.stack([values, faster - values, (deeper - values) * scale])
    by_constant = 1e3 * (one_sided[:, 1:] - one_sided[:, :1])
    central = torch.stack([values[0], 0.5 * (faster[0] - braked), 0.5 * (deeper[0] - shallower) * scale])
    return torch.cat([central.unsqueeze(1), by_constant], 1) * contact.column_unit


def body_parts(forces: Tensor, wheels: Tensor, bogie_angle: Tensor, contact: Contact) -> tuple[Tensor, Tensor]:
    """What each wheel contributes to the four balances of the body, [..., n, 4, A, 3] for forces [..., n, A, 3, 3].

    And its change for one standard deviation of the contact angle, of the first of the ``forces`` alone [C, n, A, 3, 3].
    """
    axle, action = axle_places(contact.geometry, bogie_angle), directions(wheels[:, 4])
    along, up, turn = action.unbind(-2)
    turned = torch.stack([-up, along, torch.zeros_like(turn)], -2) * wheels[:, 5].unsqueeze(-1).unsqueeze(-1)
    scale = contact.body_scale.unsqueeze(-1).unsqueeze(-1)
    part, change = (balances(contact.geometry, axle, x) * scale for x in (action, turned))
    return (part.unsqueeze(-1) * forces.unsqueeze(-4)).sum(-2), (change.unsqueeze(-1) * forces[0].unsqueeze(-4)).sum(-2)


def values_alone(contact: Contact) -> Contact:
    """The same without the changes for uncertain constants (TorchScript has no ``_replace``)."""
    return Contact(
        contact.constants, contact.varied[:1], contact.nodes, contact.column_unit, contact.geometry, contact.body_scale,
        contact.moment_variance, contact.stand_in, contact.gravity, contact.radius, contact.width,
    )  # fmt: skip


def with_body(contact: Contact, geometry: Geometry, body_scale: Tensor) -> Contact:
    """The same with another body."""
    return Contact(
        contact.constants, contact.varied, contact.nodes, contact.column_unit, geometry, body_scale,
        contact.moment_variance, contact.stand_in, contact.gravity, contact.radius, contact.width,
    )  # fmt: skip


class Wheels(NamedTuple):
    """The wheels of n observations and where their forces are expanded."""

    measured: Tensor  # [n, 8, A] packed groups, harmless where a wheel is not usable
    usable: Tensor  # [n, A] bool
    place: Tensor  # [n, 8, A] the same with the slip and sinkage around which forces are expanded


def expanded_wheels(packed: Tensor, likely: Tensor, contact: Contact) -> Wheels:
    """The wheels of ``packed``, to be expanded around the slips and sinkages of ``likely``; both [n, 8 A + SCALARS]."""
    axles = contact.geometry.axle_x.shape[0]
    wheels = packed[:, : 8 * axles].view(-1, 8, axles)
    usable = usable_wheels(wheels, contact)
    wheels = torch.where(usable.unsqueeze(1), wheels, contact.stand_in)
    place = torch.where(usable.unsqueeze(1), likely[:, : 8 * axles].view(-1, 8, axles), contact.stand_in)
    return Wheels(wheels, usable, place)


def measured_forces(wheels: Wheels, forces: Tensor) -> Tensor:
    """``forces`` of :func:`changes` with the values moved, to first order, to the measured slips and sinkages."""
    measured, place = wheels.measured, wheels.place
    away = torch.stack([(measured[:, 0] - place[:, 0]) / measured[:, 1], (measured[:, 2] - place[:, 2]) / measured[:, 3]])
    shifted = forces[0] + (away.unsqueeze(1).unsqueeze(-1).unsqueeze(-1) * forces[1:]).sum(0)
    return torch.cat([shifted.unsqueeze(0), forces[1:]])


LARGEST_ERROR = 3.0
"""[standard deviations] by which an input is moved at most."""


def likely_inputs(packed: Tensor, contact: Contact, theta: Tensor, chosen: Tensor, largest: float = LARGEST_ERROR) -> Tensor:
    """Packed observations with each slip and sinkage where the rows of its instant agree best, given ``theta`` [3]."""
    rows = regression_rows(packed, packed, values_alone(contact))
    return agreeing_inputs(rows, packed, contact, theta, chosen, largest)


def agreeing_inputs(rows: Rows, packed: Tensor, contact: Contact, theta: Tensor, chosen: Tensor, largest: float = LARGEST_ERROR) -> Tensor:
    """What :func:`likely_inputs` returns, from the ``rows`` of the measured inputs.

    One step of the projection that orthogonal distance regression makes, e = G' S^-1 r, by the rows that are ``chosen``
    [R] (1 or 0), without the velocity's, whose dv/dt no single instant measures. As a place to expand the rows around, it
    need not be exact, nor ``theta`` = (c [kPa], tan phi, 1).
    """
    axles = contact.geometry.axle_x.shape[0]
    used = (rows.used * chosen)[:, 1:]
    noise = (rows.noise[0, :, 1:] @ theta) * used.unsqueeze(-1)
    residual = (rows.target[:, 1:] - rows.features[0, :, 1:] @ theta) * used
    covariance = noise @ noise.transpose(1, 2) + torch.diag_embed(rows.variance[:, 1:] * used + (1.0 - used))
    error = (noise.transpose(1, 2) @ torch.cholesky_solve(residual.unsqueeze(-1), cholesky(covariance))).squeeze(-1)
    error = error.clamp(-largest, largest)
    wheels = packed[:, : 8 * axles].view(-1, 8, axles)
    slip = wheels[:, 0] + wheels[:, 1] * error[:, :axles]
    sinkage = torch.maximum(wheels[:, 2] + wheels[:, 3] * error[:, axles : 2 * axles], 0.3 * wheels[:, 2])
    moved = torch.cat([torch.stack([slip, wheels[:, 1], sinkage], 1), wheels[:, 3:]], 1)
    possible = usable_wheels(moved, contact).unsqueeze(1)
    return torch.cat([torch.where(possible, moved, wheels).flatten(1), packed[:, 8 * axles :]], 1)


def regression_rows(packed: Tensor, likely: Tensor, contact: Contact) -> Rows:
    """Rows of n packed observations [n, 8 A + SCALARS], expanded around the inputs of ``likely``, which has the same shape.

    A wheel that is not usable takes the rows that need it along.
    """
    wheels = expanded_wheels(packed, likely, contact)
    where = varied_inputs(wheels.place, contact)
    forces = wheel_forces(where.slip, where.sinkage, where.constants, contact.radius, contact.width, contact.nodes)
    return rows_of_forces(packed, wheels, measured_forces(wheels, changes(forces, where.scale, contact)), contact)


def rows_of_forces(packed: Tensor, expanded: Wheels, forces: Tensor, contact: Contact) -> Rows:
    """Rows of n packed observations, given the ``forces`` [3, C, n, A, 3, 3] of :func:`measured_forces`."""
    axles = contact.geometry.axle_x.shape[0]
    wheels, usable = expanded.measured, expanded.usable
    scalars = packed[:, 8 * axles :]
    bogie = torch.isfinite(scalars[:, 6])
    parts, by_angle = body_parts(forces, wheels, torch.where(bogie, scalars[:, 6], 0.0), contact)
    body, body_noise = parts[0].sum(-2), torch.cat([parts[1], parts[2], by_angle], -2)  # [C, n, 4, 3], [C, n, 4, 3 A, 3]
    eye = torch.eye(axles, dtype=packed.dtype).unsqueeze(-1)
    own = [eye * forces[1, :, :, :, 2].unsqueeze(2), eye * forces[2, :, :, :, 2].unsqueeze(2)]
    torque_noise = torch.cat([own[0], own[1], torch.zeros_like(own[0])], 3)  # [C, n, A, 3 A, 3]
    noise = torch.cat([body_noise[:, :, :2], torque_noise, body_noise[:, :, :1], body_noise[:, :, 2:]], 2)

    pitch, pitch_sd = scalars[:, 2], scalars[:, 3]
    tilt = torch.zeros_like(noise[:, :, :, :1])
    tilt[0, :, 0, 0, 2] = -contact.gravity * torch.cos(pitch) * pitch_sd
    tilt[0, :, 1, 0, 2] = torch.sin(pitch) * pitch_sd
    every = usable.all(1, keepdim=True)
    measured = torch.cat([packed[:, 6 * axles : 7 * axles], scalars[:, 4:5]], 1)
    measured_sd = torch.cat([packed[:, 7 * axles : 8 * axles], scalars[:, 5:6]], 1)
    holds = torch.isfinite(measured) & torch.isfinite(measured_sd) & torch.cat([usable, every], 1)
    balance = torch.stack([contact.gravity * torch.sin(pitch), torch.cos(pitch)], 1)
    carried = every & bogie.unsqueeze(1)
    nothing = torch.zeros_like(balance)
    return Rows(
        features=torch.cat([body[:, :, :2], forces[0, :, :, :, 2], body[:, :, :1], body[:, :, 2:]], 2),
        noise=torch.cat([noise, tilt], 3),
        target=torch.cat([balance, torch.where(holds, measured, 0.0), nothing], 1),
        variance=torch.cat([nothing, torch.where(holds, measured_sd**2, 0.0), nothing + contact.moment_variance], 1),
        used=torch.cat([every, every, holds, carried, carried], 1).to(packed.dtype),
    )
