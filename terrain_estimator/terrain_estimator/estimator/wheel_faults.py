# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The faults of a wheel's slip, sinkage and contact angle that cost the whole observation."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.off_plane import DEVIATIONS, is_deviation
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome

NOISE_BOUND = 4.0
"""[standard deviations] Reach of noise; a value further outside its range is a sensor error."""

# Beyond these limits a sensor is broken or a unit is wrong.
_PERCENTAGE = 2.0  # [1] a slip beyond it, either way, is hardly a ratio
_OTHER_UNIT = 3.0  # [wheel radii] a sinkage beyond it is hardly in metres
_STEEPEST_GROUND = math.pi / 2.0  # [rad]


class Fault(NamedTuple):
    """A wheel that cannot be used."""

    wheel: int  # its number
    outcome: Outcome
    detail: str


def faults_of(observation: Observation, radius: float, config: CoreConfig) -> list[Fault]:
    """Return the numbers of the wheels that cannot be used, and why."""
    if _are_usable(observation, radius, config):
        return []
    return [
        Fault(number, *fault)
        for number, wheel in enumerate(_wheels(observation))
        if (fault := _wheel_fault(wheel, radius, config))
    ]


def worst(faults: Sequence[Fault]) -> Outcome:
    """Return one outcome for wheels that failed.

    It is the range where any wheel had usable numbers, else the first reason.
    """
    outcomes = [each.outcome for each in faults]
    return Outcome.OUT_OF_RANGE if Outcome.OUT_OF_RANGE in outcomes else outcomes[0]


def _wheels(observation: Observation) -> Iterable[tuple[float, ...]]:
    """Yield per axle: slip, its deviation, sinkage, its deviation, contact angle, its deviation."""
    return zip(
        observation.slip.tolist(),
        observation.slip_sd.tolist(),
        observation.sinkage.tolist(),
        observation.sinkage_sd.tolist(),
        observation.contact_angle.tolist(),
        observation.contact_angle_sd.tolist(),
        strict=True,
    )


def _are_usable(observation: Observation, radius: float, config: CoreConfig) -> bool:
    """Return whether :func:`_wheel_fault` finds none: one expression for what nearly all are."""
    least, most = DEVIATIONS
    lowest, highest = config.slip_minimum, config.slip_maximum
    for slip, slip_sd, sinkage, sinkage_sd, angle, angle_sd in _wheels(observation):
        if not (
            lowest <= slip < highest
            and 0.0 < sinkage < radius
            and -_STEEPEST_GROUND < angle < _STEEPEST_GROUND
            and least <= slip_sd <= most
            and least <= sinkage_sd <= most
            and least <= angle_sd <= most
        ):
            return False
    return True


def _wheel_fault(
    wheel: tuple[float, ...], radius: float, config: CoreConfig
) -> tuple[Outcome, str] | None:
    """Return the reason why one wheel cannot be used; None where it can."""
    slip, slip_sd, sinkage, sinkage_sd, angle, angle_sd = wheel
    if math.isnan(sinkage):
        sinkage, sinkage_sd = 0.01 * radius, radius  # of no consequence: the balances tell it
    if not (math.isfinite(slip) and math.isfinite(sinkage) and math.isfinite(angle)):
        name, value = _first(lambda each: not math.isfinite(each), slip, sinkage, angle)
        return Outcome.NOT_FINITE, f"{name} is {value}"
    if not (is_deviation(slip_sd) and is_deviation(sinkage_sd) and is_deviation(angle_sd)):
        name, value = _first(lambda each: not is_deviation(each), slip_sd, sinkage_sd, angle_sd)
        return Outcome.BAD_DEVIATION, f"the standard deviation of {name} is {value:g}"
    if not config.slip_minimum <= slip < config.slip_maximum:
        return (
            Outcome.OUT_OF_RANGE,
            f"slip {slip:.3g} is outside {config.slip_minimum:g} to {config.slip_maximum:g}"
            + (", a percentage?" if abs(slip) > _PERCENTAGE else ""),
        )
    if not abs(angle) < _STEEPEST_GROUND:
        return (
            Outcome.OUT_OF_RANGE,
            f"contact angle {angle:.3g} rad is not within +-{_STEEPEST_GROUND:.3g}",
        )
    return (
        None
        if 0.0 < sinkage < radius
        else (Outcome.OUT_OF_RANGE, _sinkage_fault(sinkage, sinkage_sd, radius))
    )


def _first(
    wrong: Callable[[float], bool], slip: float, sinkage: float, angle: float
) -> tuple[str, float]:
    """Return the first of a wheel's numbers that is wrong, with its name."""
    named = {"slip": slip, "sinkage": sinkage, "contact angle": angle}
    return next((name, value) for name, value in named.items() if wrong(value))


def _sinkage_fault(sinkage: float, deviation: float, radius: float) -> str:
    if sinkage >= radius:
        unit = ", in mm or cm?" if sinkage > _OTHER_UNIT * radius else ""
        return f"sinkage {sinkage:.3g} m is not below the wheel radius {radius:g} m{unit}"
    explained = "within its noise" if sinkage > -NOISE_BOUND * deviation else "a sensor error"
    return f"sinkage {sinkage:.3g} m is not above zero, {explained}"
