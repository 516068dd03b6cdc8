# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Formatted numbers, each in a ``<data>`` element whose value is the number in full."""

import math
from collections.abc import Sequence

from markupsafe import Markup

from terrain_estimator.intervals import HALF_WIDTH_95

DIGITS = 3
"""Significant digits of a number without a deviation."""
_MINUS = "\N{MINUS SIGN}"
_ABSENT = Markup('<span class="absent">not known</span>')


def number(value: float | None, unit: str = "", digits: int = DIGITS) -> Markup:
    """Format a number with its unit; None for an unknown one. An int keeps all its digits."""
    if value is None or not math.isfinite(value):
        return _ABSENT
    return _data(value, str(value) if isinstance(value, int) else _shown(value, digits)) + _unit(
        unit
    )


def finite(value: float) -> float | None:
    """Return a number that is finite; None in its place otherwise."""
    return float(value) if math.isfinite(value) else None


def interval(
    mean: float, sd: float, unit: str = "", limits: tuple[float, float] | None = None
) -> Markup:
    """Format a mean with its deviation, to two digits of the latter, and the 95 % interval.

    The interval is that of a Gaussian, unless ``limits`` are given.
    """
    places = _places(sd)
    low, high = (
        _fixed(limit, places)
        for limit in limits or (mean - HALF_WIDTH_95 * sd, mean + HALF_WIDTH_95 * sd)
    )
    shown = Markup("{} ± {}").format(
        _data(mean, _fixed(mean, places)), _data(sd, _fixed(sd, places))
    )
    return (
        shown
        + _unit(unit)
        + Markup(' <span class="range">(95 % interval {} to {})</span>').format(low, high)
    )


def probability(value: float) -> Markup:
    """Format in per cent; an almost certain value is not rounded to certainty."""
    percent = 100.0 * value
    shown = "< 0.1" if percent < 0.1 else "> 99.9" if percent > 99.9 else f"{percent:.1f}"
    return _data(value, f"{shown}\N{NO-BREAK SPACE}%")


def chance(value: float) -> Markup:
    """Format a p value."""
    return _data(value, "< 1e-6" if value < 1e-6 else f"{value:.2g}")


def words(items: Sequence[str], last: str = "and") -> str:
    """Join words: ``a, b and c``."""
    return f" {last} ".join(filter(None, (", ".join(items[:-1]), *items[-1:])))


def _data(value: float, shown: str) -> Markup:
    return Markup('<data value="{}">{}</data>').format(repr(float(value)), shown)


def _unit(unit: str) -> Markup:
    return Markup("&nbsp;{}").format(unit) if unit not in {"", "1"} else Markup("")


def _shown(value: float, digits: int) -> str:
    """Format with significant digits, without an exponent in the usual range."""
    if value == 0.0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits}g}".replace("-", _MINUS)
    return _fixed(value, max(0, digits - 1 - math.floor(math.log10(abs(value)))))


def _places(sd: float) -> int:
    """Return the number of decimal places that show two digits of a deviation."""
    return max(0, 1 - math.floor(math.log10(sd))) if sd > 0.0 else DIGITS


def _fixed(value: float, places: int) -> str:
    text = f"{value:.{places}f}"
    return text.replace("-", _MINUS if float(text) else "")  # no minus before a zero
