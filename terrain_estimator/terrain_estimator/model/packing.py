# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One observation as one flat tensor: what the exported model takes.

With A axles the layout is eight groups of A values, then SCALARS scalars (with the A wheel rates
where a model takes them), all SI and float64, NaN for "not measured". One tensor instead of sixteen
keeps the call of the exported model cheap, and its layout is part of the model file.
"""

import numpy as np
import torch
from torch import Tensor

from terrain_estimator.observation import Floats, Observation
from terramechanics.simulation.sensors import Measurement
from terramechanics.simulation.simulation import TIME_STEP

AXLE_FIELDS = (
    "slip",
    "slip_sd",
    "sinkage",
    "sinkage_sd",
    "contact_angle",
    "contact_angle_sd",
    "torque",
    "torque_sd",
)
"""Groups of one value per axle, front to rear; units as in Observation."""

SCALAR_FIELDS = (
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
"""``step`` [s]: time since the observation before. ``linked``: 1 where that one was used and the step is short."""

SCALARS = len(SCALAR_FIELDS)
"""Number of scalars."""

RATES = SCALAR_FIELDS.index("step")
"""Place of the wheel rates among the scalars, for a model that needs them."""


def scalar_fields(axles: int, *, rates: bool) -> tuple[str, ...]:
    """The scalars of a model; with ``rates`` the wheel rates [rad/s] stand before ``step``."""
    turning = tuple(f"wheel_rate_{axle}" for axle in range(axles)) if rates else ()
    return (*SCALAR_FIELDS[:RATES], *turning, *SCALAR_FIELDS[RATES:])


def packed_size(axles: int, *, rates: bool = False) -> int:
    """Length of the packed observation."""
    return len(AXLE_FIELDS) * axles + len(scalar_fields(axles, rates=rates))


LONGEST_GAP = 2.5
"""[steps] A longer time between two observations breaks the link between their velocities."""


def link(stamp_ns: int, last: Observation | None, step_s: float) -> tuple[float, bool]:
    """Time since the observation ``last`` that entered, and whether its velocity carries over; ``step_s`` where there is none."""
    if last is None:
        return step_s, False
    passed_s = (stamp_ns - last.stamp_ns) * 1e-9
    return passed_s, passed_s <= LONGEST_GAP * step_s


def ground_torque(
    observation: Observation, last: Observation | None, inertia: float, passed_s: float
) -> Floats:
    """Torque on the ground [axles]: the motor's less I dw/dt (Banerjee et al. eq. 6); the motor's where ``last`` is None."""
    if last is None or inertia == 0.0:
        return observation.torque
    return observation.torque - (observation.wheel_rate - last.wheel_rate) * (inertia / passed_s)


def pack(
    observation: Observation, torque: Floats, step_s: float, *, linked: bool, rates: bool = False
) -> Tensor:
    """The observation as a float64 tensor of shape [packed_size(axles, rates=rates)].

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
    groups = (taken.get(name, getattr(observation, name)) for name in AXLE_FIELDS)
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
    """Packed observations [batch, time, 8 A + 9] of a batch of drives; every one is linked to the one before."""
    groups = torch.stack([getattr(measurement, name) for name in AXLE_FIELDS], dim=2)
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
