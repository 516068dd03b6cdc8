# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The judgement of a saved state as numbers: could an estimator of this model have left it?

A sha256 shows that a state is as it was written, not that its numbers are sound. Names, types and
shapes are compared with a state of the model at its start, and every number with its range. What
follows from the bank of hypotheses (weights, mixture, moments, soil constants) is computed anew by
the model and compared.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.distributions import log_normal_cdf
from terrain_estimator.estimator.consistency import DELAY, REACH, WINDOWS, Consistency
from terrain_estimator.estimator.crossing import KNOWN, REST, SETTLED, Crossing
from terrain_estimator.estimator.forecasting import (
    LARGEST_DISTANCE,
    Forecast,
    Forecasting,
    Hindsight,
)
from terrain_estimator.estimator.intake import LONELY, WINDOW, ClosedSecond, Intake
from terrain_estimator.estimator.off_plane import FASTEST
from terrain_estimator.estimator.persistence import MEMORY, Persistence
from terrain_estimator.estimator.saved_state import Arrays, StateFileError
from terrain_estimator.estimator.screening import STRONGEST_TORQUE, impossible
from terrain_estimator.model.packed_observation import LONGEST_GAP, unpacked
from terrain_estimator.observation import AXLE_FIELDS, Floats, Observation

State = dict[str, NDArray[Any]]
ADVICE = "start without it, from the prior"
FARTHEST = 100.0
"""[prior standard deviations] Reach of the posteriors; those of hostile drives reach 6."""
_GIVEN = ("prior_mean", "prior_sd", "random_walk", "log_soils")
"""Parts that follow from the parameters prior.* and forgetting_time."""
_DERIVED = (
    "weight",
    "soils",
    "strength_covariance",
    "strength_mean",
    "covariance",
    "expected",
    "expansion",
    "constants",
    "varied",
    "log_weight",
)
"""Parts that follow from the bank; a covariance stands before the mean that it scales."""
_BANK = frozenset({"mean", "precision", "log_weight", "weight", "age", "kind"})
"""Parts with a row for each hypothesis."""
_SCALED_BY = {"strength_mean": "strength_covariance", "expected": "covariance"}
_MAY_BE_NAN = frozenset(
    {"acceleration", "forecast", "forecast_variance", "innovation", "innovation_variance"}
    | {"misfit", "degrees", "single_misses", "white_misses"}
)
_LARGEST = 1e30
"""[SI] Larger numbers come from no observation, and their squares overflow."""
_SMALLEST_VARIANCE = 1e-60
_OLDEST = 1e12  # [blocks] hypotheses of the start of a drive begin at 1e9
_PROBABILITY = (0.0, 1.0 + 1e-9)
_RANGES = {
    "velocity": (-1e6, 1e6),
    "velocity_variance": (_SMALLEST_VARIANCE, _LARGEST),
    "acceleration_variance": (0.0, _LARGEST),
    "feature_noise": (0.0, _LARGEST),
    "change": (0.0, _LARGEST),
    "change_weight": _PROBABILITY,
    "closed": _PROBABILITY,
    "changed": _PROBABILITY,
    "age": (0.0, _OLDEST),
}
_LEAST_MASS = math.log(1e-300)
_AGREEMENT = 1e-4
"""[1] Largest difference of a derived number, where honest ones differ by 1e-8."""
_SPUN = 1e13  # [N m] torque on the ground, where two wheel rates a nanosecond apart differ
_LATEST = (2**31 - 1) * 10**9
MOST_DEGREES = 1000
"""Of freedom of one second: a limit for what is read."""
_COUNTS = (
    ("stamp", -1, _LATEST),
    ("used", 0, 2**53),
    ("waiting", 0, 2**53),
    ("contradictions", 0, 10**6),
    ("moving_stamp", -1, _LATEST),
    ("alone", 0, LONELY - 1),
)
_NUMBERS = (
    ("time_used", 0.0, 1e12),
    ("time_waiting", 0.0, 1e12),
    ("change", 0.0, 1.0),
    ("doubt", 0.0, 1.0),
    ("forecast", -_LARGEST, _LARGEST),
    ("forecast_variance", 0.0, _LARGEST),
    ("forecast_noise", 0.0, _LARGEST),
    ("forecast_of_model", -_LARGEST, _LARGEST),
    ("forecast_variance_of_model", 0.0, _LARGEST),
    ("forecast_noise_of_model", 0.0, _LARGEST),
    ("moving_velocity", -FASTEST, FASTEST),
    ("moving_square", 0.0, 4.0 * FASTEST**2),
    ("moving_weight", 0.0, 1.0),
    ("past_distance", 0.0, LARGEST_DISTANCE / MEMORY),
    ("past_square", 0.0, _LARGEST),
    ("past_change", 0.0, 4.0 * FASTEST**2 / MEMORY),
    ("past_weight", 0.0, 1.0 / MEMORY),
    ("way", 0.0, SETTLED),
    ("same_way", 0.0, KNOWN),
)
"""The arrays ``counts`` and ``numbers``: name, least and largest value of each."""


