# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The named view of packed observations, as tensors.

No other module knows a place in the layout of ``packed_observation``: :func:`view_of` names the
parts, and the functions below it replace them.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from terrain_estimator.model.packed_observation import (
    BY_WHEEL,
    GROUPS,
    MEASURED,
    PACKED_WHEEL_FIELDS,
    TIMING,
)
from terramechanics.simulation.sample import TIME_STEP, Measurement


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


def with_sinkage_and_sd(packed: Tensor, sinkage: Tensor, sinkage_sd: Tensor) -> Tensor:
    """Return packed observations [..., P] with another sinkage and its deviation, [..., W] each."""
    return replaced(packed, 2 * sinkage.shape[-1], torch.cat([sinkage, sinkage_sd], -1))


def with_contact_angle(packed: Tensor, angle: Tensor) -> Tensor:
    """Return packed observations [..., P] with another contact ``angle`` [..., W] [rad]."""
    return replaced(packed, 4 * angle.shape[-1], angle)


def with_torque(packed: Tensor, torque: Tensor) -> Tensor:
    """Return packed observations [..., P] with another ``torque`` [..., W] [N m]."""
    return replaced(packed, 6 * torque.shape[-1], torque)


def with_torque_and_sd(packed: Tensor, torque: Tensor, torque_sd: Tensor) -> Tensor:
    """Return packed observations [..., P] with another torque and its deviation, [..., W] each."""
    return replaced(packed, 6 * torque.shape[-1], torch.cat([torque, torque_sd], -1))


def with_acceleration(
    packed: Tensor, acceleration: Tensor, wheels: int, groups: int = GROUPS
) -> Tensor:
    """Return packed observations [..., P] with another ``acceleration`` [...] [m/s^2]."""
    return replaced(packed, groups * wheels + 4, acceleration.unsqueeze(-1))


def with_acceleration_and_sd(
    packed: Tensor, acceleration: Tensor, acceleration_sd: Tensor, wheels: int
) -> Tensor:
    """Return packed observations [..., P] with another acceleration and its deviation, [...]."""
    values = torch.stack([acceleration, acceleration_sd], -1)
    return replaced(packed, GROUPS * wheels + 4, values)


def with_bogie_angle(packed: Tensor, angle: Tensor, wheels: int) -> Tensor:
    """Return packed observations [..., P] with another bogie ``angle`` [...] [rad]."""
    return replaced(packed, GROUPS * wheels + 6, angle.unsqueeze(-1))


def with_body_motion(
    packed: Tensor, lateral: Tensor, yaw_rate: Tensor, behind: int = len(BY_WHEEL) + TIMING
) -> Tensor:
    """Return observations [..., P] of a model by wheel with another lateral velocity and yaw rate.

    Both are [...], in m/s and rad/s.
    """
    first = packed.shape[-1] - behind
    moved = replaced(packed, first, lateral.unsqueeze(-1))
    return replaced(moved, first + 2, yaw_rate.unsqueeze(-1))


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
