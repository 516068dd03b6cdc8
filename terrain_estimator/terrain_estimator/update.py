# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the estimator answers to one observation: immutable records, no ROS in them."""

import math
from dataclasses import dataclass, field

from terrain_estimator.observation import Floats
from terrain_estimator.outcome import Outcome


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """An effect beside c and tan phi, estimated by the model."""

    name: str
    unit: str
    mean: float
    sd: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """Marginal posterior of (c, tan phi), units Pa and 1."""

    mean: Floats  # [2] c [Pa], tan phi [1]
    covariance: Floats  # [2, 2] marginal, Pa^2, Pa, 1
    lower_95: Floats  # [2] never below zero
    upper_95: Floats  # [2]
    identified: tuple[bool, bool]
    mass_below_zero: float
    change_probability: (
        float  # [1] that the ground changed within the last three seconds of driving
    )
    soils: tuple[str, ...]  # that the model knows
    soil_probability: tuple[float, ...]  # [1] that the ground is of each
    effects: tuple[NamedEffect, ...]
    observations_used: int
    time_used_s: float


@dataclass(frozen=True, slots=True)
class Prediction:
    """Posterior predictive of the next measured velocity along body x."""

    valid: bool
    horizon_s: float
    velocity: float  # [m/s]
    variance: float  # [m^2/s^2] measurement noise included
    measured: float  # [m/s] this observation's velocity
    innovation: float  # [m/s] measured minus the last prediction, NaN where there was none
    innovation_variance: float  # [m^2/s^2]


NOTHING_PREDICTED = Prediction(False, *[math.nan] * 6)  # noqa: FBT003 - its first field


@dataclass(frozen=True, slots=True)
class Decision:
    """What was done with the observation, and why."""

    outcome: Outcome
    rows_used: tuple[str, ...]
    mahalanobis_squared: float
    threshold: float
    degrees_of_freedom: int
    detail: str = ""  # names the field and the value, where the observation was refused


@dataclass(frozen=True, slots=True)
class Update:
    """Everything that follows from one observation."""

    stamp_ns: int
    sequence: int
    estimate: Estimate
    prediction: Prediction
    decision: Decision
    condition_number: float
    warnings: tuple[str, ...] = field(default=())
