# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The last check of all numbers before they are published, whatever state they come from."""

import math

from terrain_estimator.update import Estimate, Prediction


def unsound(estimate: Estimate, prediction: Prediction) -> str:
    """Return the first number that must not be published; empty where all may be.

    An estimate is finite with a symmetric, positive definite covariance. Probabilities are within
    0 and 1. A valid prediction is finite with a positive variance.
    """
    covariance = estimate.covariance.ravel().tolist()
    for name, values in (
        ("mean", estimate.mean.tolist()),
        ("covariance", covariance),
        ("lower_95", estimate.lower_95.tolist()),
        ("upper_95", estimate.upper_95.tolist()),
        ("time_used", [estimate.time_used_s]),
        ("effect", [number for each in estimate.effects for number in (each.mean, each.sd)]),
        ("fit", [number for each in estimate.fit for number in (each.offset, each.spread)]),
        ("velocity", [prediction.velocity, prediction.variance] if prediction.valid else []),
    ):
        if not all(map(math.isfinite, values)):
            return f"{name} is {', '.join(f'{value:g}' for value in values)}"
    probabilities = (
        *estimate.soil_probability,
        estimate.mass_below_zero,
        estimate.change_probability,
    )
    if not all(0.0 <= each <= 1.0 for each in probabilities):
        return f"a probability is outside 0 to 1: {', '.join(f'{p:g}' for p in probabilities)}"
    cohesion, shared, mirrored, friction = covariance
    if not (
        min(cohesion, friction) > 0.0
        and shared == mirrored
        and abs(shared) < math.sqrt(cohesion) * math.sqrt(friction)
    ):
        numbers = ", ".join(f"{value:g}" for value in covariance)
        return f"covariance is {numbers}, not symmetric and positive definite"
    if prediction.valid and not prediction.variance > 0.0:
        return f"velocity_variance is {prediction.variance:g}"
    return ""
