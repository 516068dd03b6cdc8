# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Results of the estimator for one observation: immutable records without ROS."""

import math
from typing import NamedTuple

from terrain_estimator.observation import Floats
from terrain_estimator.outcome import Outcome


class NamedEffect(NamedTuple):
    """An effect that the model estimates in addition to c and tan phi."""

    name: str
    unit: str
    mean: float
    sd: float


class Seconds(NamedTuple):
    """Closed seconds of driving: all that are judged, and those that entered the posterior."""

    judged: int
    taken: int


class RowFit(NamedTuple):
    """How a regression row missed the model's prediction in the last seconds of driving.

    In predicted standard deviations of the row beside the others. Where the model is right the
    offset is near 0 and the spread near 1.
    """

    row: str
    offset: float  # [1] mean
    spread: float  # [1] root mean square about it


class Disagreement(NamedTuple):
    """One reason why the model does not fit this rover or ground."""

    finding: str  # in words, the model first
    advice: str


class Estimate(NamedTuple):
    """Marginal posterior of (c, tan phi), units Pa and 1."""

    mean: Floats  # [2] c [Pa], tan phi [1]
    covariance: Floats  # [2, 2] marginal, Pa^2, Pa, 1
    lower_95: Floats  # [2] never below zero
    upper_95: Floats  # [2]
    identified: tuple[bool, bool]  # by the data, whose fit confirms the model
    mass_below_zero: float
    change_probability: float  # [1] of a ground change in the last three seconds of driving
    soils: tuple[str, ...]  # those of the model
    soil_probability: tuple[float, ...]  # [1] of each soil
    effects: tuple[NamedEffect, ...]
    observations_used: int  # of the seconds that entered the posterior
    observations_waiting: int  # of the open second
    time_used_s: float
    seconds: Seconds  # the last ones
    fit: tuple[RowFit, ...] = ()  # of the rows that at least ten of the last seconds had


class Prediction(NamedTuple):
    """Posterior predictive of the next measured velocity along body x."""

    valid: bool
    horizon_s: float
    velocity: float  # [m/s]
    variance: float  # [m^2/s^2] measurement noise included
    measured: float  # [m/s] this observation's velocity
    innovation: float  # [m/s] measured minus the last prediction; NaN without one
    innovation_variance: float  # [m^2/s^2]


NOTHING_PREDICTED = Prediction(False, *[math.nan] * 6)  # noqa: FBT003 - its first field


class Decision(NamedTuple):
    """Treatment of the observation, and the reason.

    An accepted observation waits until its second ends, and then enters the posterior with it or is
    left out with it. The observation that ends a second settles those that waited: they share its
    fate.
    """

    outcome: Outcome
    rows_used: tuple[str, ...]
    mahalanobis_squared: float
    threshold: float
    degrees_of_freedom: int
    detail: str = ""  # field and value for which the observation was refused
    settled: int = 0  # accepted observations, with this one where it is one of them


class Update(NamedTuple):
    """All results for one observation.

    With a disagreement the estimate is the prior's, and the prediction that the velocity stays.
    """

    stamp_ns: int
    sequence: int
    estimate: Estimate
    prediction: Prediction
    decision: Decision
    condition_number: float
    disagreements: tuple[Disagreement, ...] = ()
    unconfirmed: str = ""  # why an estimate that is sharp enough is not called identified
    warnings: tuple[str, ...] = ()
