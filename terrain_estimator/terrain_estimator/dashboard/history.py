# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rows over time in constant memory: the newest ones, or the whole drive ever more coarsely."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

Row = tuple[float | None, ...]
"""Time [s] and the values of the columns; None for an unknown value."""
_ROUNDING = 1e-3  # of a period


@dataclass(slots=True)
class ChartHistory:
    """At most ``capacity`` rows, at least ``period_s`` apart.

    When they are too many, the oldest is removed; or, to keep the whole drive, rows are merged in
    pairs and the period doubles. A row stands for all samples of its period: the last value of each
    column, the largest for the columns in ``worst``, the mean for those in ``mean``.
    """

    period_s: float
    capacity: int
    whole: bool
    worst: frozenset[int] = frozenset()
    mean: frozenset[int] = frozenset()
    # of the rows: grows when rows that were sent have changed
    generation: int = 0
    _rows: list[Row] = field(default_factory=list)
    _first: int = 0  # number of the oldest row
    _open: Row | None = None  # row of the current period
    _known: Sequence[int] = ()  # number of values in each column of that row

    @property
    def end(self) -> int:
        """Number of the next row."""
        return self._first + len(self._rows)

    def add(self, sample: Row) -> None:
        """Add the values of a time not before the last one."""
        known = [int(value is not None) for value in sample]
        if self._open is not None and self._period_of(sample) == self._period_of(self._open):
            self._open = self._merged(self._open, sample, self._known)
            self._known = [before + now for before, now in zip(self._known, known, strict=True)]
            return
        if self._open is not None:
            self._append(self._open)
        self._open, self._known = sample, known

    def since(self, number: int) -> Sequence[Row]:
        """Return the rows from this number on that are still kept."""
        return self._rows[max(number - self._first, 0) :]

    def _period_of(self, row: Row) -> int:
        """Return the number of a row's period; stamps at its very end may be rounded down."""
        return math.floor((row[0] or 0.0) / self.period_s + _ROUNDING)

    def _append(self, row: Row) -> None:
        self._rows.append(self._rounded(row))
        if len(self._rows) <= self.capacity:
            return
        if self.whole:
            self._halve()
        else:
            del self._rows[0]
            self._first += 1

    def _halve(self) -> None:
        pairs = zip(self._rows[::2], self._rows[1::2], strict=False)
        odd = self._rows[-1:] if len(self._rows) % 2 else []
        self._rows = [
            self._rounded(self._merged(*pair, [1] * len(pair[0]))) for pair in pairs
        ] + odd
        self.period_s *= 2.0
        self.generation += 1

    def _merged(self, earlier: Row, later: Row, weights: Sequence[int]) -> Row:
        """Merge two rows; ``weights`` are the numbers of values in the earlier one's columns."""
        return tuple(
            self._value(column, *values)
            for column, values in enumerate(zip(earlier, later, weights, strict=True))
        )

    def _rounded(self, row: Row) -> Row:
        """Round means to the digits of samples, since every digit is sent to every page."""
        return tuple(
            value if value is None or column not in self.mean else float(f"{value:.7g}")
            for column, value in enumerate(row)
        )

    def _value(
        self, column: int, earlier: float | None, later: float | None, weight: int
    ) -> float | None:
        if column in self.worst:
            return max((each for each in (earlier, later) if each is not None), default=None)
        if column not in self.mean:
            return later
        if earlier is None or later is None:
            return earlier if later is None else later
        # the difference of two huge values would be infinite
        return earlier - earlier / (weight + 1) + later / (weight + 1)
