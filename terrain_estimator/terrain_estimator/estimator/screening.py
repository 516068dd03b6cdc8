# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The screening of an observation before any of its numbers enters the posterior.

An optional sensor that cannot be used is masked (NaN) and the rest is used; what is refused keeps
its reason. An axle without slip or contact angle costs the whole observation: nobody knows the
load that each of the others carries, and torques alone do not tell the ground. But a contact angle
may be supposed, and where a sinkage is missing, the balances may tell those of all axles, with
torques for what the ground is.
Only what the model cannot take is refused: a threshold inside the model's range, applied to a noisy
value, would bias what is left. So a sinkage that noise makes slightly negative is no sensor error.
"""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.configured import STEEPEST_BOGIE
from terrain_estimator.estimator.moving import refuse_reverse, refuse_standstill, rims_of
from terrain_estimator.estimator.off_plane import (
    DEVIATIONS,
    FASTEST,
    Refusal,
    SingleWheels,
    is_deviation,
    refuse_motion,
    refuse_off_plane,
)
from terrain_estimator.estimator.wheel_faults import faults_of, worst
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import UNDECIDED

# Beyond these limits a sensor is broken or a unit is wrong.
STRONGEST_TORQUE = 1e6  # [N m]
STRONGEST_ACCELERATION = 1e3  # [m/s^2]
_SPIN_BOUND = 2.0
"""[standard deviations] Noise allowed to a slip near 1 where a sinkage is missing."""


class Screening(NamedTuple):
    """The verdict: ACCEPTED, ACCEPTED_PARTIALLY (a sensor is masked), or the reason of refusal."""

    outcome: Outcome
    observation: Observation  # unusable optional sensors are NaN
    detail: str = ""  # names what was masked or refused, and its value


def screen(
    observation: Observation,
    previous_stamp_ns: int | None,
    rover: Rover,
    config: CoreConfig,
    *,
    sinkage_needed: bool = False,
    wheels: SingleWheels | None = None,
) -> Screening:
    """Screen one observation; ``previous_stamp_ns`` is the stamp of the last one, if any.

    ``sinkage_needed`` says that no balance may replace a sinkage. ``wheels`` are those of a
    model by wheel, which may turn and back out; None: the model is by axle.
    """
    rims = rims_of(observation, rover.wheel_radius)
    refusal = (
        _refuse_time(observation.stamp_ns, previous_stamp_ns)
        or refuse_standstill(observation, rims, config.standstill_speed)
        or _refuse_scalars(observation)
    )
    if wheels is None:
        refusal = (
            refusal
            or refuse_reverse(observation, rims, config.standstill_speed)
            or refuse_off_plane(observation, rims, rover, config)
        )
    else:
        refusal = refusal or refuse_motion(observation, wheels)
    if refusal is not None:
        return Screening(refusal[0], observation, refusal[1])
    names = functools.partial(_names, observation, wheels)
    missing = _without_sinkage(observation)
    if missing and sinkage_needed:
        return Screening(Outcome.NOT_FINITE, observation, _named(missing, names()))
    if missing and wheels is not None and (spinning := _spinning(observation, names())):
        return Screening(Outcome.OUT_OF_RANGE, observation, spinning)
    screening = _mask(observation, rims, rover.wheel_radius, config, names)
    if missing and screening.outcome.used and (lacking := _lacking(screening.observation)):
        detail = f"{_named(missing, names())}; to do without it, measure {lacking}"
        return Screening(Outcome.NOT_FINITE, observation, detail)
    return screening


def _names(observation: Observation, wheels: SingleWheels | None) -> list[str]:
    """Return what the values of an array belong to, in words."""
    if wheels is not None:
        return [f"wheel {name}" for name in wheels.names]
    return [f"axle {axle}" for axle in range(len(observation.slip))]


def impossible(observation: Observation, wheel_radius_m: float, *, by_wheel: bool) -> str:
    """Return why no configuration lets these numbers pass as they are; empty where one does."""
    refusal = _refuse_scalars(observation)
    if refusal is not None:
        return refusal[1]
    rims = rims_of(observation, wheel_radius_m)
    config = CoreConfig().of_model(by_wheel=by_wheel)
    names = functools.partial(_names, observation, None)
    screening = _mask(observation, rims, wheel_radius_m, config, names)
    return "" if screening.outcome is Outcome.ACCEPTED else screening.detail


def _refuse_time(stamp_ns: int, previous_stamp_ns: int | None) -> Refusal:
    if previous_stamp_ns is None or stamp_ns > previous_stamp_ns:
        return None
    if stamp_ns == previous_stamp_ns:
        return Outcome.DUPLICATE, f"stamp {stamp_ns / 1e9:.9f} s was used already"
    return (
        Outcome.TIME_BACKWARDS,
        (
            f"stamp {stamp_ns / 1e9:.9f} s is {(previous_stamp_ns - stamp_ns) / 1e9:.9f} s before"
            " the last one"
        ),
    )


def _refuse_scalars(observation: Observation) -> Refusal:
    least, most = DEVIATIONS
    if (
        abs(observation.velocity) <= FASTEST
        and math.isfinite(observation.pitch)
        and least <= observation.velocity_sd <= most
        and least <= observation.pitch_sd <= most
    ):
        return None  # as nearly always: the rest finds the reason
    required = (
        ("velocity", observation.velocity, observation.velocity_sd),
        ("pitch", observation.pitch, observation.pitch_sd),
    )
    for name, value, _ in required:
        if not math.isfinite(value):
            return Outcome.NOT_FINITE, f"{name} is {value}"
    if not abs(observation.velocity) <= FASTEST:
        return (
            Outcome.OUT_OF_RANGE,
            f"velocity {observation.velocity:g} m/s is not within +-{FASTEST:g}",
        )
    for name, _, deviation in required:
        if not is_deviation(deviation):
            return Outcome.BAD_DEVIATION, f"the standard deviation of {name} is {deviation:g}"
    return None


def _mask(
    observation: Observation,
    rims: list[float],
    radius: float,
    config: CoreConfig,
    names: Callable[[], list[str]],
) -> Screening:
    """Mask optional sensors that cannot be used; refuse where an axle cannot."""
    if faults := faults_of(observation, radius, config):
        every = names()
        detail = "; ".join(f"{every[each.wheel]}: {each.detail}" for each in faults)
        return Screening(worst(faults), observation, detail)
    changes: dict[str, Floats | float] = {}
    details = [
        *_mask_rates(observation, rims, radius, changes, names),
        *_mask_optional(observation, changes, names),
    ]
    missing = _without_sinkage(observation)
    if 0 < len(missing) < len(observation.sinkage):
        changes["sinkage"] = np.full_like(observation.sinkage, math.nan)
        every = names()
        where = ", ".join(every[axle] for axle in missing)
        details.append(f"{where}: sinkage is nan: the balances tell that of all")
    masked = observation
    if details:
        masked = dataclasses.replace(observation, **changes)  # type: ignore[arg-type]
    outcome = Outcome.ACCEPTED_PARTIALLY if details else Outcome.ACCEPTED
    return Screening(outcome, masked, "; ".join(details))


def _without_sinkage(observation: Observation) -> list[int]:
    """Return the axles whose sinkage is missing."""
    return [axle for axle, each in enumerate(observation.sinkage.tolist()) if math.isnan(each)]


def _spinning(observation: Observation, names: list[str]) -> str:
    """Name a wheel that may stand still over the ground; empty where none does.

    Near a slip of 1 the law of stresses goes over from one leading edge to the other. Sinkages
    that are found there follow the noise of the slip.
    """
    pairs = zip(names, observation.slip.tolist(), observation.slip_sd.tolist(), strict=True)
    for name, slip, deviation in pairs:
        if abs(1.0 - slip) < UNDECIDED + _SPIN_BOUND * deviation:
            return f"{name}: slip {slip:.3g} is too near to 1 without a sinkage"
    return ""


def _named(missing: list[int], names: list[str]) -> str:
    return "; ".join(f"{names[axle]}: sinkage is nan" for axle in missing)


def _lacking(observation: Observation) -> str:
    """Return what a missing sinkage needs and what is not measured; empty where nothing is.

    The balances are spent on the sinkages, those of a bogie need its angle. One velocity tells
    little of two parameters, so the torques have to be there.
    """
    needed = {
        "the bogie's angle (use_moments)": math.isnan(observation.bogie_angle),
        "the torque of every wheel (use_torque)": bool(np.isnan(observation.torque).any()),
    }
    return " and ".join(name for name, lacks in needed.items() if lacks)


def advised(screening: Screening, config: CoreConfig) -> Screening:
    """Return the screening with what does without a contact angle, where one is missing."""
    lacks = np.isnan(screening.observation.contact_angle).any()
    if screening.outcome is not Outcome.NOT_FINITE or not lacks:
        return screening
    bogie = f"measure the bogie's angle, within +-{STEEPEST_BOGIE:g} rad"
    way = bogie if config.contact_angle_sd else "set contact_angle_sd"
    return screening._replace(detail=f"{screening.detail}; without contact angles, {way}")


def _mask_rates(
    observation: Observation,
    rims: list[float],
    radius: float,
    changes: dict[str, Floats | float],
    names: Callable[[], list[str]],
) -> list[str]:
    """Mask wheel rates that no wheel has, and the torques with them.

    Without the rate the part of the torque that turns the wheel's own inertia is unknown.
    """
    if not rims or max(map(abs, rims)) <= FASTEST:
        return []
    rates = observation.wheel_rate
    absurd = [abs(rate) * radius > FASTEST for rate in rates.tolist()]
    changes["wheel_rate"] = np.where(absurd, np.nan, rates)
    changes["torque"] = np.where(absurd, np.nan, observation.torque)
    every = names()
    return [
        f"{every[axle]}: wheel rate {rates[axle]:g} rad/s: its rim would be faster than"
        f" {FASTEST:g} m/s"
        for axle in np.flatnonzero(absurd)
    ]


def _mask_optional(
    observation: Observation, changes: dict[str, Floats | float], names: Callable[[], list[str]]
) -> list[str]:
    """Mask torque, acceleration and bogie angle that are given but unusable.

    NaN is an absent sensor, and no fault.
    """
    details = []
    least, most = DEVIATIONS
    torque, acceleration, bogie = (
        observation.torque,
        observation.acceleration,
        observation.bogie_angle,
    )
    if not math.isnan(bogie) and not abs(bogie) < STEEPEST_BOGIE:
        changes["bogie_angle"] = math.nan
        details.append(f"bogie angle {bogie:g} rad is not within +-{STEEPEST_BOGIE:g}")
    if not math.isnan(acceleration) and not (
        abs(acceleration) <= STRONGEST_ACCELERATION and is_deviation(observation.acceleration_sd)
    ):
        changes["acceleration"] = math.nan
        details.append(
            f"acceleration {acceleration:g} m/s^2 with standard deviation"
            f" {observation.acceleration_sd:g}"
        )
    pairs = zip(torque.tolist(), observation.torque_sd.tolist(), strict=True)
    faulty = [
        not math.isnan(value)
        and not (abs(value) <= STRONGEST_TORQUE and least <= deviation <= most)
        for value, deviation in pairs
    ]
    if any(faulty):
        changes["torque"] = np.where(faulty, np.nan, changes.get("torque", torque))
        every, words = names(), "{}: torque {:g} N m with standard deviation {:g}"
        details += [
            words.format(every[axle], torque[axle], observation.torque_sd[axle])
            for axle in np.flatnonzero(faulty)
        ]
    return details
