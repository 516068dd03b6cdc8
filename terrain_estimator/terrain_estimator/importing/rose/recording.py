# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read the raw MCAP recording of a trial.

The schema names its topics, not the fields of the encoders' message: the user gives them, and an
error lists those that the message has.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rover_parameters.records import shortened
from terrain_estimator.bags import BagReader, Message
from terrain_estimator.importing.rose.schema import (
    ENCODER_TOPIC,
    IMU_TOPIC,
    IMU_TYPE,
    POSE_TOPIC,
    POSE_TYPE,
    WHEELS,
    RoseOptions,
)
from terrain_estimator.importing.rose.trial import (
    FARTHEST,
    LARGEST,
    Accelerations,
    Poses,
    Trial,
    Wheels,
    quaternion_doubt,
)
from terrain_estimator.importing.samples import LATEST_NS, CsvError
from terrain_estimator.importing.units import factor
from terrain_estimator.observation import Floats
from terrain_estimator.topics import stamp_ns

Streams = dict[str, list[tuple[int, list[float]]]]


def read_recording(path: Path, options: RoseOptions) -> Trial:
    """Read the poses, the encoders and, where it is asked for, the imu.

    Raises:
        CsvError: a topic or a field is missing, or a value cannot be; the message names it.
        BagError: it is no bag, or is damaged.
    """
    with BagReader(path) as reader:
        needed = [POSE_TOPIC, ENCODER_TOPIC, *[IMU_TOPIC] * bool(options.acceleration_axis)]
        missing = [topic for topic in needed if topic not in reader.topics]
        if missing:
            raise CsvError(
                f"{path}: no topic {' and '.join(missing)}; it has"
                f" {', '.join(sorted(reader.topics)) or 'none'}: give the raw recording of a trial"
            )
        reader.expect({POSE_TOPIC: POSE_TYPE, IMU_TOPIC: IMU_TYPE})
        streams = _streams(path, reader, options)
        notes = tuple(reader.losses)
    poses, wheels = (_sorted(streams[topic]) for topic in (POSE_TOPIC, ENCODER_TOPIC))
    if not len(poses[0]) or not len(wheels[0]):
        raise CsvError(f"{path}: {POSE_TOPIC} or {ENCODER_TOPIC} has no messages")
    start, end = max(poses[0][0], wheels[0][0]), min(poses[0][-1], wheels[0][-1])
    if start >= end:
        raise CsvError(
            f"{path}: the stamps of {POSE_TOPIC} ({_seconds(poses[0])}) and of {ENCODER_TOPIC}"
            f" ({_seconds(wheels[0])}) have no time in common: give --stamps"
            f" {'log' if options.stamps == 'header' else 'header'}"
        )
    imu = (
        _sorted(streams[IMU_TOPIC]) if streams[IMU_TOPIC] else (np.zeros(0, int), np.zeros((0, 3)))
    )
    dropped = sum(map(len, streams.values())) - len(poses[0]) - len(wheels[0]) - len(imu[0])
    if dropped:
        notes += (f"{dropped} messages have the stamp of another one and are left out",)

    def since(stamps: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Floats:
        return np.asarray((stamps - start) / 1e9)

    inside = (poses[0] >= start) & (poses[0] <= end)
    known = inside & np.isfinite(poses[1]).all(1)
    return Trial(
        str(path),
        int(start),
        Poses(since(poses[0])[known], poses[1][known, :3], poses[1][known, 3:]),
        Wheels(since(wheels[0]), wheels[1][:, :WHEELS], wheels[1][:, WHEELS:]),
        Accelerations(since(imu[0]), imu[1]),
        notes,
    )


def _streams(path: Path, reader: BagReader, options: RoseOptions) -> Streams:
    """Return stamp [ns] and values of each message by topic."""
    values_of = _Values(options)
    readers: dict[str, Callable[[Message, str], list[float]]] = {
        POSE_TOPIC: values_of.pose,
        ENCODER_TOPIC: values_of.encoder,
    }
    if options.acceleration_axis:
        readers[IMU_TOPIC] = values_of.imu
    streams: Streams = {POSE_TOPIC: [], ENCODER_TOPIC: [], IMU_TOPIC: []}
    for number, raw in enumerate(reader.messages(readers), start=1):
        message = reader.decode(raw)
        where = f"{path}, topic {raw.topic} at log time {raw.log_time_ns} ns"
        by_log = options.stamps == "log" or not hasattr(message, "header")
        stamp = raw.log_time_ns if by_log else stamp_ns(message)
        if not 0 <= stamp <= LATEST_NS:
            raise CsvError(f"{where}: stamp {stamp} ns is outside 0 to {LATEST_NS}: --stamps log")
        values = readers[raw.topic](message, where)
        if any(abs(value) > FARTHEST for value in values):
            raise CsvError(
                f"{where}: {shortened(values)} cannot be: record again, or cut this stretch out"
            )
        streams[raw.topic].append((stamp, values))
        if number > LARGEST:
            raise CsvError(f"{path} has more than {LARGEST} messages of the trial: split it")
    return streams


class _Values:
    """Numbers of a message, in SI units."""

    def __init__(self, options: RoseOptions) -> None:
        self._options = options
        self._length = factor("length", options.position_unit)
        self._rate = factor("wheel rate", options.rate_unit)

    def encoder(self, message: Message, where: str) -> list[float]:
        options, currents = self._options, [math.nan] * WHEELS
        rates = _four(message, options.rate_fields, "--rate-fields", where)
        if options.torque_gain is not None:
            currents = _four(message, options.current_fields, "--current-fields", where)
        return [*(value * self._rate for value in rates), *currents]

    def pose(self, message: Message, where: str) -> list[float]:
        place, turn = message.pose.position, message.pose.orientation
        attitude = [turn.x, turn.y, turn.z, turn.w]
        if doubt := quaternion_doubt(attitude):
            raise CsvError(
                f"{where}: pose.orientation {shortened(attitude)} {doubt}: record again, or cut"
                " this stretch out"
            )
        if not any(attitude):
            attitude = [math.nan] * 4
        return [*(self._length * value for value in (place.x, place.y, place.z)), *attitude]

    def imu(self, message: Message, _: str) -> list[float]:
        vector = message.linear_acceleration
        return [vector.x, vector.y, vector.z]


def _four(message: Message, fields: tuple[str, ...], option: str, where: str) -> list[float]:
    """Return the four wheels' values of a field that holds four, or of four fields."""
    known = list(getattr(type(message), "__dataclass_fields__", ()))
    has = f"the message has {', '.join(each for each in known if not each.startswith('__'))}"
    if len(fields) not in (1, WHEELS):
        raise CsvError(
            f"{where}: give the field with the four wheels' values, or four fields with commas, by"
            f" {option}; {has}"
        )
    if unknown := [name for name in fields if name not in known]:
        raise CsvError(f"{where}: {option}: no field {unknown[0]!r}; {has}")
    values = [getattr(message, name) for name in fields]
    try:
        numbers = np.array(values[0] if len(values) == 1 else values, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != (WHEELS,):
        raise CsvError(
            f"{where}: {option} {','.join(fields)}: {shortened(values)} is not one number for each"
            f" of the four wheels; {has}"
        )
    return [math.nan if math.isinf(value) else value for value in numbers.tolist()]


def _sorted(
    stream: list[tuple[int, list[float]]],
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], Floats]:
    """Return stamps that increase, and their values; of equal stamps the first stays."""
    stamps = np.array([stamp for stamp, _ in stream], dtype=np.int64)
    found, first = np.unique(stamps, return_index=True)
    values = np.array([values for _, values in stream], dtype=np.float64)
    return found, values[first] if len(stream) else np.zeros((0, 0))


def _seconds(stamps: np.ndarray[tuple[int], np.dtype[np.int64]]) -> str:
    return f"{stamps[0] / 1e9:.3f} to {stamps[-1] / 1e9:.3f} s"