class EstimatorParts(NamedTuple):
    """The parts of an estimator with which a state is compared."""

    start: State  # at the start, with the estimator's own prior
    default: State  # at the start, with the model's prior
    publish: Callable[[State, State], State]  # the model's: the state with all that a bank implies
    rows: tuple[str, ...]
    axles: int  # or wheels
    by_wheel: bool
    wheel_radius_m: float
    block: int  # observations in a full block
    step_s: float


class Counts(NamedTuple):
    """What an estimator keeps beside the model's state."""

    stamp_ns: int | None  # of the last observation that came
    contradictions: int
    change: float
    doubt: float
    forecasting: Forecasting
    intake: Intake
    consistency: Consistency


class Restored(NamedTuple):
    """A saved state that passed."""

    state: State
    last: Observation | None
    counts: Counts


def judged(arrays: Arrays, parts: EstimatorParts) -> Restored:
    """Return a saved state.

    Raises:
        StateFileError: it is none of this model and prior; the message names the field and its
            value.
    """
    state = _shaped(arrays, parts)
    counts = _counted(arrays, parts.rows, parts.block)
    if counts.intake.waiting != len(state["block"]):
        reason = f"but the open block has {len(state['block'])} observations"
        raise _refused("waiting", counts.intake.waiting, reason)
    for name, values in state.items():
        if name not in {"block", "usable"}:
            _check_range(name, values, parts)
    _check_block(state["block"], parts)
    if not all(np.array_equal(state[name], parts.start[name]) for name in _GIVEN):
        raise StateFileError(
            "the state was learnt from another prior: give prior.* and forgetting_time as they"
            " were, or start without it"
        )
    _check_derived(state, parts.publish(state, _bank(state, parts)))
    return Restored(state, _last(arrays, parts), counts)


def _refused(name: str, value: object, reason: str) -> StateFileError:
    return StateFileError(f"the state's {name} is {value}, {reason}: {ADVICE}")


def _shaped(arrays: Arrays, parts: EstimatorParts) -> State:
    """Return the tensors of the state, with the types and shapes of the model's."""
    state: State = {}
    hypotheses = int(arrays["state.age"].size) if "state.age" in arrays else 0
    for name, own in parts.start.items():
        saved = arrays.get(f"state.{name}")
        shape = own.shape
        if name in _BANK:
            shape = (hypotheses, *own.shape[1:])
        elif name == "block" and saved is not None:
            shape = (*saved.shape[:1], *own.shape[1:])
        if saved is None or (saved.dtype, saved.shape) != (own.dtype, shape):
            shown = "missing" if saved is None else f"{saved.dtype} {saved.shape}"
            raise StateFileError(
                f"the state's {name} is {shown}, the model's is {own.dtype} {own.shape}: {ADVICE}"
            )
        state[name] = np.array(saved, order="C")
    if not 1 <= hypotheses <= len(parts.start["age"]):
        raise _refused("age", f"of {hypotheses} hypotheses", "more than the model's, or none")
    if len(state["block"]) >= parts.block:
        raise _refused("block", f"of {len(state['block'])} observations", "no open block")
    return state


def _counted(arrays: Arrays, rows: Sequence[str], block: int) -> Counts:
    """Return the arrays of counts and numbers, and those of the last seconds and their ``rows``.

    A full second has ``block`` observations.
    """
    found: list[float] = []
    for key, kind, limits in (("counts", "int64", _COUNTS), ("numbers", "float64", _NUMBERS)):
        array = arrays.get(key)
        if array is None or (array.dtype.name, array.shape) != (kind, (len(limits),)):
            raise StateFileError(f"the state's counts or numbers are missing: {ADVICE}")
        values = array.tolist()
        for value, (name, least, most) in zip(values, limits, strict=True):
            absent = name.startswith("forecast") and math.isnan(value)
            if not (absent or least <= value <= most):
                raise _refused(name, f"{value:g}", f"not within {least:g} to {most:g}")
        found += values
    stamp_ns, used, waiting, contradictions, moving_ns, alone = map(int, found[: len(_COUNTS)])
    used_s, waiting_s, change, doubt, *forecasts, way, same_way = found[len(_COUNTS) :]
    intake = Intake(_closed(arrays, block), alone)
    consistency = Consistency(
        rows,
        _fits(arrays, "judged", max(WINDOWS), len(rows)),
        _fits(arrays, "pending", DELAY, len(rows)),
        Crossing(_since_change(arrays), way, same_way),
    )
    intake.used, intake.waiting = used, waiting
    intake.time_used_s, intake.time_waiting_s = used_s, waiting_s
    forecasting = Forecasting(
        Persistence(_stamp(moving_ns), *forecasts[6:9]),
        Hindsight(*forecasts[9:]),
        model=Forecast(*forecasts[3:6]),
        published=Forecast(*forecasts[:3]),
    )
    return Counts(_stamp(stamp_ns), contradictions, change, doubt, forecasting, intake, consistency)


