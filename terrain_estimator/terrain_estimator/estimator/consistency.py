# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Test whether the last seconds fit the model as well as honest noise lets them.

A small variance says that data are many, not that the model is right: a wrong law or a hidden
effect gives a sharp and wrong estimate whose seconds fit a little worse than they should, each
within its gate. Where the model is right, the innovations of the rows are white: of mean zero, of
the predicted covariance, and independent from second to second. Each of the three is tested over
some windows (Mehra 1970; Bar-Shalom, Li and Kirubarajan 2001, section 5.4):

- **size**: the sum of the squared Mahalanobis distances is chi-square distributed, with as many
  degrees of freedom as the seconds have rows;
- **side**: of the whitened innovations the squares of the means, times their number, add up to a
  chi-square variable with a degree of freedom for each row;
- **memory**: their products with those of the LAGS seconds before add up to a quadratic form of
  standard normal variables, with a mean of zero and a variance of the number of products.

Slow causes (a slope, a load, another law) show in side and memory long before they show in size.

The tests have two levels. Seconds that honest noise hardly ever gives DISAGREE with the model. To
pass that level does not show that the model fits. So seconds that honest noise gives in one of two
hundred cases leave the estimate unconfirmed, and no parameter is called identified.

A change of the ground makes seconds misfit, too, until the posterior has followed it. So seconds
are judged after a delay, and those before an accepted change are forgotten. A model that is wrong
looks like a ground that changes all the time: only one change in REST seconds is let be.

The row that is named is the one in which the failed test shows most. It tells where to look, not
what is wrong: an effect shows in more than one row.
"""

import functools
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtri, ndtr

from terrain_estimator.estimator.intake import ADVICE as CHECK
from terrain_estimator.observation import Floats
from terrain_estimator.update import Disagreement, RowFit

WINDOWS = (10, 20, 60, 300)
"""[seconds of driving] That are tested together: strong misfits are found early, weak ones late.

For the second level a window that is not full yet has all seconds that there are.
"""
FEWEST = 20
"""[seconds of driving] Fewer are not tested for side and memory."""
LAGS = 3
"""[seconds of driving] Between two innovations that are compared."""
FALSE_ALARM = 1e-6
"""[1] Probability that honest seconds fail one test: one in 28 hours of ten tests a second."""
DOUBTFUL = 0.005
"""[1] Probability that honest seconds fail one test of what confirms an estimate."""
LARGEST = 1e-5
"""[1] A second contributes no more than honest ones exceed with this probability."""
PUBLISHED = 60
"""[seconds of driving] Over which the fit of each row is published."""
DELAY = 5
"""[seconds of driving] In which a change of the ground may explain a misfit."""
REACH = math.sqrt(float(chdtri(1, LARGEST)))
"""[1] A row's innovation counts for no more."""
CHANGING = 0.5
"""[1] Probability of a change above which it is accepted."""
CROSSING = 15
"""[seconds of driving] From the first sign of a change until the last axle has crossed."""
REST = 45
"""[seconds of driving] From one change to the next; an earlier one explains no misfit."""
ADVICE = f"{CHECK}; find_missing_effect names rows and effects from a recording"
_SIGNALS = {
    "velocity": "slip and odometry",
    "load": "sinkage and the rover's mass",
    "torque": "that axle's torque, slip and sinkage",
    "acceleration": "the IMU's acceleration and pitch",
    "moment": "pitch and the sinkage of front and rear wheels",
    "bogie_moment": "the bogie's angle and the sinkage of its wheels",
}
"""What to look at first, by the kind of the row."""


class SecondFit(NamedTuple):
    """How one closed second fitted; the innovations as in ``terrain_estimator.model.innovation``.

    NaN in them stands for a row that was not there.
    """

    misfit: float  # [1] squared Mahalanobis distance
    degrees: int  # of freedom
    single: Floats  # [R] of each row alone
    white: Floats  # [R] uncorrelated


class Tested(NamedTuple):
    """One test of a window, and what honest seconds would have."""

    value: float
    limit: Callable[[float], float]  # what honest seconds exceed with a probability [1]
    window: int  # [seconds of driving]
    how: str  # the window misses the model
    shares: Floats  # [R] in which row it shows most

    def fails(self, probability: float) -> bool:
        """Return whether honest seconds exceed the value with less than ``probability`` [1]."""
        return self.value > self.limit(probability)

    def words(self, probability: float) -> str:
        """Return the failure in words."""
        times = self.value / self.limit(probability)
        return (
            f"the last {self.window} seconds of driving miss it{self.how} by {times:.3g} times"
            " what noise explains"
        )


