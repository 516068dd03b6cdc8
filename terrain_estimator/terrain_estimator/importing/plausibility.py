# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Check imported values against the rover file: most values of a column must be possible.

A unit that the mapping gives wrong changes a whole column by a known factor. So a column is judged
by its median, and the error names the unit that would make it possible. Single values outside their
range are left to the estimator, which refuses their observations.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from terrain_estimator.importing.mapping import BODY_SIGNALS, WHEEL_SIGNALS, Mapping
from terrain_estimator.importing.samples import MeasuredValue, TableSample
from terrain_estimator.importing.units import UNITS, factor
from terramechanics.vehicle.rover import Rover

KEPT = 4096
"""Largest number of values of a column that are kept for its median."""
FEWEST = 5
"""Rows below which nothing is judged: an error in one row is not one of the unit."""
_SLOWEST_RIM = 0.01  # [m/s] of a wheel that turns
_SAME = 1.3  # [1] ratio up to which two velocities agree with a factor between units
_DIFFERENT = 2.5  # [1] ratio from which they contradict each other
_TURNING = 0.2  # [1] difference of the rates of left and right wheels in a turn
_ALIKE = 0.7  # [1] correlation from which slopes show in the acceleration
_ON_SLOPES = 50  # rows below which they are not looked for
_STRONGEST = 15.0  # [1] torque over that of a wheel that pulls 0.3 of its load


class Thinned:
    """A share of a column's values, evenly spread, in bounded memory."""

    def __init__(self) -> None:
        """Start without values."""
        self.values: list[float] = []
        self._every, self._count = 1, 0

    def add(self, value: float) -> None:
        """Add a value; NaN is none."""
        if math.isnan(value):
            return
        if self._count % self._every == 0:
            self.values.append(value)
            if len(self.values) > KEPT:
                self.values, self._every = self.values[::2], 2 * self._every
        self._count += 1

    @property
    def median(self) -> float:
        """Median of the values; NaN with fewer than FEWEST."""
        return statistics.median(self.values) if len(self.values) >= FEWEST else math.nan


@dataclass(frozen=True, slots=True)
class _Limit:
    """Largest possible magnitude of a signal, in SI."""

    largest: float
    words: str


def limits(rover: Rover) -> dict[str, _Limit]:
    """Return the largest possible magnitude of each signal on a rover."""
    quarter = math.pi / 2.0
    pulling = 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)
    return {
        "slip": _Limit(1.0, "above 1, that of a wheel that spins on the spot"),
        "sinkage": _Limit(rover.wheel_radius, f"above the wheel radius {rover.wheel_radius:g} m"),
        "contact_angle": _Limit(quarter, "steeper than a wall"),
        "pitch": _Limit(quarter, "steeper than a wall"),
        "roll": _Limit(quarter, "further than a rover leans"),
        "lateral_velocity": _Limit(100.0, "above 100 m/s"),
        "yaw_rate": _Limit(2.0 * math.pi, "more than a turn in a second"),
        "bogie_angle": _Limit(quarter, "further than a bogie turns"),
        "steering": _Limit(quarter, "further than a wheel is steered"),
        "wheel_rate": _Limit(100.0 / rover.wheel_radius, "a rim of more than 100 m/s"),
        "velocity": _Limit(100.0, "above 100 m/s"),
        "torque": _Limit(
            _STRONGEST * pulling,
            f"above {_STRONGEST * pulling:.3g} N m, {_STRONGEST:g} times that of a wheel that pulls"
            " 0.3 of its load",
        ),
        "acceleration": _Limit(
            3.0 * rover.gravity, f"above three times gravity, {rover.gravity:g} m/s^2"
        ),
    }


