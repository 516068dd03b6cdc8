# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Forces between a rigid wheel and deformable ground: the Wong-Reece stress integrals.

For given slip, sinkage and soil constants, normal force N, traction T and driving torque M are
exactly affine in cohesion c and tan(phi) (Wong and Reece 1967, Iagnemma et al. 2004, Banerjee et
al. eq. 7 with the integrals kept)::

    N = r b { c INT E sin + tan(phi) INT sigma E sin + INT sigma cos }
    T = r b { c INT E cos + tan(phi) INT sigma E cos - INT sigma sin }
    M = r^2 b { c INT E + tan(phi) INT sigma E }

with E = sgn(j) (1 - exp(-|j| / K)). A wheel that moves at a slip angle beta to its heading shears
the soil sideways too, by j_y = r (1 - i) (theta_1 - theta) tan(beta) (Yoshida and Ishigami 2004,
Ishigami et al. 2007). Shear stress is directed along the displacement (j, j_y) and limited as a
whole, as Mohr and Coulomb have it (Jia, Smith and Peng 2011)::

    E, E_y = (j, j_y) / J (1 - exp(-J / K)), J = hypot(j, j_y)
    Y = r b { c INT E_y + tan(phi) INT sigma E_y }

Ishigami et al. limit each direction by itself, with a shear modulus each that depends on beta:
together they then exceed the strength of the soil by up to sqrt(2). Both forms are affine in (c,
tan(phi)) and the same at beta = 0.

