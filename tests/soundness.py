# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Properties of every published number, whatever the inputs."""

import math
from typing import Any

ESTIMATED = ("cohesion", "tan_phi")
FINITE = (
    *(
        f"{name}{suffix}"
        for name in ESTIMATED
        for suffix in ("", "_stddev", "_lower_95", "_upper_95")
    ),
    "mass_below_zero",
    "change_probability",
    "soil_probability",
    "effect_value",
    "effect_stddev",
    "time_used",
    "covariance",
    "fit_offset",
    "fit_spread",
)
PREDICTED = (
    "horizon",
    "velocity",
    "velocity_variance",
    "velocity_lower_95",
    "velocity_upper_95",
    "measured_velocity",
)
MAY_BE_NAN = ("innovation", "innovation_variance")
"""Fields that are NaN where there was no prediction before."""


def unsound(message: Any) -> list[str]:
    """Return the faults of a terrain_estimate or motion_prediction; empty where it is sound.

    The message is of rclpy's classes or of the bags'.
    """
    return _of_estimate(message) if hasattr(message, "covariance") else _of_prediction(message)


def _of_estimate(message: Any) -> list[str]:
    found = [
        f"{name} is {getattr(message, name)}"
        for name in FINITE
        if not _finite(getattr(message, name))
    ]
    cc, ct, tc, tt = (float(value) for value in message.covariance)
    if ct != tc:
        found.append(f"covariance is not symmetric: {ct!r} and {tc!r}")
    if not (cc > 0.0 and tt > 0.0 and abs(ct) < math.sqrt(cc) * math.sqrt(tt)):
        found.append(f"covariance is not positive definite: {[cc, ct, tc, tt]}")
    for name in ESTIMATED:
        low, high = getattr(message, f"{name}_lower_95"), getattr(message, f"{name}_upper_95")
        if not 0.0 <= low <= high:
            found.append(f"the interval of {name} is {low} to {high}")
    probabilities = [message.mass_below_zero, message.change_probability, *message.soil_probability]
    if (
        not all(0.0 <= value <= 1.0 for value in probabilities)
        or abs(sum(message.soil_probability) - 1.0) > 1e-9
    ):
        found.append(f"probabilities are {probabilities}")
    if any(
        math.isinf(value)
        for value in (message.decision.mahalanobis_squared, message.decision.threshold)
    ):
        found.append(f"the decision's distance or threshold is infinite: {message.decision}")
    return found


def _of_prediction(message: Any) -> list[str]:
    found = [
        f"{name} is {getattr(message, name)}"
        for name in (*PREDICTED, *MAY_BE_NAN)
        if math.isinf(getattr(message, name))
    ]
    if message.valid:
        found += [
            f"{name} is {getattr(message, name)}"
            for name in PREDICTED
            if math.isnan(getattr(message, name))
        ]
        if not message.velocity_variance > 0.0:
            found.append(f"velocity_variance is {message.velocity_variance}")
    return found


def _finite(value: Any) -> bool:
    return (
        all(math.isfinite(each) for each in value)
        if hasattr(value, "__len__")
        else math.isfinite(value)
    )
