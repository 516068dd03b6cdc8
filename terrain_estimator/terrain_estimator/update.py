# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Results of the estimator for one observation: immutable records without ROS."""

import math
from dataclasses import dataclass, field

from terrain_estimator.observation import Floats
from terrain_estimator.outcome import Outcome


@dataclass(frozen=True, slots=True)
class NamedEffect:
    """An effect that the model estimates in addition to c and tan phi."""

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
    change_probability: float  # [1] of a ground change in the last three seconds of driving
    soils: tuple[str, ...]  # those of the model
    soil_probability: tuple[float, ...]  # [1] of each soil
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
    innovation: float  # [m/s] measured minus the last prediction; NaN without one
    innovation_variance: float  # [m^2/s^2]


NOTHING_PREDICTED = Prediction(False, *[math.nan] * 6)  # noqa: FBT003 - its first field


@dataclass(frozen=True, slots=True)
class Decision:
    """Treatment of the observation, and the reason."""

    outcome: Outcome
    rows_used: tuple[str, ...]
    mahalanobis_squared: float
    threshold: float
    degrees_of_freedom: int
    detail: str = ""  # field and value for which the observation was refused


@dataclass(frozen=True, slots=True)
class Update:
    """All results for one observation."""

    stamp_ns: int
    sequence: int
    estimate: Estimate
    prediction: Prediction
    decision: Decision
    condition_number: float
    warnings: tuple[str, ...] = field(default=())