Every function here takes and returns tensors, broadcasts over leading dimensions and can be
compiled by ``torch.jit.script``, so that simulator, regression features and exported model share
it.
"""

from functools import cache
from typing import Protocol, cast

import numpy as np
import torch
from torch import Tensor

from terramechanics.numerics.batching import any_of

MIN_SLIP = -0.6
"""[1] Below it a wheel is dragged rather than braked, which these stresses do not describe."""
MAX_SLIP = 0.95
"""[1] Above it a wheel digs itself in and no quasi-static sinkage is meaningful."""


def quadrature(points: int = 6) -> Tensor:
    """Return the Gauss-Legendre nodes and weights on [0, 1], shape [2, points], float64.

    6 points keep the error of every force near 1e-6 of the largest force of that wheel for the
    preset soils, 24 below 1e-8.
    """
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return torch.tensor(np.stack([(nodes + 1) / 2, weights / 2]), dtype=torch.float64)


def entry_angle(sinkage: Tensor, radius: float) -> Tensor:
    """Return the entry angle theta_1 = acos(1 - z / r) [rad], exact for shallow sinkage too."""
    depth = torch.clamp(sinkage / (2.0 * radius), 1e-12, 0.499999)
    return 2.0 * torch.asin(torch.sqrt(depth))


def stress_ratio(slip: Tensor, constants: Tensor) -> Tensor:
    """Return theta_m / theta_1 = c1 + c2 i [1], at the largest stress (Banerjee et al. eq. 12)."""
    return torch.addcmul(constants[..., 4], constants[..., 5], slip)


def in_range(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    lowest: float = MIN_SLIP,
    highest: float = MAX_SLIP,
) -> Tensor:
    """Return where lowest <= i <= highest, 0 < z < r and 0 < theta_m < theta_1.

    This is the range of the model. NaN is never in range.
    """
    ratio = stress_ratio(slip, constants)
    sunk = (sinkage > 0.0) & (sinkage < radius)
    return sunk & (slip >= lowest) & (slip <= highest) & (ratio > 0.0) & (ratio < 1.0)


def shear_reversal_angle(slip: Tensor, theta_1: Tensor) -> Tensor:
    """Return the angle [rad] in (0, theta_1) at which j changes its sign, for wheels with i < 0.

    j is the shear displacement.

    j = 0 where the mean of cos over [theta, theta_1] equals 1 / (1 - i). Newton from the
    small-angle root; where j keeps its sign the answer is an end of the interval, so that it can
    always be used to split an integral.
    """
    target = 1.0 / (1.0 - slip)
    square = 24.0 * (1.0 - target) - 3.0 * theta_1**2
    theta = torch.clamp((torch.sqrt(torch.clamp(square, min=0.0)) - theta_1) / 2.0, min=0.0)
    for _ in range(5):
        theta = torch.minimum(theta, 0.999999 * theta_1)
        width = theta_1 - theta
        mean_cos = (torch.sin(theta_1) - torch.sin(theta)) / width
        slope = torch.clamp((mean_cos - torch.cos(theta)) / width, max=-1e-9)
        theta = torch.clamp(theta - (mean_cos - target) / slope, min=0.0)
    return torch.minimum(theta, theta_1)


def _split_nodes(
    theta_0: Tensor, theta_1: Tensor, theta_m: Tensor, u: Tensor, weight: Tensor
) -> tuple[Tensor, Tensor]:
    """Return nodes and weights on [0, u_0] and [u_0, 1]; shapes [2 P, ...].

    u_0 is the substituted place of the kink theta_0.
    """
    front = torch.sqrt(torch.clamp(theta_1 - theta_0, min=0.0) / (theta_1 - theta_m))
    rear = torch.sqrt(torch.clamp(theta_0, min=0.0) / theta_m)
    kink = torch.where(theta_0 > theta_m, front, rear).clamp(0.0, 1.0)
    return torch.cat([kink * u, kink + (1.0 - kink) * u]), torch.cat(
        [kink * weight, (1.0 - kink) * weight]
    )


def contact_nodes(
    theta_1: Tensor,
    theta_m: Tensor,
    slip: Tensor,
    braked: bool,  # noqa: FBT001 - torch.jit.script
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None,
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Return theta [rad], its sine and cosine, the area [m^2] and the normal force [N] of nodes.

    Each is [2, P, ...]: in front of ``theta_m`` and behind it. Where some wheel is ``braked``, both
    sides are split where the shear of a wheel at ``slip`` [...] changes its sign.

    On both sides of theta_m the normal stress goes like x^n at its outer end. With theta = theta_1
    - L u^2 in front and theta = theta_m u^2 behind the integrand is smooth, and sigma takes the
    same values on both sides.
    """
    # nodes first, so that the values of many wheels are contiguous
    u, weight = nodes.view([2, -1] + [1] * theta_m.dim()).unbind(0)
    if braked:
        reach = torch.zeros_like(theta_1) if exit_angle is None else exit_angle
        reversal = shear_reversal_angle(slip, theta_1) + reach
        u, weight = _split_nodes(reversal, theta_1 + reach, theta_m + reach, u, weight)
    square, arc = u * u, (2.0 * radius * width) * u * weight
    length, rear = theta_1 - theta_m, theta_m if exit_angle is None else theta_m + exit_angle
    front = length * square
    behind = rear * square if exit_angle is None else rear * square - exit_angle
    half = 0.5 * front
    height = (2.0 * radius) * torch.sin(theta_1 - half) * torch.sin(half)
    n, k_c, k_phi = constants[..., :3].unbind(-1)
    sigma = (k_c / width + k_phi) * torch.pow(height, n)
    theta = torch.stack([theta_1 - front, behind])  # [2, P, ...], as all of both sides
    step = torch.stack([length * arc, rear * arc])
    return theta, torch.sin(theta), torch.cos(theta), step, sigma * step


def shared_shear(lag: Tensor, sideways: Tensor) -> tuple[Tensor, Tensor]:
    """Return -E and -E_y for -j / K and -j_y / K: one limit for both directions.

    Shear stress acts along the displacement, and its size is that of Janosi for its length.
    """
    whole = torch.sqrt(lag**2 + sideways**2)
    share = -torch.expm1(-whole) / torch.clamp(whole, min=1e-30)
    return lag * share, sideways * share


def _mobilised(
    theta: Tensor,
    theta_1: Tensor,
    sine: Tensor,
    slip: Tensor,
    stretch: Tensor,
    braked: bool,  # noqa: FBT001 - torch.jit.script
    slip_angle: Tensor | None,
) -> tuple[Tensor, Tensor]:
    """Return -E and -E_y [2, P, ...] [1], the shares of the shear strength that are mobilised.

    ``stretch`` is radius / K. Without a slip angle -E_y has no meaning.
    """
    # -j / K
    lag = torch.addcmul(theta - theta_1, 1.0 - slip, torch.sin(theta_1) - sine) * stretch
    if slip_angle is not None:
        return shared_shear(
            lag, (theta - theta_1) * ((1.0 - slip) * torch.tan(slip_angle) * stretch)
        )
    return -torch.sign(lag) * torch.expm1(-torch.abs(lag)) if braked else torch.expm1(lag), lag


