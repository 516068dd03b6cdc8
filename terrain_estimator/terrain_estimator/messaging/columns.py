# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of equal layout as columns, and the conversion of many sets of them at once.

Only ordinary sets are converted here: the rover's wheels, each possible and with a deviation, and
sensors that measure all wheels of an axle or none. What is not ordinary is left to
:class:`Converter`, set by set. The rules for single numbers are those of
:mod:`~terrain_estimator.messaging.conversion_rules`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.messaging.conversion import (
    Conversion,
    Converter,
    Groups,
    Mark,
    WrongWheelsError,
    is_local,
    wrong_reference,
)
from terrain_estimator.messaging.conversion_rules import (
    ANY,
    NOT_MEASURED,
    Bounds,
    acceleration_of,
    deviation_of,
    is_possible,
    mean,
    mean_deviation,
    optional_of,
    pitch_of,
    roll_of,
)
from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Floats, Observation
from terrain_estimator.topics import (
    LATERAL_IN_TWIST,
    PITCH_IN_ORIENTATION,
    PITCH_IN_POSE,
    ROLL_IN_ORIENTATION,
    ROLL_IN_POSE,
    YAW_IN_RATES,
    YAW_IN_TWIST,
    Message,
)

_ORIENTATION = tuple(f"orientation.{axis}" for axis in "xyzw")
_POSE = tuple(f"pose.pose.{name}" for name in _ORIENTATION)
_TWIST = ("twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.angular.z")
_RATES = "angular_velocity"
_RATE = f"{_RATES}.z"
_SECONDS, _NANOSECONDS, _SEQUENCE = "header.stamp.sec", "header.stamp.nanosec", "sequence"
_JOINTS = ("position", "velocity", "effort")  # an empty one is no field
_ONE, _MANY, _SMALL, _LARGE = (), None, (9,), (36,)  # lengths of arrays
_DOUBLES: dict[str, dict[str, tuple[int, ...] | None]] = {
    "wheel_slip": dict.fromkeys(("slip", "slip_stddev"), _MANY),
    "wheel_sinkage": dict.fromkeys(
        ("sinkage", "sinkage_stddev", "contact_angle", "contact_angle_stddev"), _MANY
    ),
    "odom": dict.fromkeys((*_POSE, *_TWIST), _ONE)
    | dict.fromkeys(("pose.covariance", "twist.covariance"), _LARGE),
    "joint_states": {},
    "imu": dict.fromkeys((*_ORIENTATION, _RATE, "linear_acceleration.x"), _ONE)
    | dict.fromkeys(
        ("orientation_covariance", f"{_RATES}_covariance", "linear_acceleration_covariance"), _SMALL
    ),
}
"""Numbers of each input that the conversion reads."""


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """The numbers of n messages of one topic, whose texts are those of ``example``."""

    topic: str
    example: Message
    size: int  # [B] of each message in memory
    values: NDArray[np.void]  # [n] with a field for each number, by its path in the message
    stamps_ns: list[int]  # [n]
    sequences: list[int] | None  # [n]; None where the messages have none
    read: Callable[[int], Message]  # decodes one of them


class Row(NamedTuple):
    """One message of some columns."""

    columns: Columns
    at: int

    def message(self) -> Message:
        """Return the message itself."""
        return self.columns.read(self.at)


def can_be_columns(topic: str, example: Message, dtype: np.dtype[Any]) -> bool:
    """Return whether messages like ``example``, with these numbers, may become columns."""
    fields = {name: kind[0] for name, kind in (dtype.fields or {}).items()}
    joints = dict.fromkeys(fields.keys() & set(_JOINTS), _MANY) if topic == "joint_states" else {}
    doubles = _DOUBLES[topic] | joints
    stamp = [fields.get(name) for name in (_SECONDS, _NANOSECONDS)]
    return (
        stamp == [np.dtype(np.int32), np.dtype(np.uint32)]
        and (not hasattr(example, _SEQUENCE) or fields.get(_SEQUENCE) == np.dtype(np.uint64))
        and all(name in fields and _is_double(fields[name], doubles[name]) for name in doubles)
    )


def _is_double(dtype: np.dtype[Any], shape: tuple[int, ...] | None) -> bool:
    fits = len(dtype.shape) == 1 if shape is None else dtype.shape == shape
    return fits and dtype.base == np.dtype(np.float64)


