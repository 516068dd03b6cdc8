# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The last check of all numbers before they are published, whatever state they come from."""

import math

from terrain_estimator.update import Estimate, Prediction, RowFit


def unsound(estimate: Estimate) -> str:
    """Return the first number of the ground that must not be published; empty where all may be.

    An estimate is finite with a symmetric, positive definite covariance. Probabilities are within
    0 and 1.
    """
    covariance = estimate.covariance.ravel().tolist()
    infinite = _infinite(
        ("mean", estimate.mean.tolist()),
        ("covariance", covariance),
        ("lower_95", estimate.lower_95.tolist()),
        ("upper_95", estimate.upper_95.tolist()),
        ("effect", [number for each in estimate.effects for number in (each.mean, each.sd)]),
    )
    if reason := infinite or _improbable(*estimate.soil_probability, estimate.mass_below_zero):
        return reason
    cohesion, shared, mirrored, friction = covariance
    if not (
        min(cohesion, friction) > 0.0
        and shared == mirrored
        and abs(shared) < math.sqrt(cohesion) * math.sqrt(friction)
    ):
        numbers = ", ".join(f"{value:g}" for value in covariance)
        return f"covariance is {numbers}, not symmetric and positive definite"
    return ""


def unsound_answer(estimate: Estimate, prediction: Prediction) -> str:
    """Return the same for what changes with every observation.

    A valid prediction is finite with a positive variance.
    """
    if not math.isfinite(estimate.time_used_s):
        return _infinite(("time_used", [estimate.time_used_s]))
    if prediction.valid:
        velocity, variance = prediction.velocity, prediction.variance
        if not (math.isfinite(velocity) and math.isfinite(variance)):
            return _infinite(("velocity", [velocity, variance]))
        if not variance > 0.0:
            return f"velocity_variance is {variance:g}"
    change = estimate.change_probability
    return "" if 0.0 <= change <= 1.0 else _improbable(change)


def unsound_fit(fit: tuple[RowFit, ...]) -> str:
    """Return the same for how the rows missed, which changes where a second ends."""
    return _infinite(("fit", [number for each in fit for number in (each.offset, each.spread)]))


def _infinite(*named: tuple[str, list[float]]) -> str:
    for name, values in named:
        if not all(map(math.isfinite, values)):
            return f"{name} is {', '.join(f'{value:g}' for value in values)}"
    return ""


def _improbable(*probabilities: float) -> str:
    if all(0.0 <= each <= 1.0 for each in probabilities):
        return ""
    return f"a probability is outside 0 to 1: {', '.join(f'{p:g}' for p in probabilities)}"