@dataclass(slots=True)
class Plausibility:
    """Medians of all columns of a file, and of the velocity over that of the wheels."""

    mapping: Mapping
    rover: Rover
    _columns: dict[tuple[str, str], Thinned] = field(default_factory=dict)
    _ratios: Thinned = field(default_factory=Thinned)
    _over_slip: Thinned = field(default_factory=Thinned)
    _gravity: Thinned = field(default_factory=Thinned)  # [m/s^2] g sin(pitch)
    _felt: Thinned = field(default_factory=Thinned)  # [m/s^2] acceleration at the same instants

    def watch(self, samples: Iterable[TableSample]) -> Iterator[TableSample]:
        """Yield the samples and remember what is needed to judge them."""
        for sample in samples:
            for signal, column, value in self._values(sample):
                self._columns.setdefault((signal, column), Thinned()).add(value)
            self._compare(sample)
            felt, pitch = sample.acceleration.value, sample.pitch.value
            if math.isfinite(felt) and math.isfinite(pitch):
                self._felt.add(felt)
                self._gravity.add(self.rover.gravity * math.sin(pitch))
            yield sample

    def faults(self) -> Iterator[str]:
        """Yield what makes the file impossible, column by column, then between the columns."""
        largest = limits(self.rover)
        for (signal, column), kept in self._columns.items():
            values = [abs(value) for value in kept.values if value or signal != "steering"]
            median = statistics.median(values) if values else 0.0
            if len(kept.values) >= FEWEST and median > largest[signal].largest:
                yield self._beyond(signal, column, median, largest[signal])
        if not math.isnan(ratio := self._ratios.median):
            yield from self._contradiction(ratio)
        yield from self._against_gravity()

    def _values(self, sample: TableSample) -> Iterator[tuple[str, str, float]]:
        for signal in filter(self.mapping.measures, WHEEL_SIGNALS):
            values = getattr(sample, signal)
            for column, value in zip(self.mapping.columns(signal), values, strict=True):
                if column:
                    yield signal, column, _number(value)
        for signal in BODY_SIGNALS:
            if self.mapping.measures(signal):
                column = getattr(self.mapping, signal).column
                yield signal, column, _number(getattr(sample, signal))

    def _compare(self, sample: TableSample) -> None:
        """Compare the velocity with that of each wheel that turns, r w (1 - i).

        Hubs move otherwise than the body where the rover turns.
        """
        if self._turns(sample):
            return
        for rate, slip in zip(sample.wheel_rate, sample.slip, strict=True):
            rim = rate * self.rover.wheel_radius
            if not abs(rim) >= _SLOWEST_RIM or not slip.value < 1.0:
                continue
            self._ratios.add(sample.velocity.value / (rim * (1.0 - slip.value)))
            measured = 1.0 - sample.velocity.value / rim
            if slip.value and abs(measured) > 0.05:  # clear of noise
                self._over_slip.add(measured / slip.value)

    def _turns(self, sample: TableSample) -> bool:
        """Return whether left and right wheels turn differently."""
        sides = {wheel.name: wheel.side for wheel in self.rover.wheels}
        rates: dict[str, list[float]] = {"left": [], "right": []}
        for wheel, rate in zip(self.mapping.wheels, sample.wheel_rate, strict=True):
            if math.isfinite(rate):
                rates[sides[wheel.name]].append(rate)
        if not all(rates.values()):
            return False
        left, right = (statistics.fmean(each) for each in rates.values())
        return abs(left - right) > _TURNING * max(abs(left), abs(right))

    def _beyond(self, signal: str, column: str, median: float, limit: _Limit) -> str:
        stated = getattr(self.mapping, signal).unit
        quantity = (WHEEL_SIGNALS | BODY_SIGNALS)[signal]
        size = factor(quantity, stated)
        shown = f"{median / size:.4g}" + ("" if stated == "1" else f" {stated}")
        fitting = _fitting(quantity, stated, lambda other: median / size * other <= limit.largest)
        advice = (
            f"set {signal}.unit: {' or '.join(map(_quoted, fitting))} in the mapping"
            if fitting
            else f"correct {signal}.unit in the mapping, or the rover (--rover)"
        )
        return f"column {column!r}: {signal} is {shown} in the median, {limit.words}: {advice}"

    def _contradiction(self, ratio: float) -> Iterator[str]:
        """Name the unit that explains why the wheels and the velocity contradict each other."""
        slip = self._over_slip.median
        if "slip" in self._signals() and _near(slip, 100.0):
            yield (
                f"slip: the velocity and the wheel rates give {slip:.3g} times as much: set"
                ' slip.unit: "1" in the mapping'
            )
            return
        if ratio == 0.0 or 1.0 / _DIFFERENT < ratio < _DIFFERENT:
            return
        if ratio < 0.0:
            yield (
                "velocity and wheel_rate have opposite signs: change the sign of one of the columns"
            )
            return
        explaining = [
            f"{signal}.unit: {unit}"
            for signal, wanted in (("velocity", 1.0 / ratio), ("wheel_rate", ratio))
            for unit in self._scaled(signal, wanted)
        ]
        if explaining:
            yield (
                f"velocity is {ratio:.3g} times that of the wheels, r w (1 - slip) with"
                f" r = {self.rover.wheel_radius:g} m: set {' or '.join(explaining)} in the mapping,"
                " or give the right rover (--rover)"
            )

    def _against_gravity(self) -> Iterator[str]:
        """Name the sign or the unit by which the acceleration is not that of gravity on slopes.

        Level ground, or noise that hides the slopes, tells neither.
        """
        pull, felt = self._gravity.values, self._felt.values
        if len(pull) < _ON_SLOPES or not min(map(statistics.pvariance, (pull, felt))) > 0.0:
            return
        alike = statistics.correlation(pull, felt)
        if abs(alike) < _ALIKE:
            return
        if alike < 0.0:
            yield (
                "pitch and acceleration have opposite signs, but a rover that stands nose up feels"
                " a positive acceleration: give the other pitch.positive in the mapping, or change"
                " the sign of one of the columns"
            )
            return
        # both have noise: a slope of one over the other would be too small
        ratio = statistics.pstdev(felt) / statistics.pstdev(pull)
        units = self._scaled("acceleration", 1.0 / ratio)
        if not 1.0 / _DIFFERENT < ratio < _DIFFERENT and units:
            yield (
                f"acceleration is {ratio:.3g} times that of gravity on the slopes, g sin(pitch):"
                f" set acceleration.unit: {' or '.join(units)} in the mapping"
            )

    def _scaled(self, signal: str, wanted: float) -> list[str]:
        """Return the units whose size is ``wanted`` times that of the stated one."""
        stated, quantity = getattr(self.mapping, signal).unit, signal.replace("_", " ")
        size = factor(quantity, stated)
        return _fitting(quantity, stated, lambda other: _near(other / size, wanted))

    def _signals(self) -> set[str]:
        return {signal for signal, _ in self._columns}


def _number(value: MeasuredValue | float) -> float:
    return value.value if isinstance(value, MeasuredValue) else value


def _quoted(unit: str) -> str:
    """Return a unit as YAML takes it for a text."""
    return unit if unit[0].isalpha() else f'"{unit}"'


def _near(value: float, wanted: float) -> bool:
    return wanted / _SAME < value < wanted * _SAME


def _fitting(quantity: str, stated: str, fits: Callable[[float], bool]) -> list[str]:
    """Return the other units of a quantity whose size fits."""
    return [unit for unit, size in UNITS[quantity].items() if unit != stated and fits(size)]
