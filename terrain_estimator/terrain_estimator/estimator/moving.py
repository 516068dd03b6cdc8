# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The refusal of a rover that stands, or of one that drives backwards where the model does not."""

import math

from terrain_estimator.estimator.off_plane import Refusal
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome

_STANDSTILL_BOUND = 3.0
"""[standard deviations] Noise allowed to the velocity of a rover that stands."""


def rims_of(observation: Observation, radius: float) -> list[float]:
    """Return the speeds [m/s] of the rims whose rates are known."""
    return [rate * radius for rate in observation.wheel_rate.tolist() if not math.isnan(rate)]


def refuse_standstill(observation: Observation, rims: list[float], threshold: float) -> Refusal:
    """Refuse a rover that stands.

    The wheels' rims decide, which are exact; the velocity only where no wheel rate is measured. A
    rover that is stuck with its wheels turning (slip near 1) does not stand.
    """
    if rims:
        return (
            (Outcome.STANDSTILL, f"no wheel's rim is faster than {threshold:g} m/s")
            if max(map(abs, rims)) < threshold
            else None
        )
    defined = any(not math.isnan(slip) for slip in observation.slip.tolist())
    noise = observation.velocity_sd if math.isfinite(observation.velocity_sd) else 0.0
    bound = threshold if defined else threshold + _STANDSTILL_BOUND * noise
    if abs(observation.velocity) < bound:
        return (
            Outcome.STANDSTILL,
            f"the velocity {observation.velocity:.4g} m/s is below {bound:.3g} m/s",
        )
    return None


def backwards(observation: Observation, radius: float, threshold: float) -> bool:
    """Return whether a rover that does not stand drives backwards.

    No rim is then faster forward than ``threshold`` [m/s]. The model is of forward driving: its
    thrust would point the wrong way.
    """
    return _backwards(observation, rims_of(observation, radius), threshold)


def _backwards(observation: Observation, rims: list[float], threshold: float) -> bool:
    if rims:
        return max(rims) < threshold
    return observation.velocity < -(threshold + _STANDSTILL_BOUND * observation.velocity_sd)


def refuse_reverse(observation: Observation, rims: list[float], threshold: float) -> Refusal:
    """Refuse a rover that drives backwards, see :func:`backwards`."""
    if not _backwards(observation, rims, threshold):
        return None
    return (
        Outcome.OUT_OF_RANGE,
        (
            "the rover drives backwards, or its wheel rates have the wrong sign: the model is of"
            " forward driving"
        ),
    )