def _stamp(stamp_ns: int) -> int | None:
    return None if stamp_ns < 0 else stamp_ns


def _closed(arrays: Arrays, block: int) -> list[ClosedSecond]:
    """Return the last closed seconds, an array [n, 3]; a full one has ``block`` observations."""
    array = arrays.get("window")
    shaped = array is not None and array.ndim == 2 and array.shape[1] == len(ClosedSecond._fields)
    if array is None or not shaped or array.dtype.name != "int64" or len(array) > WINDOW:
        raise StateFileError(f"the state's window is missing or has another shape: {ADVICE}")
    most = np.array([1, block, LONELY])
    if not ((array >= 0) & (array <= most)).all():
        raise _refused("window", array.tolist(), f"not within 0 to {most.tolist()}")
    return [ClosedSecond(taken == 1, held, alone) for taken, held, alone in array.tolist()]


def _since_change(arrays: Arrays) -> int:
    array = arrays.get("since_change")
    if array is None or array.dtype.name != "int64" or array.shape:
        raise StateFileError(f"the state's since_change is missing or has another shape: {ADVICE}")
    if not 0 <= int(array) <= REST:
        raise _refused("since_change", int(array), f"not within 0 to {REST}")
    return int(array)


def _fits(arrays: Arrays, name: str, most: int, rows: int) -> list[Floats]:
    """Return an array [n, 2 + 2 rows] of how the last closed seconds fitted."""
    array = arrays.get(name)
    shaped = array is not None and array.ndim == 2 and array.shape[1] == 2 + 2 * rows
    if array is None or not shaped or array.dtype.name != "float64" or len(array) > most:
        raise StateFileError(f"the state's {name} is missing or has another shape: {ADVICE}")
    degrees, misses = array[:, 1], array[:, 2:]
    sound = np.isfinite(array[:, :2]).all() and bool((degrees >= 1.0).all())
    whole = bool((degrees == degrees.round()).all()) and degrees.max(initial=0.0) <= MOST_DEGREES
    if not (sound and whole):
        raise _refused(name, array[:, :2].tolist(), "no misfits with their degrees of freedom")
    beyond = np.abs(misses) > REACH
    if beyond.any():
        raise _refused(name, misses[beyond][0], f"no innovation of a row, at most {REACH:g}")
    return list(array)


def _check_range(name: str, values: NDArray[Any], parts: EstimatorParts) -> None:
    """Refuse numbers of one part that are not finite or outside their range."""
    least, most = _RANGES.get(name, (-_LARGEST, _LARGEST))
    if name == "kind":
        least, most = 0, 2 * len(parts.start["soils"]) - 1
    passes = (values >= least) & (values <= most)
    if name in _MAY_BE_NAN:
        passes |= np.isnan(values)
    if name in {"log_weight", "log_soils"}:
        passes |= values == -math.inf  # of no weight
    wrong = values[~passes]
    if wrong.size:
        value = wrong[0].item()
        reason = f"not within {least:g} to {most:g}" if math.isfinite(value) else "not finite"
        raise _refused(name, f"{value:g}", reason)


def _check_block(block: Floats, parts: EstimatorParts) -> None:
    """Refuse packed observations [n, P] that no screening lets pass."""
    for row, packed in enumerate(block):
        observation, step, linked = unpacked(packed, parts.axles)
        torque = observation.torque
        bounded = np.abs(torque) <= _SPUN
        if not (np.isnan(torque) | bounded).all():
            raise _refused(f"block's row {row}", f"a torque of {torque}", "too large")
        # the torque on the ground has another range than the motor's, which the screening knows
        within = np.clip(torque, -STRONGEST_TORQUE, STRONGEST_TORQUE)
        screened = dataclasses.replace(observation, torque=np.where(bounded, within, torque))
        if reason := impossible(screened, parts.wheel_radius_m, by_wheel=parts.by_wheel):
            raise StateFileError(f"the state's block has a row {row} with {reason}: {ADVICE}")
        if not (0.0 <= step <= LONGEST_GAP * parts.step_s and linked in {0.0, 1.0}):
            raise _refused(f"block's row {row}", f"step {step:g}, linked {linked:g}", "impossible")