class Consistency:
    """The fits of the last closed seconds of driving."""

    def __init__(
        self,
        rows: Sequence[str],
        judged: Iterable[Floats] = (),
        pending: Iterable[Floats] = (),
        since_change: int = REST,
    ) -> None:
        """Take the names of the R rows, and seconds in order: those that count, those that wait.

        A second is an array [2 + 2 R], a SecondFit laid end to end. ``since_change`` [seconds of
        driving] is the time since a change was let be, up to REST.
        """
        self.rows = tuple(rows)
        self.judged = deque(judged, maxlen=max(WINDOWS))
        self.pending = deque(pending, maxlen=DELAY)
        self.since_change = since_change

    def add(self, fit: SecondFit, changed: float) -> None:
        """Take a closed second; ``changed`` [1] is the probability of a change around it."""
        self.since_change = min(self.since_change + 1, REST)
        if changed > CHANGING:
            if self.since_change == REST:
                self.since_change = 0
            if self.since_change < CROSSING:
                self.judged.clear()
                self.pending.clear()
                return
        if len(self.pending) == DELAY:
            self.judged.append(self.pending[0])
        # no second counts for more than honest ones hardly ever reach
        size = [min(fit.misfit, limit(LARGEST, fit.degrees)), fit.degrees]
        misses = np.clip([*fit.single, *fit.white], -REACH, REACH)
        self.pending.append(np.concatenate([size, misses]))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what to keep, as arrays; ``judged`` and ``pending`` are [n, 2 + 2 R]."""
        columns = 2 + 2 * len(self.rows)
        return {
            "judged": np.array(self.judged).reshape(-1, columns),
            "pending": np.array(self.pending).reshape(-1, columns),
            "since_change": np.array(self.since_change, dtype=np.int64),
        }

    def fits(self) -> tuple[RowFit, ...]:
        """Return how each row missed in the last seconds, of the rows that enough of them had."""
        if len(self.judged) < WINDOWS[0]:
            return ()
        single = np.array(self.judged)[-PUBLISHED:, 2 : 2 + len(self.rows)]
        return tuple(
            RowFit(row, float(there.mean()), float(there.std()))
            for row, misses in zip(self.rows, single.T, strict=True)
            if len(there := misses[np.isfinite(misses)]) >= WINDOWS[0]
        )

    def judge(self) -> tuple[tuple[Disagreement, ...], str]:
        """Return the reason why the model does not fit, and why nothing confirms that it does.

        The first is empty where it does, the second where the last seconds confirm it.
        """
        if len(self.judged) < WINDOWS[0]:
            needed = WINDOWS[0] + DELAY
            return (), f"the fit is judged from {needed} seconds of driving on one ground"
        tests = list(self._tests())
        full = (test for test in tests if test.window in WINDOWS)
        wrong = next((test for test in full if test.fails(FALSE_ALARM)), None)
        doubted = next((test for test in tests if test.fails(DOUBTFUL)), None)
        doubt = f"{doubted.words(DOUBTFUL)}, {self._row(doubted)}" if doubted else ""
        return ((self._disagreement(wrong),) if wrong else ()), doubt

    def _disagreement(self, failed: Tested) -> Disagreement:
        row = self.rows[int(np.argmax(failed.shares))]
        return Disagreement(
            "the model does not fit this rover or ground:"
            f" {failed.words(FALSE_ALARM)}, {self._row(failed)}",
            f"look at {_SIGNALS[row.rstrip('_0123456789')]} first; then {ADVICE}",
        )

    def _row(self, failed: Tested) -> str:
        return f"most in row {self.rows[int(np.argmax(failed.shares))]}"

    def _tests(self) -> Iterator[Tested]:
        """Yield the tests of every window; one that is not full has all seconds that there are."""
        every, rows = np.array(self.judged), len(self.rows)
        misfit, degrees, single, white = np.split(every, [1, 2, 2 + rows], axis=1)
        for window in dict.fromkeys(min(each, len(every)) for each in WINDOWS):
            own = single[-window:]
            yield _size(misfit[-window:], degrees[-window:], own)
            if window >= FEWEST:
                yield _side(white[-window:], own)
                yield _memory(white[-window:], own)


def _size(misfit: Floats, degrees: Floats, single: Floats) -> Tested:
    """Test the squared distances [n, 1]; ``single`` is [n, R]."""
    shares = np.nansum(single**2, 0)
    most = functools.partial(limit, degrees=int(degrees.sum()))
    return Tested(float(misfit.sum()), most, len(single), "", shares)


def _side(white: Floats, single: Floats) -> Tested:
    """Test the means of whitened innovations [n, R]."""
    sums, numbers = _sums(white)
    value, there = float((sums**2 / np.maximum(numbers, 1)).sum()), int((numbers > 0).sum())
    own, count = _sums(single)
    shares = own**2 / np.maximum(count, 1)
    most = functools.partial(limit, degrees=there)
    return Tested(value, most, len(white), " to one side,", shares)


def _memory(white: Floats, single: Floats) -> Tested:
    """Test the products of whitened innovations [n, R] with those of seconds before."""
    sums, numbers = _products(white)
    every = float(numbers.sum())
    value = float(sums.sum()) / math.sqrt(max(every, 1.0))
    own, count = _products(single)
    rows = round(every / _compared(len(white)), 1)
    most = functools.partial(memory_limit, seconds=len(white), rows=rows)
    shares = own / np.sqrt(np.maximum(count, 1))
    return Tested(value, most, len(white), " alike one after another,", shares)


def _sums(misses: Floats) -> tuple[Floats, Floats]:
    """Return the sum [R] of each row's numbers, and how many they are [R]."""
    return np.nansum(misses, 0), np.isfinite(misses).sum(0)


