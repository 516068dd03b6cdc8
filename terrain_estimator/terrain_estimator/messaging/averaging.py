# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bring readings of any rate to the model's 10 Hz, by their stamps alone.

The model is of steps of 0.1 s: blocks of ten, a velocity filter with a forecast one step ahead.
Readings near 10 Hz and slower pass unchanged. Faster ones are averaged over each tenth of a second.
The standard deviation of a mean of n readings is sqrt(SUM sd^2) / n: their errors are taken as
independent. The mean has the stamp of its last reading.

Until the rate is known, the first reading passes at once. Where the next ones come too soon for
10 Hz they wait; as soon as they prove to be fast, the first reading is withdrawn and averaged with
them. So 10 Hz data are never late, and fast data are averaged from the first reading on.
"""

import dataclasses
import itertools
import math
import statistics
from bisect import bisect_right
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.configured import as_configured, possible_bogie
from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.estimator.screening import Screening, screen
from terrain_estimator.estimator.wheel_faults import NOISE_BOUND
from terrain_estimator.messaging.conversion import Conversion, Mark
from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Floats, Observation
from terrain_estimator.outcome import Outcome
from terramechanics.vehicle.rover import Rover

STEP_NS = 100_000_000
"""[ns] Step of the model."""
SLOWEST_HZ, FASTEST_HZ = 5.0, 200.0
"""Range of rates that can be used; below, the velocities of two readings are not linked."""
MARGIN = 1.1
"""[1] Factor by which a rate may exceed a limit: rates are measured with jitter."""
FAST_NS = 0.87 * STEP_NS
"""[ns] Readings with a shorter mean interval are averaged."""
_NORMAL_NS = 0.92 * STEP_NS  # from this mean interval on readings pass again
_HIGHEST_HZ = 10_000  # that is counted as such
_FASTEST_NORMAL = 0.15  # [1] deviation from 10 Hz that needs no words
_INTERVALS = 8  # that decide at the start
_WINDOW = 20  # intervals that decide later
_GAP = 2.5  # [medians] a longer interval is a gap and no part of the rate
_DEVIATIONS = {name for name in (*AXLE_FIELDS, *SCALAR_FIELDS) if name.endswith("_sd")}


class Treatment(IntEnum):
    """Treatment of the readings, by their rate."""

    PASS = 0
    AVERAGE = 1
    REFUSE = 2


@dataclass(frozen=True, slots=True)
class Rate:
    """Rate of the readings, and what is done about it."""

    hz: float  # NaN until enough readings have come
    treatment: Treatment

    @property
    def is_normal(self) -> bool:
        """Return whether the readings come at about 10 Hz."""
        return abs(self.hz * STEP_NS * 1e-9 - 1.0) < _FASTEST_NORMAL

    @property
    def rounded(self) -> float:
        """Rate [Hz] to three digits."""
        return float(f"{self.hz:.3g}")

    def __str__(self) -> str:
        """Return the rate and its treatment in words."""
        if math.isnan(self.hz):
            return "rate unknown"
        found = f"{self.rounded:g} Hz"
        if self.treatment is Treatment.REFUSE:
            return (
                f"{found}, but {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz are needed: record faster, or"
                " thin the readings out"
            )
        if self.treatment is Treatment.AVERAGE:
            return f"{found}, averaged to 10 Hz, with errors taken as independent"
        return found


class RateCounts:
    """Numbers of readings by their rate."""

    def __init__(self) -> None:
        """Start without a reading."""
        self._counts: Counter[tuple[Treatment, int]] = Counter()  # bounded by the rates in whole Hz
        self._unknown = 0  # readings before the first rate was known

    def add(self, rate: Rate) -> None:
        """Count a reading at a rate; the readings before the first known rate belong to it."""
        self._unknown += 1
        if not math.isnan(rate.hz):
            self._counts[rate.treatment, min(round(rate.hz), _HIGHEST_HZ)] += self._unknown
            self._unknown = 0

    def found(self) -> list[tuple[Rate, int]]:
        """Return the most frequent rate of each treatment, with all readings treated so."""
        result = []
        for treatment in Treatment:
            own = {hz: count for (each, hz), count in self._counts.items() if each is treatment}
            if own:
                common = max(own, key=lambda hz: own[hz])
                result.append((Rate(float(common), treatment), sum(own.values())))
        return result

    def lines(self) -> list[str]:
        """Return what was found in words; nothing where all readings came at about 10 Hz."""
        found = self.found()
        if len(found) == 1 and found[0][0].treatment is Treatment.PASS and found[0][0].is_normal:
            return []
        return [f"{count} readings at {rate}" for rate, count in found]


class RateWindow:
    """The intervals between the last stamps, and the rate that follows from them."""

    def __init__(self) -> None:
        """Start without a stamp."""
        self._intervals: deque[int] = deque(maxlen=_WINDOW)
        self._last_ns: int | None = None
        self.interval_ns = float(STEP_NS)
        """Mean interval [ns] without gaps; that of the model where there is none."""
        self.treatment = Treatment.PASS

    def add(self, stamp_ns: int) -> None:
        """Add a stamp that is after the last one, and judge the rate anew."""
        last_ns, self._last_ns = self._last_ns, stamp_ns
        if last_ns is None:
            return
        self._intervals.append(stamp_ns - last_ns)
        ordered = sorted(self._intervals)
        longest = _GAP * statistics.median(ordered)
        # a mean of neighbouring intervals hardly depends on jitter, which cancels in their sum
        self.interval_ns = statistics.fmean(ordered[: bisect_right(ordered, longest)])
        if self.is_known:
            self.treatment = self._judged()

    @property
    def is_known(self) -> bool:
        """Return whether there are enough stamps for a decision."""
        return len(self._intervals) >= _INTERVALS

    @property
    def rate(self) -> Rate:
        """Rate of the last readings."""
        return Rate(1e9 / self.interval_ns if self.is_known else math.nan, self.treatment)

    def _judged(self) -> Treatment:
        # lost messages make long intervals: data are slow only where every interval is long
        if min(self._intervals) * SLOWEST_HZ > MARGIN * 1e9:
            return Treatment.REFUSE
        if self.interval_ns * FASTEST_HZ * MARGIN < 1e9:
            return Treatment.REFUSE
        limit_ns = _NORMAL_NS if self.treatment is Treatment.AVERAGE else FAST_NS
        return Treatment.AVERAGE if self.interval_ns < limit_ns else Treatment.PASS


class Averager:
    """Pass, average or refuse the readings of one rover; its memory is that of one step."""

    def __init__(
        self, rover: Rover, config: CoreConfig, wheels: SingleWheels | None = None
    ) -> None:
        """Start without a reading; a reading enters a mean as ``config`` lets it be used.

        ``wheels`` are those of a model by wheel.
        """
        # noise must not sort the readings of a turn: the estimator judges their mean
        self._config = dataclasses.replace(config, roll_limit=0.0, turn_limit=0.0)
        self._rover, self._wheels = rover, wheels
        self.reset()

    def reset(self) -> None:
        """Forget the rate and the readings that wait."""
        self._window = RateWindow()
        self._decided = False  # whether the rate is known
        self._withdraws = False  # whether what comes next replaces what has passed
        self._first: Conversion | None = None  # the only one that passed; None after others did
        self._waiting: list[Conversion] = []
        self._last_ns = -1
        self._begins = True  # whether the last stamp was the first
        self._end_ns = -math.inf  # of the step that is being averaged

    @property
    def rate(self) -> Rate:
        """Rate of the last readings."""
        return self._window.rate

    def add(self, reading: Conversion) -> list[Conversion]:
        """Add a reading; return what the estimator takes now, by increasing stamp."""
        return [reading] if self.passes(reading.stamp_ns) else self.take(reading)

    def passes(self, stamp_ns: int) -> bool:
        """Note the stamp of the next reading; return whether the estimator takes it as it is.

        Otherwise the reading itself must follow, by :meth:`take`.
        """
        if stamp_ns <= self._last_ns:
            self.reset()  # the clock was set back
        self._begins, self._last_ns = self._last_ns < 0, stamp_ns
        self._window.add(stamp_ns)
        waits = self._waiting or self._withdraws
        return self._decided and not waits and self._window.treatment is Treatment.PASS

    def take(self, reading: Conversion) -> list[Conversion]:
        """Add a reading that does not pass; return what the estimator takes now."""
        if self._begins:
            self._first = reading
            return [reading._replace(mark=Mark.FIRST)]
        if self._decided:
            return self._marked(self._treated([reading]))
        self._waiting.append(reading)
        if self._window.is_known:
            return self._marked(self._decide())
        return [] if self._window.interval_ns < FAST_NS else self._pass()

    def flush(self) -> list[Conversion]:
        """Return the readings that still wait, at the end of the input; the rate is forgotten."""
        waiting = self._waiting
        if waiting and self._decided:
            waiting = self._marked([self._mean(waiting)])
        self.reset()
        return waiting

    def _pass(self) -> list[Conversion]:
        passed, self._waiting, self._first = self._waiting, [], None
        return passed

    def _decide(self) -> list[Conversion]:
        """Treat the readings that waited; fast ones, and those to refuse, withdraw the first."""
        self._decided = True
        treatment, first = self._window.treatment, self._first
        readings = self._pass()
        if treatment is Treatment.AVERAGE and first is not None:
            readings = [first, *readings]
        self._withdraws = treatment is Treatment.REFUSE or (
            treatment is Treatment.AVERAGE and first is not None
        )
        return self._treated(readings)

    def _marked(self, taken: list[Conversion]) -> list[Conversion]:
        if taken and self._withdraws:
            taken[0] = taken[0]._replace(mark=Mark.WITHDRAWS)
            self._withdraws = False
        return taken

    def _treated(self, readings: list[Conversion]) -> list[Conversion]:
        treatment = self._window.treatment
        if treatment is Treatment.AVERAGE:
            return [each for reading in readings for each in self._averaged(reading)]
        left, self._waiting = self._waiting, []  # of a step that began at a higher rate
        taken = [self._mean(left)] if left else []
        if treatment is Treatment.PASS:
            return [*taken, *readings]
        detail = f"rate: {self._window.rate}"
        return taken + [
            Conversion(each.stamp_ns, None, Outcome.OUT_OF_RANGE, detail) for each in readings
        ]

    def _averaged(self, reading: Conversion) -> Iterator[Conversion]:
        """Add a reading to the open step; yield the mean of each step that ends."""
        half_ns = self._window.interval_ns / 2.0
        if reading.stamp_ns > self._end_ns + half_ns:  # at the start, and after a gap
            if self._waiting:
                yield self._mean(self._waiting)
            self._waiting, self._end_ns = [], reading.stamp_ns - 2.0 * half_ns + STEP_NS
        self._waiting.append(reading)
        if reading.stamp_ns >= self._end_ns - half_ns:
            yield self._mean(self._waiting)
            self._waiting, self._end_ns = [], self._end_ns + STEP_NS

    def _mean(self, readings: list[Conversion]) -> Conversion:
        """Return the mean of the readings that can be used; the last one where none can."""
        last = readings[-1]
        screened = [self._screen(each.observation) for each in readings if each.observation]
        usable = [each.observation for each in screened if each.outcome.used]
        # sinkages from another ground have no common mean
        usable = [each for each in usable if each.local == usable[-1].local]
        if not usable:
            return last
        notes = [*last.notes, f"mean of {len(usable)} readings at {self._window.rate.rounded:g} Hz"]
        if len(usable) < len(readings):
            reasons = [each.detail for each in readings if each.detail]
            reasons += [each.detail for each in screened if not each.outcome.used]
            notes.append(f"{len(readings) - len(usable)} left out: {reasons[0]}")
        return Conversion(last.stamp_ns, mean(usable, last.stamp_ns), notes=tuple(notes))

    def _screen(self, reading: Observation) -> Screening:
        """Screen a reading as the estimator does, but let noise leave the range.

        Readings that noise puts outside the model's range belong to the mean: without them it would
        be biased. The estimator screens the mean, and supposes its missing contact angles, because
        what is supposed is no better for the mean of many.
        """
        config, rover = self._config, self._rover
        given = reading
        if reading.local:  # a wheel may ride above the bottom of a track
            reading = dataclasses.replace(reading, sinkage=np.abs(reading.sinkage))
        reading = as_configured(reading, rover, config)
        screening = screen(reading, None, rover, config, wheels=self._wheels)
        if screening.outcome is not Outcome.OUT_OF_RANGE:
            used = screening.outcome.used
            return _as_given(_signed(screening, given), given) if used else screening
        slip = _inside(reading.slip, reading.slip_sd, config.slip_minimum, config.slip_maximum)
        sinkage = _inside(reading.sinkage, reading.sinkage_sd, 0.0, rover.wheel_radius)
        moved = dataclasses.replace(reading, slip=slip, sinkage=sinkage)
        again = screen(moved, None, rover, config, wheels=self._wheels)
        own = dataclasses.replace(again.observation, slip=reading.slip, sinkage=reading.sinkage)
        return _as_given(_signed(again._replace(observation=own), given), given)


def _signed(screening: Screening, reading: Observation) -> Screening:
    """Return the screening with the signs of local sinkages that it left."""
    if not reading.local:
        return screening
    own = screening.observation
    sinkage = np.where(np.isnan(own.sinkage), np.nan, reading.sinkage)
    return screening._replace(observation=dataclasses.replace(own, sinkage=sinkage))


def _as_given(screening: Screening, reading: Observation) -> Screening:
    """Return the screening with the contact angles of the ``reading`` before any was supposed.

    They are supposed again from the bogie's angle, which has to be there.
    """
    own = screening.observation
    if own.contact_angle is reading.contact_angle:
        return screening
    observation = dataclasses.replace(
        own,
        contact_angle=reading.contact_angle,
        contact_angle_sd=reading.contact_angle_sd,
        bogie_angle=possible_bogie(reading),
    )
    return screening._replace(observation=observation)


def averaged(readings: Iterable[Conversion], averager: Averager) -> Iterator[Conversion]:
    """Yield what an estimator takes of a whole recording, without what is withdrawn."""
    kept: list[Conversion] | None = []  # what may still be withdrawn
    taken = (each for reading in readings for each in averager.add(reading))
    for each in itertools.chain(taken, _flushed(averager)):
        if each.mark is Mark.FIRST:
            yield from kept or ()
            kept = [each]
        elif kept is not None and each.mark is Mark.NONE and len(kept) <= _INTERVALS:
            kept.append(each)
        else:
            if each.mark is Mark.NONE:
                yield from kept or ()
            kept = None
            yield each
    yield from kept or ()


def _flushed(averager: Averager) -> Iterator[Conversion]:
    yield from averager.flush()  # once the readings have come


def _inside(values: Floats, deviations: Floats, low: float, high: float) -> Floats:
    """Return values in a range; those that noise does not explain stay outside."""
    reach = NOISE_BOUND * deviations
    margin = 1e-6 * (high - low)
    near = (values > low - reach) & (values < high + reach)
    return np.where(near, np.clip(values, low + margin, high - margin), values)


def mean(readings: list[Observation], stamp_ns: int) -> Observation:
    """Return the mean of readings with independent errors.

    A value that is NaN in some of them is the mean of the others; NaN where all are.
    """
    values: dict[str, Floats | float] = {}
    for name in (*AXLE_FIELDS, *SCALAR_FIELDS):
        if name.endswith("_sd"):
            continue
        measured = np.array([getattr(each, name) for each in readings])
        known = ~np.isnan(measured)
        count = np.where(known.any(0), known.sum(0), np.nan)
        values[name] = np.where(known, measured, 0.0).sum(0) / count
        if f"{name}_sd" in _DEVIATIONS:
            own = np.array([getattr(each, f"{name}_sd") for each in readings])
            values[f"{name}_sd"] = np.sqrt(np.where(known, own**2, 0.0).sum(0)) / count
    scalars = {name: float(values[name]) for name in SCALAR_FIELDS}
    steered = [each.steering for each in readings if each.steering is not None]
    steering = np.mean(steered, axis=0) if steered else None
    return Observation(
        stamp_ns,
        **(values | scalars),  # type: ignore[arg-type]
        steering=steering,
        local=readings[-1].local,
    )
