# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of the table: a figure, its bar, and a named reference of the same run."""

import math
from dataclasses import KW_ONLY, dataclass


@dataclass(frozen=True, slots=True)
class BenchmarkLine:
    """One figure; NaN where it could not be measured, which misses any bar."""

    what: str
    value: float
    unit: str
    bar: float | None  # None: shown without a bar
    _: KW_ONLY
    least: bool = False  # the bar is the least that is good, else the most
    reference: str
    against: float  # what the reference measured, in the same unit
    note: str = ""  # under which conditions, or why there is no figure

    @property
    def ratio(self) -> float:
        """Ratio of the value to that of the reference."""
        return self.value / self.against if self.against else math.nan

    @property
    def met(self) -> bool:
        """True where the bar is reached."""
        if self.bar is None:
            return True
        return self.value >= self.bar if self.least else self.value <= self.bar

    def record(self) -> dict[str, object]:
        """Return the line for a JSON file; null for what is not finite."""
        numbers = {
            "value": self.value,
            "bar": self.bar,
            "against": self.against,
            "ratio": self.ratio,
        }
        return {
            "what": self.what,
            "unit": self.unit,
            "bar_is": "least" if self.least else "most",
            "reference": self.reference,
            "met": self.met,
            "note": self.note,
            **{
                name: value if value is not None and math.isfinite(value) else None
                for name, value in numbers.items()
            },
        }


@dataclass(frozen=True, slots=True)
class Effort:
    """Scale of lengths and repetitions: 1 for published figures, less to test the commands."""

    scale: float = 1.0

    def count(self, full: int, least: int = 1) -> int:
        """Scale a number of repetitions."""
        return max(least, round(full * self.scale))

    def seconds(self, full: float, least: float = 1.0) -> float:
        """Scale a duration [s]."""
        return max(least, full * self.scale)
