# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One observation as one flat tensor: what the exported model takes.

With A axles the layout is eight groups of A values, then SCALARS scalars, all SI and float64, NaN for "not measured".
One tensor instead of sixteen keeps the call of the exported model cheap, and its layout is part of the model file.
"""

import torch
from torch import Tensor

from terrain_estimator.observation import Floats, Observation

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


def packed_size(axles: int) -> int:
    """Length of the packed observation."""
    return len(AXLE_FIELDS) * axles + SCALARS


def pack(observation: Observation, torque: Floats, step_s: float, *, linked: bool) -> Tensor:
    """The observation as a float64 tensor of shape [packed_size(axles)].

    ``torque`` [axles] is the observation's, [N m], less what turns the wheel's own inertia (docs/method.md, rows).
    """
    groups = (torque if name == "torque" else getattr(observation, name) for name in AXLE_FIELDS)
    values = [value for group in groups for value in group.tolist()]
    values += (
        observation.velocity,
        observation.velocity_sd,
        observation.pitch,
        observation.pitch_sd,
        observation.acceleration,
        observation.acceleration_sd,
        observation.bogie_angle,
        step_s,
        1.0 if linked else 0.0,
    )
    return torch.tensor(values, dtype=torch.float64)
