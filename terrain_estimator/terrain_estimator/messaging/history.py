# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""History of a run in bounded memory: sums over spans of equally many observations."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from terrain_estimator.intervals import HALF_WIDTH_95
from terrain_estimator.messaging.health import normalized_innovation
from terrain_estimator.messaging.settled import SettledOutcomes
from terrain_estimator.observation import Floats
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Estimate, Update


@dataclass(slots=True)
class Errors:
    """Sums over velocity predictions that could be compared with a measurement."""

    count: int = 0
    squared: float = 0.0  # [m^2/s^2] innovations
    variance: float = 0.0  # [m^2/s^2] that was predicted for them
    inside_68: int = 0  # innovations within one predicted deviation
    inside_95: int = 0

    def add(self, innovation: float, variance: float) -> None:
        """Count one; NaN means that nothing was predicted or measured."""
        if not (math.isfinite(innovation) and variance > 0.0):
            return
        squared = innovation * innovation
        self.count += 1
        self.squared += squared
        self.variance += variance
        self.inside_68 += squared <= variance
        self.inside_95 += squared <= HALF_WIDTH_95 * HALF_WIDTH_95 * variance

    def __add__(self, other: "Errors") -> "Errors":
        return Errors(
            self.count + other.count,
            self.squared + other.squared,
            self.variance + other.variance,
            self.inside_68 + other.inside_68,
            self.inside_95 + other.inside_95,
        )

    @property
    def rms(self) -> float:
        """[m/s] Root mean square innovation; NaN without any."""
        return math.sqrt(self.squared / self.count) if self.count else math.nan

    @property
    def predicted_rms(self) -> float:
        """[m/s] Root mean square innovation that the predicted variances imply; NaN without any."""
        return math.sqrt(self.variance / self.count) if self.count else math.nan


@dataclass(slots=True)
class UpdateSpan:
    """Consecutive observations: the estimate after the last of them, sums over all others.

    Observations are counted by their outcome in the span in which their second ends.
    """

    stamp_ns: int
    estimate: Estimate
    disagrees: bool = False  # whether that estimate is the prior's, as the model does not fit
    count: int = 0  # observations
    change_probability: float = math.nan  # the largest
    errors: Errors = field(default_factory=Errors)
    outcomes: Counter[Outcome] = field(default_factory=Counter)
    nis_sum: float = 0.0  # [1] normalised innovations squared
    nis_count: int = 0

    def add(self, update: Update, settled: Counter[Outcome]) -> None:
        """Add one more observation, and the outcomes that it settles."""
        self.count += 1
        self.stamp_ns, self.estimate = update.stamp_ns, update.estimate
        self.disagrees = bool(update.disagreements)
        self.change_probability = _larger(
            self.change_probability, update.estimate.change_probability
        )
        self.errors.add(update.prediction.innovation, update.prediction.innovation_variance)
        if settled:
            self.outcomes += settled
        nis = normalized_innovation(update)
        if math.isfinite(nis):
            self.nis_sum += nis
            self.nis_count += 1

    def __add__(self, later: "UpdateSpan") -> "UpdateSpan":
        return UpdateSpan(
            later.stamp_ns,
            later.estimate,
            later.disagrees,
            self.count + later.count,
            _larger(self.change_probability, later.change_probability),
            self.errors + later.errors,
            self.outcomes + later.outcomes,
            self.nis_sum + later.nis_sum,
            self.nis_count + later.nis_count,
        )

    @property
    def nis(self) -> float:
        """[1] Mean normalised innovation squared, near 1 when consistent; NaN without any."""
        return self.nis_sum / self.nis_count if self.nis_count else math.nan


class _Addable(Protocol):
    """A span of any kind."""

    @property
    def count(self) -> int: ...

    def __add__(self, later: Self) -> Self: ...


SpanT = TypeVar("SpanT", bound=_Addable)