def _bank(state: State, parts: EstimatorParts) -> State:
    """Return the hypotheses of a state: definite, and within reach of the prior."""
    precision, mean = state["precision"], state["mean"]
    with np.errstate(all="ignore"):
        root = np.sqrt(_diagonals(precision))
        asymmetry = np.abs(precision - precision.transpose(0, 2, 1)) / (
            root[:, :, None] * root[:, None]
        )
    if not (asymmetry < _AGREEMENT).all():
        raise _refused("precision", "no matrix", "not symmetric with a diagonal above zero")
    try:
        np.linalg.cholesky(precision)
        covariance = np.linalg.inv(precision)
    except np.linalg.LinAlgError:
        raise _refused("precision", "no matrix", "not positive definite") from None
    variance = _diagonals(covariance)
    if not (variance > 0.0).all():
        raise _refused("precision", "no matrix", "not positive definite")
    reach = FARTHEST * np.maximum(_spread(parts.start), _spread(parts.default))
    distance = np.abs(mean - parts.start["mean"].mean(0))
    for name, own, values in (
        ("mean", mean, distance),
        ("precision", _diagonals(precision), np.sqrt(variance)),
    ):
        outside = values > reach
        if outside.any():
            raise _refused(
                f"{name} of parameter {outside.any(0).argmax()}",
                f"{own[outside][0]:g}",
                f"more than {FARTHEST:g} standard deviations of the prior away",
            )
    log_mass = log_normal_cdf(mean[:, :2] / np.sqrt(variance[:, :2]))
    physical = np.maximum(log_mass, _LEAST_MASS).sum(1)  # as the model's own
    return {
        "mean": mean,
        "covariance": covariance,
        "precision": precision,
        "weight": state["log_weight"] + physical,
        "age": state["age"],
        "kind": state["kind"],
    }


def _diagonals(matrices: Floats) -> Floats:
    """Return the diagonals [n, D] of matrices [n, D, D]."""
    return np.diagonal(matrices, axis1=1, axis2=2)


def _spread(start: State) -> Floats:
    """Return the prior standard deviations [D] of a state at its start: its widest hypothesis's."""
    return np.asarray(_diagonals(start["precision"]).min(0) ** -0.5)


def _check_derived(state: State, derived: State) -> None:
    """Refuse a part that does not follow from the bank."""
    for name in _DERIVED:
        saved, right = state[name], derived[name]
        with np.errstate(all="ignore"):
            if name.endswith("covariance"):
                deviation = np.sqrt(np.diagonal(right))
                scale = np.outer(deviation, deviation)
            elif name in _SCALED_BY:
                scale = np.abs(right) + np.sqrt(np.diagonal(derived[_SCALED_BY[name]]))
            else:
                scale = np.abs(right) + 1.0
            agrees = (saved == right) | (np.abs(saved - right) <= _AGREEMENT * scale)
        if not agrees.all():
            values = f"{saved[~agrees][0]:g}"
            raise _refused(name, values, f"but its hypotheses give {right[~agrees][0]:g}")


def _last(arrays: Arrays, parts: EstimatorParts) -> Observation | None:
    """Return the last observation that entered, if any."""
    values = {
        name.removeprefix("last."): array
        for name, array in arrays.items()
        if name.startswith("last.")
    }
    if not values:
        return None
    for name, array in values.items():
        shape, kind = ((parts.axles,), "f") if name in AXLE_FIELDS else ((), "f")
        kind = "i" if name == "stamp_ns" else kind
        if (array.shape, array.dtype.kind) != (shape, kind):
            raise _refused(f"last {name}", f"{array.dtype} {array.shape}", "another version's")
    fields: dict[str, Any] = {
        name: value if value.ndim else value.item() for name, value in values.items()
    }
    try:
        observation = Observation(**fields)
    except TypeError as error:
        raise StateFileError(
            f"the state's last observation is another version's: {error}: {ADVICE}"
        ) from error
    if reason := impossible(observation, parts.wheel_radius_m, by_wheel=parts.by_wheel):
        raise StateFileError(f"the state's last observation has {reason}: {ADVICE}")
    if not 0 <= observation.stamp_ns <= _LATEST:
        raise _refused("last stamp", observation.stamp_ns, "no time")
    return observation
