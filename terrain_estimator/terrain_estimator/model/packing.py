# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One observation as one flat tensor, which the exported model takes, and the named view of it.

With W wheels the layout is eight groups of W values, then the scalars (with the W wheel rates where
a model takes them), all SI and float64, NaN for "not measured". One tensor instead of sixteen keeps
the call of the exported model cheap, and its layout is part of the model file. One value stands for
the wheels of an axle, so W is the number of axles. No other module knows a place in the layout:
:func:`view_of` names the parts, and the functions below it replace them.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from terrain_estimator.observation import Floats, Observation
from terramechanics.simulation.sample import TIME_STEP, Measurement

PACKED_WHEEL_FIELDS = (
    "slip",
    "slip_sd",
    "sinkage",
    "sinkage_sd",
    "contact_angle",
    "contact_angle_sd",
    "torque",
    "torque_sd",
)
"""Groups of one value per wheel, front to rear; units as in Observation."""

PACKED_SCALAR_FIELDS = (
    "velocity",
    "velocity_sd",
    "pitch",
    "pitch_sd",
    "acceleration",
    "acceleration_sd",
    "bogie_angle",
    "step",
    "linked",
)
"""The scalars, of which two are about the time.

``step`` [s] is the time since the observation before; ``linked`` is 1 where that one was used and
the step is short.
"""

GROUPS = len(PACKED_WHEEL_FIELDS)
"""Number of values per wheel, without its rate."""
MEASURED = PACKED_SCALAR_FIELDS.index("step")
"""Number of measured scalars; behind them stand the wheel rates, where a model takes them."""
TIMING = len(PACKED_SCALAR_FIELDS) - MEASURED
"""Number of scalars about the time, which stand last."""
BLOCK = 10
"""Observations in a block: one second at 10 Hz."""


def scalar_fields(wheels: int, *, rates: bool) -> tuple[str, ...]:
    """Return the scalars of a model; ``rates`` puts the wheel rates [rad/s] before ``step``."""
    turning = tuple(f"wheel_rate_{wheel}" for wheel in range(wheels)) if rates else ()
    return (*PACKED_SCALAR_FIELDS[:MEASURED], *turning, *PACKED_SCALAR_FIELDS[MEASURED:])


def packed_size(wheels: int, *, rates: bool = False) -> int:
    """Return the length P of a packed observation."""
    return GROUPS * wheels + len(scalar_fields(wheels, rates=rates))


class PackedView(NamedTuple):
    """The parts of packed observations [..., P], as views of one tensor.

    A part that a layout does not have comes with zero wheels.
    """

    packed: Tensor  # [..., P]
    slip: Tensor  # [..., W] [1]
    slip_sd: Tensor  # [..., W]
    sinkage: Tensor  # [..., W] [m]
    sinkage_sd: Tensor  # [..., W]
    contact_angle: Tensor  # [..., W] [rad]
    contact_angle_sd: Tensor  # [..., W]
    torque: Tensor  # [..., W] [N m]
    torque_sd: Tensor  # [..., W]
    steering: Tensor  # [..., W] [rad] about z, to the left
    slip_angle: Tensor  # [..., W] [rad] of the wheel's velocity to its heading
    velocity: Tensor  # [...] [m/s]
    velocity_sd: Tensor  # [...]
    pitch: Tensor  # [...] [rad]
    pitch_sd: Tensor  # [...]
    acceleration: Tensor  # [...] [m/s^2]
    acceleration_sd: Tensor  # [...]
    bogie_angle: Tensor  # [...] [rad]
    wheel_rate: Tensor  # [..., W] [rad/s]; [..., 0] where the model takes none
    step: Tensor  # [...] [s] since the observation before
    linked: Tensor  # [...] 1 where the velocity carries over from the one before


def view_of(
    packed: Tensor,
    wheels: int,
    groups: int = GROUPS,
    measured: int = MEASURED,
    timing: int = TIMING,
    required: int = GROUPS,
) -> PackedView:
    """Return the named parts of packed observations [..., P] of ``wheels`` wheels.

    ``groups`` is the number of values per wheel in this layout. Behind the GROUPS that every layout
    has, it may have steering, or steering and slip angle.
    """
    rates = packed.shape[-1] - groups * wheels - measured - timing
    grouped, scalars, wheel_rate, time = packed.split_with_sizes(
        [groups * wheels, measured, rates, timing], -1
    )
    by_wheel = grouped.unflatten(-1, [groups, wheels])  # type: ignore[no-untyped-call]
    always, optional = by_wheel.split_with_sizes([required, groups - required], -2)
    slip, slip_sd, sinkage, sinkage_sd, angle, angle_sd, torque, torque_sd = always.unbind(-2)
    velocity, velocity_sd, pitch, pitch_sd, acceleration, acceleration_sd, bogie = scalars.unbind(
        -1
    )
    step, linked = time.unbind(-1)
    return PackedView(
        packed, slip, slip_sd, sinkage, sinkage_sd, angle, angle_sd, torque, torque_sd,
        _group(optional, 0), _group(optional, 1),
        velocity, velocity_sd, pitch, pitch_sd, acceleration, acceleration_sd, bogie,
        wheel_rate, step, linked,
    )  # fmt: skip


def _group(optional: Tensor, index: int) -> Tensor:
    """Return one of the ``optional`` groups [..., G, W] as [..., W], or [..., 0] beyond them."""
    if index < optional.shape[-2]:
        return optional.select(-2, index)
    return optional.select(-1, 0).narrow(-1, 0, 0)


