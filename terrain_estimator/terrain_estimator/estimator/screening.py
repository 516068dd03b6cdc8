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
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.off_plane import (
    DEVIATIONS,
    FASTEST,
    Refusal,
    SingleWheels,
    refuse_motion,
    refuse_off_plane,
)
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import UNDECIDED, wheel_order

NOISE_BOUND = 4.0
"""[standard deviations] Reach of noise; a value further outside its range is a sensor error."""

# Beyond these limits a sensor is broken or a unit is wrong.
STRONGEST_TORQUE = 1e6  # [N m]
STRONGEST_ACCELERATION = 1e3  # [m/s^2]
_PERCENTAGE = 2.0  # [1] a slip beyond it, either way, is hardly a ratio
_OTHER_UNIT = 3.0  # [wheel radii] a sinkage beyond it is hardly in metres
_STEEPEST_GROUND = math.pi / 2.0  # [rad]
_STEEPEST_BOGIE = 1.2  # [rad] no bogie turns further: an encoder in degrees, or without its zero
_SPIN_BOUND = 2.0
"""[standard deviations] Noise allowed to a slip near 1 where a sinkage is missing."""
_STANDSTILL_BOUND = (
    3.0  # [standard deviations] noise allowed to the velocity of a rover that stands
)


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
    rims, names = _rims(observation, rover.wheel_radius), _names(observation, wheels)
    refusal = (
        _refuse_time(observation.stamp_ns, previous_stamp_ns)
        or _refuse_standstill(observation, rims, config.standstill_speed)
        or _refuse_scalars(observation)
    )
    if wheels is None:
        refusal = (
            refusal
            or _refuse_reverse(observation, rims, config.standstill_speed)
            or refuse_off_plane(observation, rims, rover, config)
        )
    else:
        refusal = refusal or refuse_motion(observation, wheels)
    if refusal is not None:
        return Screening(refusal[0], observation, refusal[1])
    missing = _without_sinkage(observation)
    if missing and sinkage_needed:
        return Screening(Outcome.NOT_FINITE, observation, _named(missing, names))
    if missing and wheels is not None and (spinning := _spinning(observation, names)):
        return Screening(Outcome.OUT_OF_RANGE, observation, spinning)
    screening = _mask(observation, rims, rover.wheel_radius, config, names)
    if missing and screening.outcome.used and (lacking := _lacking(screening.observation)):
        detail = f"{_named(missing, names)}; to do without it, measure {lacking}"
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
    rims = _rims(observation, wheel_radius_m)
    config = CoreConfig().of_model(by_wheel=by_wheel)
    screening = _mask(observation, rims, wheel_radius_m, config, _names(observation, None))
    return "" if screening.outcome is Outcome.ACCEPTED else screening.detail


def _rims(observation: Observation, radius: float) -> list[float]:
    """Return the speeds [m/s] of the rims whose rates are known."""
    return [rate * radius for rate in observation.wheel_rate.tolist() if not math.isnan(rate)]


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


def _refuse_standstill(observation: Observation, rims: list[float], threshold: float) -> Refusal:
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
    return _backwards(observation, _rims(observation, radius), threshold)


def _backwards(observation: Observation, rims: list[float], threshold: float) -> bool:
    if rims:
        return max(rims) < threshold
    return observation.velocity < -(threshold + _STANDSTILL_BOUND * observation.velocity_sd)