def _products(misses: Floats) -> tuple[Floats, Floats]:
    """Return the sum [R] of the products over LAGS, and how many they are [R]."""
    parts = [_sums(misses[lag:] * misses[:-lag]) for lag in range(1, LAGS + 1)]
    products, numbers = np.sum(parts, 0)
    return products, numbers


def _compared(seconds: int) -> int:
    """Return how many products a row has that was there in all of ``seconds``."""
    return sum(seconds - lag for lag in range(1, LAGS + 1))


@functools.lru_cache
def _eigenvalues(seconds: int) -> Floats:
    """Return those [n] of M [n, n] with which x' M x is the sum of products of a row's x [n]."""
    apart = np.abs(np.subtract.outer(np.arange(seconds), np.arange(seconds)))
    matrix: Floats = np.where((apart >= 1) & (apart <= LAGS), 0.5, 0.0)
    return np.asarray(np.linalg.eigvalsh(matrix), dtype=np.float64)


@functools.lru_cache
def memory_limit(probability: float, seconds: int, rows: float) -> float:
    """Return what white ``seconds`` exceed with ``probability`` [1] in the memory's statistic [1].

    ``rows`` may be a mean; the limit is infinite for none. The sum of products is skewed: a normal
    limit is exceeded ten times too often. The tail is the saddle point's (Lugannani and Rice 1980,
    with the cumulants of a quadratic form of standard normal variables).
    """
    if rows <= 0.0:
        return math.inf
    values = _eigenvalues(seconds)

    def at(share: float) -> tuple[float, float]:
        """Return sum and probability to exceed it; ``share`` of the largest saddle point."""
        point = 0.5 * share / values[-1]
        rest = 1.0 - 2.0 * point * values
        total = rows * float((values / rest).sum())
        spread = rows * float((2.0 * values**2 / rest**2).sum())
        below = -0.5 * rows * float(np.log(rest).sum())
        signed = math.sqrt(2.0 * (point * total - below))
        density = math.exp(-0.5 * signed**2) / math.sqrt(2.0 * math.pi)
        tail = float(ndtr(-signed)) + density * (1.0 / (point * math.sqrt(spread)) - 1.0 / signed)
        return total, tail

    least, most = 1e-3, 1.0 - 1e-9
    share = brentq(lambda each: at(each)[1] - probability, least, most)
    return at(share)[0] / math.sqrt(rows * _compared(seconds))


@functools.lru_cache
def limit(probability: float, degrees: int) -> float:
    """Return what a chi-square variable exceeds with ``probability`` [1]; infinite for 0."""
    return float(chdtri(degrees, probability)) if probability > 0.0 else math.inf
