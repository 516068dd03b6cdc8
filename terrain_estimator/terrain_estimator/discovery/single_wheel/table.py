# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tables of single-wheel measurements: one steady state a row, units at the end of names."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_parameters.csv_rows import csv_rows
from rover_parameters.numerals import parse_number
from rover_parameters.records import shortened
from terrain_estimator.discovery.single_wheel.cells import DATUM_SD, Row

UNITS: Mapping[str, Mapping[str, float]] = {
    "slip": {"": 1.0},
    "normal_load": {"N": 1.0, "kN": 1e3},
    "wheel_rate": {"rad_s": 1.0, "rpm": math.pi / 30.0, "deg_s": math.pi / 180.0},
    "sinkage": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "drawbar_pull": {"N": 1.0, "kN": 1e3},
    "slip_angle": {"deg": 1.0, "rad": 180.0 / math.pi},
    "lateral_force": {"N": 1.0, "kN": 1e3},
    "torque": {"Nm": 1.0, "mNm": 1e-3, "kNm": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
}
"""Columns, their units and the factors to [1], N, rad/s, m, N, degrees, N, N m and A."""
OPTIONAL = ("slip_angle", "lateral_force", "torque", "current")
"""Columns that may be absent: then the wheel moves straight ahead, and its torque is unknown."""
TRIAL = "trial"
"""Column that numbers the repetitions."""
STRAIGHT_DEG = 1.0
"""[deg] Slip angle up to which the wheel rolls straight ahead."""
SIDEWAYS_DEG = 89.0
"""[deg] Slip angle up to which it rolls at all."""
SLIP_DEFINITIONS = ("rim", "larger")
"""1 - V / (r w); or (r w - V) / max(r w, V), which divides by V where the wheel is braked."""
SLIP_RADII = ("rim", "lug")
"""Radius r in a slip: that of the rim, or of the lugs' tips."""
CARRIAGE = "carriage"
SLIP_SPEEDS = (CARRIAGE, "wheel")
"""Speed V at a slip angle: that of the carriage, or its part along the wheel's heading."""


MOST_CELLS = 1_000_000
"""Largest table, which is held in memory."""


class WheelTableError(ValueError):
    """A table cannot be read; the message names file, line and field."""


@dataclass(frozen=True, slots=True)
class _Column:
    name: str
    factor: float


def read_table(
    path: Path,
    slip_definition: str,
    slip_speed: str = CARRIAGE,
    largest_angle: float = SIDEWAYS_DEG,
    radius_ratio: float = 1.0,
    torque_constant: float | None = None,
) -> tuple[list[Row], list[str]]:
    """Return the rows of a table, and why some are left out.

    ``radius_ratio`` is the radius in the table's slip over that of the rim, ``torque_constant`` the
    torque at the wheel for each ampere of the motor [N m/A], by which a current is a torque.

    Raises:
        WheelTableError: it is no CSV in UTF-8, a column is missing or there twice or its unit
            unknown, a cell is no finite number, a row has more cells than there are columns, a
            sign is another than here, or a torque is given twice.
        OSError: it cannot be read.
    """
    table = _lines(path)
    header = table[0] if table else []
    columns = _columns(path, header)
    rows, left_out = [], []
    current = columns.pop("current", None)
    if torque_constant is not None and current is None:
        raise WheelTableError(
            f"{path}:1: no column current_A or current_mA: leave out --torque-constant, or give the"
            " motor's current in every table"
        )
    if current:
        if torque_constant is None:
            left_out.append(
                f"{path}:1: column {current[1].name} is not used: give --torque-constant [N m/A]"
            )
        elif "torque" in columns:
            raise WheelTableError(
                f"{path}:1: columns {columns['torque'][1].name!r} and {current[1].name!r} both say"
                " the torque: leave out --torque-constant, or delete one column"
            )
        else:
            index, column = current
            columns["torque"] = index, _Column(column.name, torque_constant * column.factor)
    for number, cells in enumerate(table[1:], start=2):
        if not "".join(cells).strip():
            continue
        if "".join(cells[len(header) :]).strip():
            raise WheelTableError(
                f"{path}:{number}: {len(cells)} cells in {len(header)} columns: write numbers with"
                " a point, not a comma"
            )
        values = {
            key: _value(path, number, cells, index, column)
            for key, (index, column) in columns.items()
            if key != TRIAL
        }
        trial = _text(cells, columns[TRIAL][0]) if TRIAL in columns else "1"
        _check_signs(f"{path}:{number}: column", values, columns)
        slip = rim_slip(values["slip"], slip_definition, radius_ratio)
        if reason := _left_out(values, slip, largest_angle):
            left_out.append(f"{path}:{number}: {reason}")
        elif slip is not None:
            rows.append(_row(path, trial, slip, values, slip_speed))
    _check_directions(path, rows)
    return rows, left_out


def _left_out(values: Mapping[str, float], slip: float | None, largest_angle: float) -> str:
    """Return why a row is not used; empty where it is."""
    angle = values.get("slip_angle", 0.0)
    if abs(angle) > STRAIGHT_DEG and "lateral_force" not in values:
        return f"slip angle {angle:g} deg: there is no column lateral_force_N"
    if abs(angle) > max(largest_angle, STRAIGHT_DEG):
        return f"slip angle {angle:g} deg: above {largest_angle:g} deg"
    return (
        f"slip {values['slip']:g}: the wheel does not turn"
        if slip is None or values["wheel_rate"] == 0.0
        else ""
    )


def _check_signs(
    where: str, values: Mapping[str, float], columns: Mapping[str, tuple[int, _Column]]
) -> None:
    load, rate = values["normal_load"], values["wheel_rate"]
    if load <= 0.0:
        raise WheelTableError(
            f"{where} {columns['normal_load'][1].name}: {load:g} N: a load is above zero; delete"
            " the row"
        )
    if rate < 0.0:
        raise WheelTableError(
            f"{where} {columns['wheel_rate'][1].name}: {rate:g} rad/s: positive is rolling forward;"
            " turn the sign"
        )


def _check_directions(path: Path, rows: Sequence[Row]) -> None:
    """Check the signs of whole columns: noise and datum may turn a small number's sign."""
    if (
        math.fsum(
            math.copysign(row.lateral_force, row.lateral_force * row.slip_angle)
            for row in rows
            if row.slip_angle
        )
        < 0.0
    ):
        raise WheelTableError(
            f"{path}: lateral force and slip angle have opposite signs, as if the ground pushed the"
            " wheel its way; turn one of them"
        )
    if math.fsum(row.torque for row in rows if row.slip > 0.0) < 0.0:
        raise WheelTableError(
            f"{path}: the torque is negative where the wheel slips forward: positive drives the"
            " wheel; turn the sign"
        )
    if rows and (mean := math.fsum(row.sinkage for row in rows) / len(rows)) < -DATUM_SD:
        raise WheelTableError(
            f"{path}: the mean sinkage is {mean:g} m: a wheel that sinks has a positive one; turn"
            " the sign"
        )


def _row(path: Path, trial: str, slip: float, values: Mapping[str, float], slip_speed: str) -> Row:
    """Return one steady state, without a lateral force straight ahead.

    There it is that of the testbed's misalignment, which the model does not have.
    """
    state = (values["normal_load"], values["wheel_rate"], values["sinkage"], values["drawbar_pull"])
    torque = values.get("torque", math.nan)
    angle = math.radians(values.get("slip_angle", 0.0))
    if abs(angle) <= math.radians(STRAIGHT_DEG):
        return Row(str(path), trial, slip, *state, torque=torque)
    along = 1.0 - (1.0 - slip) * math.cos(angle) if slip_speed == CARRIAGE else slip
    return Row(str(path), trial, along, *state, angle, values["lateral_force"], torque)


def rim_slip(slip: float, definition: str, radius_ratio: float = 1.0) -> float | None:
    """Return 1 - V / (r w), r of the rim, from the slip of another definition and radius.

    None where the wheel stands.
    """
    if definition != "rim" and slip < 0.0:
        if slip <= -1.0 + 1e-9:
            return None
        slip = 1.0 - 1.0 / (1.0 + slip)
    return slip if radius_ratio == 1.0 else 1.0 - (1.0 - slip) * radius_ratio


def _columns(path: Path, header: list[str]) -> dict[str, tuple[int, _Column]]:
    found: dict[str, tuple[int, _Column]] = {}
    for index, name in enumerate(field.strip() for field in header):
        if (read := _column(path, name)) is None:
            continue
        key, column = read
        if key in found:
            raise WheelTableError(
                f"{path}:1: columns {found[key][1].name!r} and {name!r} both say {key}: delete one"
                " of them"
            )
        found[key] = index, column
    for key, units in UNITS.items():
        if key not in found and key not in OPTIONAL:
            wanted = " or ".join(f"{key}_{each}" if each else key for each in units)
            raise WheelTableError(
                f"{path}:1: no column {wanted}; there are"
                f" {', '.join(header) or 'none'}{_otherwise_separated(header)}"
            )
    return found


def _column(path: Path, name: str) -> tuple[str, _Column] | None:
    """Return quantity and unit of a column; None where it is not read."""
    if name == TRIAL:
        return TRIAL, _Column(name, 1.0)
    if name.startswith("current_") and name.removeprefix("current_") not in UNITS["current"]:
        return None  # as a current's limit or deviation
    for key, units in UNITS.items():
        unit = name.removeprefix(key).removeprefix("_")
        if name == key or (name.startswith(f"{key}_") and not unit.startswith(("std", "angle"))):
            if unit not in units:
                known = ", ".join(f"{key}_{each}" if each else key for each in units)
                raise WheelTableError(
                    f"{path}:1: column {name!r}: unknown unit {unit!r}; known are {known}"
                )
            return key, _Column(name, units[unit])
    return None


def _otherwise_separated(header: list[str]) -> str:
    """Return advice for a file whose only column holds the others, as with decimal commas."""
    between = next((each for each in (";", "\t") if len(header) == 1 and each in header[0]), "")
    return (
        f"; they are separated by {between!r}: save it with commas between columns and points in"
        " numbers"
        if between
        else ""
    )


def _lines(path: Path) -> list[list[str]]:
    """Return the cells of every line."""
    table, cells = [], 0
    try:
        for row in csv_rows(path):
            cells += 1 + len(row)
            if cells > MOST_CELLS:
                raise WheelTableError(f"{path}: more than {MOST_CELLS} cells: give a part of it")
            table.append(row)
    except (UnicodeDecodeError, csv.Error) as error:
        raise WheelTableError(f"{path}: is no CSV file in UTF-8: {error}") from error
    return table


def _text(cells: list[str], index: int) -> str:
    return cells[index].strip() if index < len(cells) else ""


def _value(path: Path, number: int, cells: list[str], index: int, column: _Column) -> float:
    text = _text(cells, index)
    try:
        value = parse_number(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise WheelTableError(
            f"{path}:{number}: column {column.name}: {shortened(text)} is no finite number; correct"
            " it or delete the row"
        )
    return value * column.factor
