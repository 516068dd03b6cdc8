# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of a wheel that moves anyhow: driven, braked, locked, backwards, across its heading.

Frames (REP-103): x along the heading, y to the left, z up. The hub moves with (v_x, v_y), the rim
turns with r w, positive forwards. A point of the rim at theta (0 below the axle, positive ahead)
then moves over the ground with (cf. Yoshida and Ishigami 2004, Ishigami et al. 2007)::

    u = (r w - v_x cos(theta), -v_y)        backwards along the rim, and to the right
    g = INT u from theta to theta_1
      = (r w (theta_1 - theta) - v_x (sin(theta_1) - sin(theta)), -v_y (theta_1 - theta))
    (j, j_y) = g r / |r w|                  shear displacement [m]

Wong and Reece's j is the first one. Pressure and angles are those of ``stresses``. Shear stress has
one limit for both directions, and acts along the displacement::

    tau = (c + sigma tan(phi)) E,  E = (g / |g|) (1 - exp(-|g| r / (K |r w|)))
    N = r b { INT tau_x sin + INT sigma cos }       M = r^2 b INT tau_x
    T = r b { INT tau_x cos - INT sigma sin }       Y = r b INT tau_y

All are affine in (c, tan(phi)). Only ratios of the three speeds matter, so that they are inputs
instead of slip 1 - v_x / (r w) and v_y / (r w): they stay finite where the wheel is locked
(E = g / |g|, all of the strength) or crabs at a right angle. Between turning and locked, where
|r w| is some per cent of the sliding speed, E rises in a thin layer at theta_1: take more nodes.

**Why along the displacement.** What the ground takes from the wheel is, per second::

    M w - T v_x - Y v_y = r b INT (tau . u + sigma v_x sin) dtheta

and must not be negative. Along the velocity u the first part is so by itself. But at v_y = 0 this
is not Wong and Reece's law: a lightly braked rim, 1 > r w / v_x > cos(theta_1), first shears the
ground backwards and then forwards, and their stress follows j, not its rate. Along the displacement
the part is, as u is the derivative of g and sigma vanishes at both ends,::

    INT (c + sigma tan(phi)) dF = c F(end) + tan(phi) INT (F(rear) - F(front)) dsigma

where F = |g| - L (1 - exp(-|g| / L)), L = K |r w| / r, rises with the length of g, and front and
rear are the two places with the same sigma. So it is not negative either where g grows longer on
the way to the rear, which it does at every motion but light braking. There it first grows by no
more than r w theta_1^3 / 6 and shrinks again, while INT sigma v_x sin, by which the ground is
pressed down, goes with theta_1^2. The displacement is therefore the law: it is today's law without
slip across, and keeps the sign of the energy. In 2 10^5 lightly braked wheels with n to 3, K from 1
mm and sinkages to 0.95 r it does so up to tan(phi) = 1.2; at tan(phi) = 2 nearly buried wheels
break it, by up to 14 % of what pressing takes, as they do in today's law.