def force_rows(
    step: Tensor, normal: Tensor, mobilised: Tensor, sine: Tensor, cosine: Tensor, radius: float
) -> Tensor:
    """Integrate the stresses: rows N, T, M, columns c, tan(phi), 1; shape [3, 3, ...].

    ``step`` is the arc of each node times the width [m^2], ``normal`` its normal force [N].
    """
    stresses = torch.stack([step * mobilised, normal * mobilised, normal])
    integrals = torch.stack(
        [
            (stresses * sine).sum([1, 2]),
            (stresses * cosine).sum([1, 2]),
            radius * stresses.sum([1, 2]),
        ]
    )
    by_sine, by_cosine, _ = integrals[:, 2].unbind(0)
    constant = torch.stack([by_cosine, -by_sine, torch.zeros_like(by_sine)])
    return torch.cat([-integrals[:, :2], constant.unsqueeze(1)], 1)


def wheel_forces(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    slip_angle: Tensor | None = None,
) -> Tensor:
    """Return the coefficients of N, T [N] and M [N m] of one wheel, affine in (c [Pa], tan(phi)).

    ``slip`` [...] and ``sinkage`` [...] [m] broadcast with ``constants`` [..., 6] (order
    CONSTANTS); ``nodes`` comes from :func:`quadrature`. Returns [..., 3, 3]: rows N, T, M; columns
    c, tan(phi), 1. Outside :func:`in_range` the stresses are evaluated at the edge of the range,
    never NaN for finite input.

    With an ``exit_angle`` [...] [rad] contact reaches from theta_1 to theta_2 = -exit_angle behind
    the axle: the rear side is stretched to [theta_2, theta_m], theta_m stays (Ishigami et al.
    2007).

    With a ``slip_angle`` [rad] that broadcasts to ``slip``, of less than a right angle, there is a
    fourth row: the lateral force Y [N]. Positive is a wheel that moves to the right of its heading,
    and the force that then pushes it to the left. ``slip`` is that of the speed along the heading,
    1 - V cos(beta) / (r w).
    """
    theta_1 = entry_angle(sinkage, radius)
    theta_m = theta_1 * torch.clamp(stress_ratio(slip, constants), 1e-3, 1.0 - 1e-3)
    braked = any_of(slip < 0.0)
    theta, sine, cosine, step, normal = contact_nodes(
        theta_1, theta_m, slip, braked, constants, radius, width, nodes, exit_angle
    )
    mobilised, sideways = _mobilised(
        theta, theta_1, sine, slip, radius / constants[..., 3], braked, slip_angle
    )
    rows = force_rows(step, normal, mobilised, sine, cosine, radius)
    if slip_angle is not None:
        lateral = torch.stack([step * sideways, normal * sideways, torch.zeros_like(sideways)])
        rows = torch.cat([rows, -lateral.sum([1, 2]).unsqueeze(0)])
    return rows.movedim([0, 1], [-2, -1])


def wheel_torque(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    slip_angle: Tensor | None = None,
) -> Tensor:
    """Return the coefficients of M [N m] alone: c, tan(phi), shape [..., 2].

    They are those of :func:`wheel_forces`, sooner: for searches of the slip that takes a torque.
    """
    theta_1 = entry_angle(sinkage, radius)
    theta_m = theta_1 * torch.clamp(stress_ratio(slip, constants), 1e-3, 1.0 - 1e-3)
    braked = any_of(slip < 0.0)
    theta, sine, _, step, normal = contact_nodes(
        theta_1, theta_m, slip, braked, constants, radius, width, nodes, exit_angle
    )
    mobilised, _ = _mobilised(
        theta, theta_1, sine, slip, radius / constants[..., 3], braked, slip_angle
    )
    stresses = torch.stack([step * mobilised, normal * mobilised])
    return (-radius * stresses.sum([1, 2])).movedim(0, -1)


class WheelForceFunction(Protocol):
    """A function with the arguments of :func:`wheel_forces` that returns coefficients."""

    def __call__(
        self,
        slip: Tensor,
        sinkage: Tensor,
        constants: Tensor,
        radius: float,
        width: float,
        nodes: Tensor,
        exit_angle: Tensor | None = None,
        slip_angle: Tensor | None = None,
    ) -> Tensor:
        """Return [..., 3, 3], or [..., 4, 3] at a slip angle; of wheel_torque [..., 2]."""


