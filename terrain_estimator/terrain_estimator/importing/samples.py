# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of a CSV file as samples in SI units, in constant memory."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rover_parameters.csv_rows import csv_rows
from rover_parameters.numerals import parse_number
from terrain_estimator.importing.mapping import Mapping, SignalNoise
from terrain_estimator.importing.units import factor

LATEST_NS = (2**31 - 1) * 1_000_000_000  # limit of builtin_interfaces/Time


class CsvError(ValueError):
    """A CSV file is wrong; the message names file, row, column and value."""


@dataclass(frozen=True, slots=True)
class MeasuredValue:
    """A value and its standard deviation, both NaN where nothing was measured."""

    value: float
    deviation: float


NOTHING = MeasuredValue(math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class TableSample:
    """One row, in SI units. Lists are in the order of the mapping's wheels."""

    stamp_ns: int
    slip: list[MeasuredValue]  # [1] 1 - v / (r w)
    sinkage: list[MeasuredValue]  # [m]
    contact_angle: list[MeasuredValue]  # [rad] relative to the body
    wheel_rate: list[float]  # [rad/s]
    torque: list[float]  # [N m]
    velocity: MeasuredValue  # [m/s]
    pitch: MeasuredValue  # [rad] nose up
    acceleration: MeasuredValue  # [m/s^2] specific force along body x
    bogie_angle: float  # [rad] nose up, relative to the body
    roll: float = math.nan  # [rad] of body y above the horizon, left side up
    lateral_velocity: MeasuredValue = NOTHING  # [m/s] to the left
    yaw_rate: MeasuredValue = NOTHING  # [rad/s] to the left
    steering: tuple[float, ...] = ()  # [rad] to the left; none where the file has no such column


def read_samples(path: Path, mapping: Mapping) -> Iterator[TableSample]:
    """Yield the rows of a file.

    An empty cell, or one of the mapping's words for missing values, means that the value was not
    measured. The column of time needs a number in each row.

    Raises:
        CsvError: no rows, a missing column, a cell that is no finite number, time that does not
            increase.
    """
    try:
        rows = csv_rows(path, mapping.delimiter, strict=True)
        yield from _Rows(path, mapping, next(rows, [])).samples(rows)
    except OSError as error:
        msg = f"{path} cannot be read: {error.strerror}"
        raise CsvError(msg) from error
    except (UnicodeDecodeError, csv.Error) as error:
        msg = f"{path} is not a CSV file in UTF-8 ({error}): save it again as CSV, UTF-8"
        raise CsvError(msg) from error


def slip_from_max_normalised(slip: MeasuredValue) -> MeasuredValue:
    """Convert slip (r w - v) / max(r w, v) to 1 - v / (r w).

    They agree where the wheel drives. Where it brakes, s = r w / v - 1, hence i = s / (1 + s) and
    di/ds = 1 / (1 + s)^2. A locked wheel (s = -1) has no slip by our definition: NaN.
    """
    if slip.value >= 0.0 or math.isnan(slip.value):
        return slip
    if slip.value == -1.0:
        return NOTHING
    rest = 1.0 + slip.value
    return MeasuredValue(slip.value / rest, slip.deviation / rest**2)


class _Rows:
    """Converter of rows to samples; error messages name its current row."""

    def __init__(self, path: Path, mapping: Mapping, header: list[str]) -> None:
        self._path, self._mapping = path, mapping
        self._names = [name.strip() for name in header]
        self._row: list[str] = []
        self._number = 1
        if not any(self._names):
            msg = f"{path} is empty: the first row must name the columns"
            raise CsvError(msg)
        needed = list(mapping.all_columns())
        if missing := [name for name in needed if name not in self._names]:
            msg = (
                f"{path}, row 1: no column {missing[0]!r}; the file has {', '.join(self._names)}:"
                " correct the mapping or its delimiter"
            )
            raise CsvError(msg)
        if twice := [name for name in needed if self._names.count(name) > 1]:
            msg = f"{path}, row 1: column {twice[0]!r} appears twice: rename one of them"
            raise CsvError(msg)
        self._place = {name: self._names.index(name) for name in needed}

    def samples(self, rows: Iterator[list[str]]) -> Iterator[TableSample]:
        before = -1
        for self._number, self._row in enumerate(rows, start=2):
            if not self._row:
                continue
            if len(self._row) != len(self._names):
                msg = (
                    f"{self._path}, row {self._number}: {len(self._row)} cells, but"
                    f" {len(self._names)} columns are named in row 1"
                )
                raise CsvError(msg)
            stamp = self._stamp()
            if stamp <= before:
                raise self._error(
                    self._mapping.time.column,
                    "is not later than in the row before: sort the rows and remove repeated ones",
                )
            before = stamp
            yield self._sample(stamp)
        if before < 0:
            msg = f"{self._path} has no data below row 1"
            raise CsvError(msg)

    def _sample(self, stamp_ns: int) -> TableSample:
        mapping = self._mapping
        slip = [self._slip(column) for column in mapping.columns("slip")]
        pitch = self._pitch()
        return TableSample(
            stamp_ns,
            slip,
            self._wheels("sinkage", "length"),
            self._contact_angles(pitch),
            [entry.value for entry in self._wheels("wheel_rate", "wheel rate")],
            [entry.value for entry in self._wheels("torque", "torque")],
            self._body("velocity", "velocity"),
            pitch,
            self._body("acceleration", "acceleration"),
            self._nose_up("bogie_angle").value,
            self._body("roll", "angle").value,
            self._body("lateral_velocity", "velocity"),
            self._body("yaw_rate", "yaw rate"),
            tuple(entry.value for entry in self._wheels("steering", "angle"))
            if mapping.measures("steering")
            else (),
        )

    def _contact_angles(self, pitch: MeasuredValue) -> list[MeasuredValue]:
        """Return the slope of the ground under each wheel relative to the body."""
        mapping, constant = self._mapping, self._mapping.constant_contact_angle
        angles = (
            self._wheels("contact_angle", "angle")
            if mapping.measures("contact_angle")
            else [_known(constant.value, constant.unit, constant.noise)] * len(mapping.wheels)
        )
        if mapping.contact_angle_reference == "body":
            return angles
        return [
            MeasuredValue(each.value - pitch.value, math.hypot(each.deviation, pitch.deviation))
            for each in angles
        ]

    def _stamp(self) -> int:
        time = self._mapping.time
        seconds = self._number_in(time.column) * factor("time", time.unit) + time.offset
        if math.isnan(seconds):
            raise self._error(time.column, "is empty: every row needs its time")
        if not 0.0 <= seconds <= LATEST_NS / 1e9:
            raise self._error(
                time.column,
                f"with offset {time.offset:g} s is outside 0 to {LATEST_NS / 1e9:.0f} s: set"
                " time.unit or time.offset",
            )
        return round(seconds * 1e9)

    def _wheels(self, signal: str, quantity: str) -> list[MeasuredValue]:
        section = getattr(self._mapping, signal)
        return [
            self._measured(column, section.unit, quantity, section.noise)
            for column in self._mapping.columns(signal)
        ]

    def _slip(self, column: str) -> MeasuredValue:
        slip = self._measured(column, self._mapping.slip.unit, "ratio", self._mapping.slip.noise)
        if self._mapping.slip_definition == "one_minus_v_over_rw":
            return slip
        if abs(slip.value) > 1.0:
            raise self._error(
                column,
                "is outside -1 to 1, the range of max_normalised slip: correct slip.unit or"
                " slip_definition",
            )
        return slip_from_max_normalised(slip)

    def _body(self, signal: str, quantity: str) -> MeasuredValue:
        section = getattr(self._mapping, signal)
        return self._measured(section.column, section.unit, quantity, section.noise)

    def _pitch(self) -> MeasuredValue:
        constant = self._mapping.constant_pitch
        if not self._mapping.measures("pitch"):
            return _known(constant.value, constant.unit, constant.noise)
        return self._nose_up("pitch")

    def _nose_up(self, signal: str) -> MeasuredValue:
        angle = self._body(signal, "angle")
        down = getattr(self._mapping, signal).positive == "nose_down"
        return MeasuredValue(-angle.value, angle.deviation) if down else angle

    def _measured(self, column: str, unit: str, quantity: str, noise: SignalNoise) -> MeasuredValue:
        if not column:
            return NOTHING
        return _in_si(self._number_in(column), factor(quantity, unit), noise)

    def _number_in(self, column: str) -> float:
        """Return the number in a cell, NaN where nothing was measured."""
        text = self._row[self._place[column]].strip()
        if not text or text in self._mapping.missing:
            return math.nan
        try:
            value = parse_number(self._with_point(text))
        except ValueError:
            raise self._error(column, f"is not a number: {self._advice(text)}") from None
        if math.isnan(value):
            raise self._error(
                column,
                "is not finite: leave the cell empty where nothing was measured, or list the word"
                " under missing in the mapping",
            )
        if math.isinf(value):
            raise self._error(
                column, "is not finite: leave the cell empty where nothing was measured"
            )
        return value

    def _with_point(self, text: str) -> str:
        """Return a number with a decimal point; ValueError where it has two kinds of mark."""
        decimal = self._mapping.decimal
        if decimal != "." and "." in text:
            raise ValueError(text)
        return text.replace(decimal, ".")

    def _advice(self, text: str) -> str:
        decimal = self._mapping.decimal
        if decimal == "." and "," in text:
            return 'set decimal: "," in the mapping if it is a decimal comma'
        if decimal != "." and "." in text:
            return f"the mapping has decimal: {decimal!r}; leave that out for decimal points"
        return (
            "correct it, leave the cell empty where nothing was measured, or list the word under"
            " missing in the mapping"
        )

    def _error(self, column: str, what: str) -> CsvError:
        return CsvError(
            f"{self._path}, row {self._number}, column {column!r}:"
            f" {self._row[self._place[column]]!r} {what}"
        )


def _known(value: float, unit: str, noise: SignalNoise) -> MeasuredValue:
    return _in_si(value, factor("angle", unit), noise) if unit else NOTHING


def _in_si(value: float, size: float, noise: SignalNoise) -> MeasuredValue:
    si = value * size
    return MeasuredValue(
        si,
        math.hypot(noise.relative * si, noise.absolute * size) if not math.isnan(si) else math.nan,
    )