**Outside Wong and Reece's range.** Ground enters below the leading edge, that is on the side to
which the hub moves along its heading: a wheel that moves backwards is the mirror image of one that
moves forwards, and a locked wheel, or one that turns against its way, shears the ground from the
leading edge on. Where v_x is less than 4 % of the other speeds the side is undecided: the forces go
over linearly from one side to the other, and a wheel that spins or crabs on the spot presses both.
Slip moves theta_m as before, by 1 - |v_x| / |r w| within [-0.6, 1], and not at all where the wheel
slides straight across.
"""

from functools import cache
from typing import NamedTuple, Protocol, cast

import torch
from torch import Tensor

from terramechanics.contact.stresses import (
    MIN_SLIP,
    contact_nodes,
    entry_angle,
    force_rows,
    shared_shear,
    stress_ratio,
)
from terramechanics.numerics.batching import any_of
from terramechanics.vehicle.wheel_places import UNDECIDED

LOCKED = 1e-9
"""[1] Share of the fastest speed below which a rim counts as locked."""
TINY = 1e-200
"""[m/s] Keeps ratios of speeds finite where all of them are zero."""


class WheelMotion(NamedTuple):
    """Speeds of wheels [m/s], shapes [...] that broadcast; only their ratios matter."""

    rim: Tensor  # r w, positive where the wheel drives forwards
    along: Tensor  # v_x of the hub along the heading
    across: Tensor  # v_y of the hub, to the left of the heading


def motion_of_slip(slip: Tensor, lateral: Tensor) -> WheelMotion:
    """Return the motion for slip i = 1 - v_x / (r w) and the ratio v_y / (r w) [1], r w > 0."""
    rim = torch.ones_like(slip + lateral)
    return WheelMotion(rim, 1.0 - slip + torch.zeros_like(rim), lateral + torch.zeros_like(rim))


def dissipated_power(motion: WheelMotion, forces: Tensor, radius: float) -> Tensor:
    """Return M w - T v_x - Y v_y [W] [...], what the ground takes, for forces [..., 4]."""
    _, traction, torque, lateral = forces.unbind(-1)
    return torque * motion.rim / radius - traction * motion.along - lateral * motion.across


def rolling_forces(
    motion: WheelMotion,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    slowest: float = 0.0,
) -> Tensor:
    """Return the coefficients of N, T [N], M [N m] and Y [N] of wheels, affine in (c, tan(phi)).

    ``motion`` [...], ``sinkage`` [...] [m] and ``constants`` [..., 6] (order CONSTANTS) broadcast;
    ``nodes`` come from :func:`terramechanics.contact.stresses.quadrature`, ``exit_angle`` [...]
    [rad] as there. Returns [..., 4, 3]: rows N up, T along the heading, M that drives forwards, Y
    to the left; columns c [Pa], tan(phi) [1], 1. Never NaN for finite input.

    ``slowest`` [m/s] is a rim speed: no slower rim gets its shear displacement in a longer time. So
    the friction of a wheel that hardly moves goes through zero with its velocity, within about K
    ``slowest`` / r, instead of jumping. With 0 a resting wheel has no friction, one that begins to
    slide has all of it.

    Sources: the equations at the head of this module.
    """
    rim, along, across, depth = torch.broadcast_tensors(  # type: ignore[no-untyped-call]
        motion.rim, motion.along, motion.across, sinkage
    )
    leads = _leading(along, torch.clamp(torch.hypot(rim, across), min=slowest))
    ahead = torch.where(along < 0.0, -1.0, 1.0).to(rim.dtype)
    rows = _pressed(
        ahead * rim, ahead * along, across, ahead, depth, constants, radius, width, nodes,
        exit_angle, slowest,
    )  # fmt: skip
    undecided = torch.abs(leads) < 1.0
    if not any_of(undecided):
        return rows
    other = _pressed(
        -ahead * rim, -ahead * along, across, -ahead, depth, constants, radius, width, nodes,
        exit_angle, slowest,
    )  # fmt: skip
    share = torch.where(undecided, 0.5 - 0.5 * torch.abs(leads), 0.0)[..., None, None]
    return rows + share * (other - rows)


class RollingForceFunction(Protocol):
    """A function with the arguments and the result of :func:`rolling_forces`."""

    def __call__(
        self,
        motion: WheelMotion,
        sinkage: Tensor,
        constants: Tensor,
        radius: float,
        width: float,
        nodes: Tensor,
        exit_angle: Tensor | None = None,
        slowest: float = 0.0,
    ) -> Tensor:
        """Return [..., 4, 3]."""


@cache
def compiled_rolling_forces() -> RollingForceFunction:
    """Return :func:`rolling_forces` compiled by TorchScript, once a process: the same numbers."""
    return cast("RollingForceFunction", torch.jit.script(rolling_forces))


def _leading(
    along: Tensor, other: Tensor, undecided: float = UNDECIDED, tiny: float = TINY
) -> Tensor:
    """Return v_x in units of the speed from which on it decides which edge leads [1]."""
    return along / torch.clamp(undecided * other, min=tiny)


def _scaled(
    rim: Tensor,
    along: Tensor,
    across: Tensor,
    slowest: float,
    locked: float = LOCKED,
    tiny: float = TINY,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the speeds in units of the fastest, and the slowest rim that counts as turning."""
    fastest = torch.maximum(torch.maximum(torch.abs(rim), torch.abs(along)), torch.abs(across))
    scale = torch.clamp(fastest, min=max(slowest, tiny))
    slow = torch.clamp(slowest / scale, min=locked)
    return rim / scale, along / scale, across / scale, slow


def _stress_slip(
    rim: Tensor,
    along: Tensor,
    across: Tensor,
    slow: Tensor,
    lowest: float = MIN_SLIP,
) -> Tensor:
    """Return the slip [1] that moves theta_m: no less than ``lowest``, none straight across."""
    slip = 1.0 - torch.abs(along) / torch.maximum(torch.abs(rim), slow)
    rolls = _leading(torch.hypot(rim, along), torch.maximum(torch.abs(across), slow))
    return torch.clamp(slip, min=lowest) * torch.clamp(rolls, max=1.0)


def _pressed(
    rim: Tensor,
    along: Tensor,
    across: Tensor,
    ahead: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None,
    slowest: float,
) -> Tensor:
    """Return the rows of wheels that press the ground on the side ``ahead`` (1 or -1).

    ``rim`` and ``along`` count towards that side.
    """
    rim, along, across, slow = _scaled(rim, along, across, slowest)
    theta_1 = entry_angle(sinkage, radius)
    ratio = stress_ratio(_stress_slip(rim, along, across, slow), constants)
    theta_m = theta_1 * torch.clamp(ratio, 1e-3, 1.0 - 1e-3)
    # The ground has been sheared for as long as the rim took from theta_1.
    pace = torch.maximum(torch.abs(rim), slow)
    braking = (rim > 0.0) & (along > rim)
    braked = any_of(braking)
    reversing = torch.where(braking, 1.0 - along / pace, 0.0)
    theta, sine, cosine, step, normal = contact_nodes(
        theta_1, theta_m, reversing, braked, constants, radius, width, nodes, exit_angle
    )
    stretch = radius / (constants[..., 3] * pace)
    lag = ((theta - theta_1) * rim + along * (torch.sin(theta_1) - sine)) * stretch
    mobilised, sideways = shared_shear(lag, (theta_1 - theta) * across * stretch)
    rows = force_rows(step, normal, mobilised, sine, cosine, radius)
    turned = ahead * rows[1:]  # T and M count forwards again
    lateral = torch.stack([step * sideways, normal * sideways, torch.zeros_like(sideways)])
    rows = torch.cat([rows[:1], turned, -lateral.sum([1, 2]).unsqueeze(0)])
    return rows.movedim([0, 1], [-2, -1])