@cache
def compiled_wheel_forces() -> WheelForceFunction:
    """Return :func:`wheel_forces` compiled by TorchScript: the same numbers, sooner for few wheels.

    It is compiled once a process, in 0.2 s. It cannot be mapped by ``torch.vmap``.
    """
    return cast("WheelForceFunction", torch.jit.script(wheel_forces))


@cache
def compiled_wheel_torque() -> WheelForceFunction:
    """Return :func:`wheel_torque` compiled by TorchScript, once a process."""
    return cast("WheelForceFunction", torch.jit.script(wheel_torque))


CHUNK = 2048
"""Wheels that are integrated together: their numbers then stay in a cache of 2 MB.

A multiple of the numbers that a processor takes at once, so that every wheel has the same place
among them as in one large batch, and the same bytes.
"""


def many_wheel_forces(
    slip: Tensor,
    sinkage: Tensor,
    constants: Tensor,
    radius: float,
    width: float,
    nodes: Tensor,
    exit_angle: Tensor | None = None,
    slip_angle: Tensor | None = None,
) -> Tensor:
    """Return :func:`wheel_forces` of any number of wheels, in chunks.

    Above some thousand wheels the time of each grows with the size of the cache that they need:
    from 0.5 to 0.8 us in 10^5. Braked wheels take twice the nodes, and make only those of their own
    chunk take them; their sums then differ by rounding.
    """
    forces = compiled_wheel_forces()
    alike = torch.broadcast_tensors(slip, sinkage, constants[..., 0])  # type: ignore[no-untyped-call]
    shape = alike[0].shape
    if shape.numel() < 2 * CHUNK:
        return forces(slip, sinkage, constants, radius, width, nodes, exit_angle, slip_angle)
    slips, sinkages = (torch.split(each.reshape(-1), CHUNK) for each in alike[:2])
    tables = torch.split(constants.expand(*shape, 6).reshape(-1, 6), CHUNK)
    exits, angles = (
        [None] * len(slips)
        if angle is None
        else torch.split(angle.expand(shape).reshape(-1), CHUNK)
        for angle in (exit_angle, slip_angle)
    )
    found = [
        forces(one, deep, table, radius, width, nodes, exit_, angle)
        for one, deep, table, exit_, angle in zip(
            slips, sinkages, tables, exits, angles, strict=True
        )
    ]
    return torch.cat(found).view(*shape, *found[0].shape[-2:])


def wheel_forces_linear_stress(
    slip: Tensor, sinkage: Tensor, constants: Tensor, radius: float, width: float
) -> Tensor:
    """Return the coefficients under linear stresses, f0 to f4 (Banerjee et al. eqs. 8 to 14).

    sigma and tau rise linearly from 0 at theta_1 to their largest values at theta_m; behind it
    sigma falls to 0 and tau to c at theta = 0. Shapes and units as in :func:`wheel_forces`. The
    paper's model, kept as a baseline.
    """
    t1 = entry_angle(sinkage, radius)
    tm = t1 * torch.clamp(stress_ratio(slip, constants), 1e-3, 1.0 - 1e-3)
    f0 = radius * width / (tm * (t1 - tm))
    f1 = -tm * torch.cos(t1) + t1 * torch.cos(tm) - t1 + tm
    f2 = tm * torch.sin(t1) - t1 * torch.sin(tm)
    f3 = t1 * torch.sin(tm) - tm * torch.sin(tm) - tm * t1 + tm**2
    f4 = t1 * torch.cos(tm) - tm * torch.cos(tm) + tm - t1
    stiffness = constants[..., 1] / width + constants[..., 2]
    sigma = stiffness * torch.pow(radius * (torch.cos(tm) - torch.cos(t1)), constants[..., 0])
    displacement = radius * (t1 - tm - (1.0 - slip) * (torch.sin(t1) - torch.sin(tm)))
    a = -torch.expm1(-displacement / constants[..., 3])
    zero = torch.zeros_like(f0)
    normal = torch.stack([-f0 * (f3 + a * f2), -f0 * sigma * a * f2, f0 * sigma * f1], dim=-1)
    traction = torch.stack([f0 * (-f4 + a * f1), f0 * sigma * a * f1, f0 * sigma * f2], dim=-1)
    torque = torch.stack([tm + a * t1, a * sigma * t1, zero], dim=-1) * (radius**2 * width / 2.0)
    return torch.stack([normal, traction, torque], dim=-2)