def columns_of(
    topic: str,
    example: Message,
    size: int,
    values: NDArray[np.void],
    read: Callable[[int], Message],
) -> Columns:
    """Return columns of messages for which :func:`can_be_columns` holds."""
    seconds, nanoseconds = (values[name].astype(np.int64) for name in (_SECONDS, _NANOSECONDS))
    sequences = values[_SEQUENCE].tolist() if hasattr(example, _SEQUENCE) else None
    stamps = (seconds * 1_000_000_000 + nanoseconds).tolist()
    return Columns(topic, example, size, values, stamps, sequences, read)


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Observations of n sets in arrays."""

    stamps_ns: list[int]
    ordinary: list[bool]  # the others are for the conversion of single sets
    axles: Floats  # [n, fields, axles]
    scalars: Floats  # [n, fields]
    local: bool = False  # whether sinkages are from the ground right before each wheel


class ObservationRow(NamedTuple):
    """One ordinary observation of many."""

    observations: Observations
    at: int

    @property
    def stamp_ns(self) -> int:
        """Stamp of its set."""
        return self.observations.stamps_ns[self.at]

    @property
    def notes(self) -> tuple[str, ...]:
        """Nothing was left out."""
        return ()

    @property
    def mark(self) -> Mark:
        """It passes as it is."""
        return Mark.NONE

    def conversion(self) -> Conversion:
        """Return it as the conversion of a single set."""
        many = self.observations
        scalars = many.scalars[self.at].tolist()
        numbers = (*many.axles[self.at], *scalars, None, many.local)  # in the order of the fields
        return Conversion(self.stamp_ns, Observation(self.stamp_ns, *numbers))


def observed(
    converter: Converter, stamps_ns: list[int], sets: Sequence[tuple[Row | None, ...]]
) -> Observations | None:
    """Convert sets of the same columns; None where their texts or lengths are not ordinary.

    A set is (wheel_slip, wheel_sinkage, odom, joint_states or None, imu or None).
    """
    rows = [None if row is None else row.columns for row in (*sets[0], None)[:5]]
    slip, sinkage, odom, joints, imu = rows
    if slip is None or sinkage is None or odom is None or any(converter.steering_joints):
        return None
    if not converter.core.use_imu:
        imu = None
    if joints and not converter.unsteered_joints.isdisjoint(joints.example.name):
        return None
    if converter.wrong_frame(
        slip.example, sinkage.example, odom.example, None if imu is None else imu.example
    ) or wrong_reference(sinkage.example):
        return None

    def picked(columns: Columns, index: int) -> NDArray[np.void]:
        return columns.values[[row.at for each in sets if (row := each[index]) is not None]]

    found = _Found(len(sets), converter.stations)
    found.put("bogie_angle", [converter.known_angle] * len(sets))
    try:
        with np.errstate(all="ignore"):
            _add_wheels(found, converter, (slip, picked(slip, 0)), "slip", converter.slip_bounds)
            depths = (sinkage, picked(sinkage, 1))
            bounds = converter.sinkage_bounds(local=is_local(sinkage.example))
            _add_wheels(found, converter, depths, "sinkage", bounds)
            _add_wheels(found, converter, depths, "contact_angle", ANY)
            if joints and not _add_joints(found, converter, joints, picked(joints, 3)):
                return None
            _add_body(found, converter, picked(odom, 2), picked(imu, 4) if imu else None)
    except WrongWheelsError:
        return None
    ordinary, local = found.ordinary.tolist(), is_local(sinkage.example)
    return Observations(stamps_ns, ordinary, found.axles, found.scalars, local)


class _Found:
    """What is known of n sets while they are converted; NaN where nothing is."""

    def __init__(self, count: int, axles: int) -> None:
        self.ordinary = np.ones(count, dtype=np.bool_)
        self.axles = np.full((count, len(AXLE_FIELDS), axles), math.nan)
        self.scalars = np.full((count, len(SCALAR_FIELDS)), math.nan)

    def by_axle(self, name: str) -> Floats:
        """Return the place of a quantity [n, axles]."""
        return self.axles[:, AXLE_FIELDS.index(name)]

    def put(self, name: str, values: Sequence[float] | Floats) -> None:
        """Set a scalar of all sets."""
        self.scalars[:, SCALAR_FIELDS.index(name)] = values


def _add_wheels(
    found: _Found,
    converter: Converter,
    messages: tuple[Columns, NDArray[np.void]],
    name: str,
    bounds: Bounds,
) -> None:
    """Add the means over the wheels of each axle; raises WrongWheelsError."""
    columns, picked = messages
    names = columns.example.wheel
    groups = converter.match(columns.topic, names)
    values, deviations = _doubles(picked, name), _doubles(picked, f"{name}_stddev")
    if not values.shape == deviations.shape == (len(picked), len(names)):
        raise WrongWheelsError(columns.topic)
    good = is_possible(values, deviations, bounds) & np.isfinite(values)
    found.ordinary &= good.all(axis=1)
    for axle, group in enumerate(groups):
        found.by_axle(name)[:, axle] = mean([values[:, at] for at in group])
        found.by_axle(f"{name}_sd")[:, axle] = _mean_deviations(deviations, group)


def _mean_deviations(deviations: Floats, group: tuple[int, ...]) -> list[float]:
    return [mean_deviation(each) for each in zip(*deviations[:, group].T.tolist(), strict=True)]


def _add_joints(
    found: _Found, converter: Converter, joints: Columns, picked: NDArray[np.void]
) -> bool:
    """Add wheel rates, torques and the bogie's angle; return whether the arrays allow it."""
    names = joints.example.name
    groups = converter.joint_groups(names)
    fields = {name: _doubles(picked, name) for name in _JOINTS}
    read = ("velocity", "effort") if converter.core.use_torque else ("velocity",)
    if any(fields[name].shape[1] not in (0, len(names)) for name in read):
        return False
    _add_joint_means(found, groups, "wheel_rate", fields["velocity"])
    efforts = fields["effort"]
    if converter.core.use_torque and efforts.shape[1]:
        _add_joint_means(found, groups, "torque", efforts)
        torque = found.by_axle("torque")
        for axle, group in enumerate(groups):
            known = ~np.isnan(torque[:, axle])
            each = [
                list(map(converter.torque_deviation, efforts[known, at].tolist())) for at in group
            ]
            found.by_axle("torque_sd")[known, axle] = [
                mean_deviation(wheels) for wheels in zip(*each, strict=True)
            ]
    positions = fields["position"]
    angles = [
        positions[:, at]
        for at, name in enumerate(names[: positions.shape[1]])
        if name in converter.bogie_joints
    ]
    if angles and converter.rover.suspension:
        angle = mean(angles)
        found.put("bogie_angle", -angle if converter.config.bogie_nose_down else angle)
    return True


