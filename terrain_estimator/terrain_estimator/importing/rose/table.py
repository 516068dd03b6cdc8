# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read Processed_Data.csv of a trial."""

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rover_parameters.csv_rows import csv_rows
from rover_parameters.numerals import parse_number
from rover_parameters.records import nearest, shortened
from terrain_estimator.importing.rose.schema import (
    ACCELERATION,
    CURRENTS,
    ORIENTATION,
    POSITION,
    RATES,
    TIME,
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


def read_table(path: Path, options: RoseOptions) -> Trial:
    """Read a table.

    An empty cell or NaN was not measured. A row that repeats the one before is passed over.

    Raises:
        CsvError: it cannot be read, lacks a column, or has a value that cannot be; file, row,
            column and value are named.
    """
    try:
        rows = csv_rows(path, strict=True)
        table = _Table(path, options, next(rows, []))
        return table.trial(rows)
    except OSError as error:
        raise CsvError(f"{path} cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        msg = f"{path} is not a CSV file in UTF-8 ({error}): copy it again, it may be cut short"
        raise CsvError(msg) from error


class _Table:
    """The columns of a table that are needed."""

    def __init__(self, path: Path, options: RoseOptions, header: list[str]) -> None:
        self._path, self._options = path, options
        found = [name.strip() for name in header]
        self._width = len(found)
        if not any(found):
            raise CsvError(f"{path} is empty: the first row must name the columns")
        self._needed = [TIME, *POSITION, *ORIENTATION, *RATES]
        if options.torque_gain is not None:
            self._needed += CURRENTS
        if options.acceleration_axis:
            self._needed += ACCELERATION
        for name in self._needed:
            ours = options.column(name)
            if found.count(ours) > 1:
                raise CsvError(f"{path}, row 1: column {ours!r} appears twice: rename one of them")
            if ours not in found:
                raise CsvError(
                    f"{path}, row 1: no column {ours!r}: {nearest(ours, found)} If it has another"
                    f" name there, give --column {name}=NAME"
                )
        self._place = [found.index(options.column(name)) for name in self._needed]
        self._number, self._row = 1, list[str]()

    def trial(self, rows: Iterator[list[str]]) -> Trial:
        values, repeated, before = [], 0, -math.inf
        last: list[str] = []
        for self._number, self._row in enumerate(rows, start=2):
            if not self._row:
                continue
            if len(self._row) != self._width:
                raise CsvError(
                    f"{self._path}, row {self._number}: {len(self._row)} cells, but {self._width}"
                    " columns are named in row 1: copy the file again, or remove the row"
                )
            if self._row == last:
                repeated += 1
                continue
            last = self._row
            read = self._values()
            if read[0] <= before:
                what = "equal to" if read[0] == before else "earlier than"
                raise self._error(0, f"is {what} that of a row before: sort or remove such rows")
            before = read[0]
            values.append(read)
            if len(values) > LARGEST:
                raise CsvError(f"{self._path} has more than {LARGEST} rows: split it")
        if not values:
            raise CsvError(f"{self._path} has no data below row 1")
        notes = (f"{repeated} rows repeat the row before and are left out",) if repeated else ()
        return self._filled(np.array(values), notes)

    def _filled(self, values: Floats, notes: tuple[str, ...]) -> Trial:
        columns = {name: values[:, at] for at, name in enumerate(self._needed)}

        def of(*wanted: str) -> Floats:
            nothing = np.full(len(values), math.nan)
            return np.stack([columns.get(name, nothing) for name in wanted], axis=-1)

        start_ns = round(columns[TIME][0] * 1e9)
        time = columns[TIME] - columns[TIME][0]
        position, orientation = of(*POSITION), of(*ORIENTATION)
        known = np.isfinite(position).all(1) & np.isfinite(orientation).all(1)
        return Trial(
            str(self._path),
            start_ns,
            Poses(time[known], position[known], orientation[known]),
            Wheels(time, of(*RATES), of(*CURRENTS)),
            Accelerations(time, of(*ACCELERATION)),
            notes,
        )

    def _values(self) -> list[float]:
        """Return the values of a row in SI units, in the order that is needed."""
        read = [self._cell(at) for at in range(len(self._needed))]
        if math.isnan(read[0]):
            raise self._error(0, "is empty: every row needs its time")
        if not 0.0 <= read[0] <= LATEST_NS / 1e9:
            raise self._error(0, f"is outside 0 to {LATEST_NS / 1e9:.0f} s: correct the time")
        first = self._needed.index(ORIENTATION[0])
        attitude = read[first : first + 4]
        if doubt := quaternion_doubt(attitude):
            what = f"and the rest of the quaternion: it {doubt}: correct quat_x to quat_w, or leave"
            raise self._error(first, f"{what} the row's empty")
        if not any(attitude):
            read[first : first + 4] = [math.nan] * 4
        return read

    def _cell(self, at: int) -> float:
        text = self._row[self._place[at]].strip()
        if not text:
            return math.nan
        try:
            value = parse_number(text)
        except ValueError:
            advice = "is no number: correct it, or leave the cell empty"
            raise self._error(at, advice) from None
        name = self._needed[at]
        if name in POSITION:
            value *= factor("length", self._options.position_unit)
        if name in RATES:
            value *= factor("wheel rate", self._options.rate_unit)
        if at and abs(value) > FARTHEST:
            advice = "cannot be: correct it, or leave the cell empty where nothing was measured"
            raise self._error(at, advice)
        return value

    def _error(self, at: int, what: str) -> CsvError:
        return CsvError(
            f"{self._path}, row {self._number}, column {self._options.column(self._needed[at])!r}:"
            f" {shortened(self._row[self._place[at]])} {what}"
        )
