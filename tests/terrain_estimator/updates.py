# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Updates as the estimator answers them; the numbers are invented."""

import math

import numpy as np

from terrain_estimator.outcome import Outcome
from terrain_estimator.update import (
    Decision,
    Estimate,
    NamedEffect,
    Prediction,
    RowFit,
    Seconds,
    Update,
)

START_NS, STEP_NS = 50_000_000_000, 100_000_000


def update(
    number: int, outcome: Outcome = Outcome.ACCEPTED, change: float = 0.0, innovation: float = 0.01
) -> Update:
    """The answer to observation ``number``, a second of its own.

    c and tan phi get surer with it.
    """
    sd = np.array([2000.0, 0.2]) / math.sqrt(number + 1.0)
    mean = np.array([900.0 + number, 0.6])
    nan = math.nan
    estimate = Estimate(
        mean=mean,
        covariance=np.diag(sd**2),
        lower_95=np.maximum(mean - 1.96 * sd, 0.0),
        upper_95=mean + 1.96 * sd,
        identified=(False, True),
        mass_below_zero=0.0,
        change_probability=change,
        soils=("loose_sand", "regolith"),
        soil_probability=(0.75, 0.25),
        effects=(NamedEffect("drive_drag", "N m s/rad", 0.2, 0.01),),
        observations_used=number + 1,
        observations_waiting=0,
        time_used_s=0.1 * number,
        seconds=Seconds(0, 0),
        fit=(RowFit("velocity", 0.25, 1.5), RowFit("load", -0.5, 0.75)),
    )
    predicted = Prediction(
        outcome.used,
        0.1,
        0.1,
        1e-4,
        0.1,
        innovation if outcome.used else nan,
        1e-4 if outcome.used else nan,
    )
    return Update(
        START_NS + number * STEP_NS,
        number,
        estimate,
        predicted,
        Decision(outcome, (), nan, nan, 0, settled=int(outcome.used)),
        2.0,
    )