def _add_joint_means(found: _Found, groups: Groups, name: str, values: Floats) -> None:
    """Add the means of the axles; NaN where no wheel is measured."""
    if not values.shape[1]:
        return
    found.ordinary &= ~np.isinf(values).any(axis=1)
    for axle, group in enumerate(groups):
        known = np.isfinite(values[:, group])
        whole = known.all(axis=1) if group else np.zeros(len(values), dtype=np.bool_)
        found.ordinary &= whole | ~known.any(axis=1)
        if group:
            found.by_axle(name)[whole, axle] = mean([values[:, at] for at in group])[whole]


def _add_body(
    found: _Found, converter: Converter, odom: NDArray[np.void], imu: NDArray[np.void] | None
) -> None:
    """Add velocities, attitude and acceleration."""
    config = converter.config
    along, left, turn = (odom[name] for name in _TWIST)
    found.put("velocity", along)
    spread = _deviations(odom["twist.covariance"][:, 0], config.default_velocity_sd)
    found.put("velocity_sd", spread)
    orientation = [odom[name] for name in _POSE]
    variances = odom["pose.covariance"][:, [PITCH_IN_POSE, ROLL_IN_POSE]]
    if imu is not None:
        given = imu["orientation_covariance"][:, 0] != NOT_MEASURED
        both = zip(_ORIENTATION, orientation, strict=True)
        orientation = [np.where(given, imu[name], other) for name, other in both]
        own = imu["orientation_covariance"][:, [PITCH_IN_ORIENTATION, ROLL_IN_ORIENTATION]]
        variances = np.where(given[:, np.newaxis], own, variances)
        specific = imu["linear_acceleration.x"].tolist()
        noise = imu["linear_acceleration_covariance"][:, 0].tolist()
        default = config.default_acceleration_sd
        measured = [acceleration_of(*each, default) for each in zip(specific, noise, strict=True)]
        found.put("acceleration", [value for value, _ in measured])
        found.put("acceleration_sd", [deviation for _, deviation in measured])
    angles = [each.tolist() for each in orientation]
    found.put("pitch", list(map(pitch_of, *angles)))
    pitch_sds = _deviations(variances[:, 0], config.default_pitch_sd)
    found.put("pitch_sd", pitch_sds)
    found.put("roll", list(map(roll_of, *angles)))
    rolls = zip(variances[:, 1].tolist(), pitch_sds, strict=True)
    found.put("roll_sd", [deviation_of(*each) for each in rolls])
    covariance = odom["twist.covariance"]
    lateral = _optional(left, covariance[:, LATERAL_IN_TWIST], config.default_lateral_velocity_sd)
    yaw = _optional(turn, covariance[:, YAW_IN_TWIST], config.default_yaw_rate_sd)
    if imu is not None:
        rates = imu[f"{_RATES}_covariance"]
        own = _optional(imu[_RATE], rates[:, YAW_IN_RATES], config.default_yaw_rate_sd)
        usable_rates = (rates[:, 0] != NOT_MEASURED) & np.isfinite(own[:, 0])
        yaw = np.where(usable_rates[:, np.newaxis], own, yaw)
    for name, values in (("lateral_velocity", lateral), ("yaw_rate", yaw)):
        found.put(name, values[:, 0])
        found.put(f"{name}_sd", values[:, 1])


def _optional(values: Floats, variances: Floats, default: float) -> Floats:
    """Return values and their deviations [n, 2]; NaN where nothing was measured."""
    both = zip(values.tolist(), variances.tolist(), strict=True)
    return np.array([optional_of(*each, default) for each in both]).reshape(-1, 2)


def _deviations(variances: Floats, default: float) -> list[float]:
    return [deviation_of(variance, default) for variance in variances.tolist()]


def _doubles(picked: NDArray[np.void], name: str) -> Floats:
    """Return an array of all messages [n, length]; one of no length is no field."""
    if name not in (picked.dtype.names or ()):
        return np.empty((len(picked), 0))
    return np.asarray(picked[name], dtype=np.float64)