def replaced(packed: Tensor, first: int, values: Tensor) -> Tensor:
    """Return packed observations [..., P] with ``values`` [..., J] from the place ``first`` on."""
    end = first + values.shape[-1]
    return torch.cat([packed[..., :first], values, packed[..., end:]], -1)


def with_slip(packed: Tensor, slip: Tensor) -> Tensor:
    """Return packed observations [..., P] with another ``slip`` [..., W]."""
    return replaced(packed, 0, slip)


def with_slip_and_sd(packed: Tensor, slip: Tensor, slip_sd: Tensor) -> Tensor:
    """Return packed observations [..., P] with another slip and its deviation, [..., W] each."""
    return replaced(packed, 0, torch.cat([slip, slip_sd], -1))


def with_sinkage(packed: Tensor, sinkage: Tensor) -> Tensor:
    """Return packed observations [..., P] with another ``sinkage`` [..., W] [m]."""
    return replaced(packed, 2 * sinkage.shape[-1], sinkage)


def with_contact_angle(packed: Tensor, angle: Tensor) -> Tensor:
    """Return packed observations [..., P] with another contact ``angle`` [..., W] [rad]."""
    return replaced(packed, 4 * angle.shape[-1], angle)


def with_torque(packed: Tensor, torque: Tensor) -> Tensor:
    """Return packed observations [..., P] with another ``torque`` [..., W] [N m]."""
    return replaced(packed, 6 * torque.shape[-1], torque)


def with_pitch(packed: Tensor, pitch: Tensor, wheels: int, groups: int = GROUPS) -> Tensor:
    """Return packed observations [..., P] with another ``pitch`` [...] [rad]."""
    return replaced(packed, groups * wheels + 2, pitch.unsqueeze(-1))


def with_stand_in(packed: Tensor, usable: Tensor, stand_in: Tensor, groups: int = GROUPS) -> Tensor:
    """Return packed observations [..., P] with stand-in values for unusable wheels.

    ``usable`` is [..., W] bool, ``stand_in`` [8, 1].
    """
    wheels = usable.shape[-1]
    grouped = packed.narrow(-1, 0, groups * wheels)
    values = grouped.unflatten(-1, [groups, wheels])  # type: ignore[no-untyped-call]
    return replaced(packed, 0, torch.where(usable.unsqueeze(-2), values, stand_in).flatten(-2))


def without_link(packed: Tensor, timing: int = TIMING) -> Tensor:
    """Return packed observations [..., P] that cover no time and are not linked."""
    place = packed.shape[-1] - timing
    return torch.cat([packed[..., :place], torch.zeros_like(packed[..., place:])], -1)


LONGEST_GAP = 2.5
"""[steps] A longer time between two observations breaks the link between their velocities."""


def link(stamp_ns: int, last: Observation | None, step_s: float) -> tuple[float, bool]:
    """Return the time since the observation ``last``, and whether its velocity carries over.

    ``last`` is the last one that entered. The time is ``step_s`` where there is none.
    """
    if last is None:
        return step_s, False
    passed_s = (stamp_ns - last.stamp_ns) * 1e-9
    return passed_s, passed_s <= LONGEST_GAP * step_s


def ground_torque(
    observation: Observation, last: Observation | None, inertia: float, passed_s: float
) -> Floats:
    """Return the torque on the ground [axles]: the motor's less I dw/dt (Banerjee et al. eq. 6).

    It is the motor's where ``last`` is None.
    """
    if last is None or inertia == 0.0:
        return observation.torque
    return observation.torque - (observation.wheel_rate - last.wheel_rate) * (inertia / passed_s)


def pack(
    observation: Observation, torque: Floats, step_s: float, *, linked: bool, rates: bool = False
) -> Tensor:
    """Return the observation as a float64 tensor of shape [packed_size(axles, rates=rates)].

    ``torque`` [axles] is the observation's, [N m], less what turns the wheel's own inertia
    (docs/method.md, rows). A model that takes the wheel rates too cannot use a wheel whose rate is
    not known.
    """
    known = (
        np.where(np.isfinite(observation.wheel_rate), observation.slip, np.nan)
        if rates
        else observation.slip
    )
    taken = {"slip": known, "torque": torque}
    groups = (taken.get(name, getattr(observation, name)) for name in PACKED_WHEEL_FIELDS)
    scalars = (
        observation.velocity,
        observation.velocity_sd,
        observation.pitch,
        observation.pitch_sd,
        observation.acceleration,
        observation.acceleration_sd,
        observation.bogie_angle,
        *(observation.wheel_rate.tolist() if rates else ()),
        step_s,
        1.0 if linked else 0.0,
    )
    return torch.from_numpy(np.concatenate((*groups, scalars)))


def pack_measurement(measurement: Measurement) -> Tensor:
    """Return packed observations [batch, time, P] of drives, each linked to the one before."""
    groups = torch.stack([getattr(measurement, name) for name in PACKED_WHEEL_FIELDS], dim=2)
    batch, time = measurement.velocity.shape
    names = (
        "velocity",
        "velocity_sd",
        "pitch",
        "pitch_sd",
        "acceleration",
        "acceleration_sd",
        "bogie_angle",
    )
    scalars = [getattr(measurement, name).expand(batch, time) for name in names]
    step = torch.full((batch, time), TIME_STEP, dtype=torch.float64)
    linked = torch.ones(batch, time, dtype=torch.float64)
    linked[:, 0] = 0.0
    return torch.cat([groups.flatten(2), torch.stack([*scalars, step, linked], dim=2)], dim=2)