def _refuse_reverse(observation: Observation, rims: list[float], threshold: float) -> Refusal:
    if not _backwards(observation, rims, threshold):
        return None
    return (
        Outcome.OUT_OF_RANGE,
        (
            "the rover drives backwards, or its wheel rates have the wrong sign: the model is of"
            " forward driving"
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
        if not _is_deviation(deviation):
            return Outcome.BAD_DEVIATION, f"the standard deviation of {name} is {deviation:g}"
    return None


def _is_deviation(value: float) -> bool:
    return DEVIATIONS[0] <= value <= DEVIATIONS[1]


def _mask(
    observation: Observation,
    rims: list[float],
    radius: float,
    config: CoreConfig,
    names: list[str],
) -> Screening:
    """Mask optional sensors that cannot be used; refuse where an axle cannot."""
    if not _are_usable(observation, radius, config):
        faults = [
            (axle, fault)
            for axle, wheel in enumerate(_wheels(observation))
            if (fault := _wheel_fault(wheel, radius, config))
        ]
        if faults:
            return Screening(
                _worst(fault[0] for _, fault in faults),
                observation,
                "; ".join(f"{names[axle]}: {fault[1]}" for axle, fault in faults),
            )
    changes: dict[str, Floats | float] = {}
    details = [
        *_mask_rates(observation, rims, radius, changes, names),
        *_mask_optional(observation, changes, names),
    ]
    missing = _without_sinkage(observation)
    if 0 < len(missing) < len(observation.sinkage):
        changes["sinkage"] = np.full_like(observation.sinkage, math.nan)
        where = ", ".join(names[axle] for axle in missing)
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


def as_configured(observation: Observation, rover: Rover, config: CoreConfig) -> Observation:
    """Return the observation with the sensors that ``config`` uses.

    Those that it switches off are NaN, and missing contact angles are what it supposes.
    """
    changes: dict[str, Floats | float] = {}
    if config.contact_angle_sd and np.isnan(observation.contact_angle).any():
        changes |= _supposed_angles(observation, rover, config.contact_angle_sd)
    if not config.use_sinkage:
        changes["sinkage"] = np.full_like(observation.sinkage, np.nan)
    if not config.use_torque:
        changes["torque"] = np.full_like(observation.torque, np.nan)
    if not config.use_imu:
        changes["acceleration"] = math.nan
    if not config.use_moments:
        changes["bogie_angle"] = math.nan
    if not changes:
        return observation
    return dataclasses.replace(observation, **changes)  # type: ignore[arg-type]


def _supposed_angles(observation: Observation, rover: Rover, deviation: float) -> dict[str, Floats]:
    """Return contact angles in which missing ones are along the body, or along the wheel's bogie.

    A bogie whose angle is not known leaves those of its wheels missing.
    """
    plane, bogie = np.zeros_like(observation.contact_angle), possible_bogie(observation)
    axles: Sequence[int] = range(rover.axles)
    if len(plane) > rover.axles:  # of a model by wheel
        axles = [rover.wheels[k].axle for k in wheel_order(rover)]
    for joint in rover.suspension:
        plane[[axle in joint.axles for axle in axles]] = bogie
    missing = np.isnan(observation.contact_angle)
    return {
        "contact_angle": np.where(missing, plane, observation.contact_angle),
        "contact_angle_sd": np.where(missing, deviation, observation.contact_angle_sd),
    }


def possible_bogie(observation: Observation) -> float:
    """Return the angle [rad] of the bogie, NaN where no bogie has such a one."""
    return observation.bogie_angle if abs(observation.bogie_angle) < _STEEPEST_BOGIE else math.nan


def advised(screening: Screening, config: CoreConfig) -> Screening:
    """Return the screening with what does without a contact angle, where one is missing."""
    lacks = np.isnan(screening.observation.contact_angle).any()
    if screening.outcome is not Outcome.NOT_FINITE or not lacks:
        return screening
    bogie = f"measure the bogie's angle, within +-{_STEEPEST_BOGIE:g} rad"
    way = bogie if config.contact_angle_sd else "set contact_angle_sd"
    return screening._replace(detail=f"{screening.detail}; without contact angles, {way}")


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
    return all(
        lowest <= slip < highest
        and 0.0 < sinkage < radius
        and -_STEEPEST_GROUND < angle < _STEEPEST_GROUND
        and least <= slip_sd <= most
        and least <= sinkage_sd <= most
        and least <= angle_sd <= most
        for slip, slip_sd, sinkage, sinkage_sd, angle, angle_sd in _wheels(observation)
    )


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
    if not (_is_deviation(slip_sd) and _is_deviation(sinkage_sd) and _is_deviation(angle_sd)):
        name, value = _first(lambda each: not _is_deviation(each), slip_sd, sinkage_sd, angle_sd)
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


def _mask_rates(
    observation: Observation,
    rims: list[float],
    radius: float,
    changes: dict[str, Floats | float],
    names: list[str],
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
    return [
        f"{names[axle]}: wheel rate {rates[axle]:g} rad/s: its rim would be faster than"
        f" {FASTEST:g} m/s"
        for axle in np.flatnonzero(absurd)
    ]


def _mask_optional(
    observation: Observation, changes: dict[str, Floats | float], names: list[str]
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
    if not math.isnan(bogie) and not abs(bogie) < _STEEPEST_BOGIE:
        changes["bogie_angle"] = math.nan
        details.append(f"bogie angle {bogie:g} rad is not within +-{_STEEPEST_BOGIE:g}")
    if not math.isnan(acceleration) and not (
        abs(acceleration) <= STRONGEST_ACCELERATION and _is_deviation(observation.acceleration_sd)
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
        words = "{}: torque {:g} N m with standard deviation {:g}"
        details += [
            words.format(names[axle], torque[axle], observation.torque_sd[axle])
            for axle in np.flatnonzero(faulty)
        ]
    return details


def _worst(outcomes: Iterable[Outcome]) -> Outcome:
    """Return one outcome for wheels that failed.

    It is the range where any wheel had usable numbers, else the first reason.
    """
    all_outcomes = list(outcomes)
    return Outcome.OUT_OF_RANGE if Outcome.OUT_OF_RANGE in all_outcomes else all_outcomes[0]