class Spans(Generic[SpanT]):
    """Spans, oldest first.

    When they are too many, neighbours are merged in pairs, and later spans hold twice as much.
    """

    def __init__(self, capacity: int = 400) -> None:
        """Set the largest number of spans, which must be even."""
        self._capacity, self._length = capacity, 1
        self.spans: list[SpanT] = []

    def room(self, make: Callable[[], SpanT]) -> SpanT:
        """Return the span for the next observation: the last one, or a new one from ``make``."""
        if not self.spans or self.spans[-1].count == self._length:
            if len(self.spans) == self._capacity:
                self.spans = [
                    one + other
                    for one, other in zip(self.spans[::2], self.spans[1::2], strict=True)
                ]
                self._length *= 2
            self.spans.append(make())
        return self.spans[-1]


class RunHistory(Spans[UpdateSpan]):
    """Sums over the updates of a run."""

    first_ns = 0

    def __init__(self, capacity: int = 400) -> None:
        """Start without an update; ``capacity`` must be even."""
        super().__init__(capacity)
        self.settled = SettledOutcomes()

    def add(self, update: Update) -> None:
        """Add the next update."""
        if not self.spans:
            self.first_ns = update.stamp_ns
        self.room(lambda: UpdateSpan(update.stamp_ns, update.estimate)).add(
            update, self.settled.add(update)
        )


@dataclass(slots=True)
class WheelSpan:
    """Consecutive messages about wheels, summed by wheel name."""

    stamp_ns: int = 0  # of the last
    count: int = 0  # messages
    sums: dict[str, float] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)  # finite values

    def add(self, stamp_ns: int, measured: Sequence[tuple[str, float]]) -> None:
        """Add one more message; NaN means that the wheel was not measured."""
        self.stamp_ns, self.count = stamp_ns, self.count + 1
        for wheel, value in measured:
            if math.isfinite(value):
                self.sums[wheel] = self.sums.get(wheel, 0.0) + float(value)
                self.counts[wheel] += 1

    def add_rows(self, stamp_ns: int, wheels: Sequence[str], values: Floats) -> None:
        """Add messages [n, wheels], the last of which has the stamp: the sums are those of add."""
        self.stamp_ns, self.count = stamp_ns, self.count + len(values)
        known = np.isfinite(values)
        starts = [self.sums.get(wheel, 0.0) for wheel in wheels]
        # one after the other: the order fixes every bit
        sums = np.add.accumulate(np.vstack([starts, np.where(known, values, 0.0)]))[-1].tolist()
        for wheel, total, count in zip(wheels, sums, known.sum(axis=0).tolist(), strict=True):
            if count:
                self.sums[wheel] = total
                self.counts[wheel] += count

    def __add__(self, later: "WheelSpan") -> "WheelSpan":
        sums = {
            wheel: self.sums.get(wheel, 0.0) + later.sums.get(wheel, 0.0)
            for wheel in {**self.sums, **later.sums}
        }
        return WheelSpan(later.stamp_ns, self.count + later.count, sums, self.counts + later.counts)

    def mean(self, wheel: str) -> float:
        """Return the mean of a wheel's finite values; NaN where there are none."""
        return self.sums[wheel] / self.counts[wheel] if wheel in self.sums else math.nan


class WheelHistory(Spans[WheelSpan]):
    """History of one quantity of a rover's wheels."""

    def __init__(self, wheels: Sequence[str] = (), capacity: int = 120) -> None:
        """Choose the ``wheels`` to keep, by name; ``capacity`` must be even."""
        super().__init__(capacity)
        self.wheels = tuple(wheels)

    def add(self, stamp_ns: int, wheels: Sequence[str], values: Sequence[float]) -> None:
        """Add the next message; it may name other wheels, in any order."""
        known = [pair for pair in zip(wheels, values, strict=False) if pair[0] in self.wheels]
        self.room(WheelSpan).add(stamp_ns, known)

    def add_rows(self, stamps_ns: Sequence[int], wheels: Sequence[str], values: Floats) -> None:
        """Add the next messages, whose names are all in use and each once, values [n, wheels]."""
        done = 0
        while done < len(stamps_ns):
            span = self.room(WheelSpan)
            end = min(done + self._length - span.count, len(stamps_ns))
            span.add_rows(stamps_ns[end - 1], wheels, values[done:end])
            done = end


def _larger(one: float, other: float) -> float:
    """Return the larger of two numbers; NaN where both are."""
    return other if math.isnan(one) else one if math.isnan(other) else max(one, other)
