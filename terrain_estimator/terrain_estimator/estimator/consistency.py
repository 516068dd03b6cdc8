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
are judged after a delay, and those before an accepted change and until all axles have crossed are
forgotten. A model that is wrong looks like a ground that changes all the time: only one change in
REST seconds is let be.

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

from terrain_estimator.distributions import chi_square_limit, normal_cdf, normal_quantile
from terrain_estimator.estimator.crossing import Crossing
from terrain_estimator.estimator.intake import ADVICE
from terrain_estimator.estimator.recent_seconds import LAGS, RecentSeconds, known, products_of
from terrain_estimator.observation import Floats
from terrain_estimator.update import Disagreement, RowFit

WINDOWS = (10, 20, 60, 300)
"""[seconds of driving] That are tested together: strong misfits are found early, weak ones late.

For the second level a window that is not full yet has all seconds that there are.
"""
FEWEST = 20
"""[seconds of driving] Fewer are not tested for side and memory."""
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
REACH = math.sqrt(chi_square_limit(1, LARGEST))
"""[1] A row's innovation counts for no more."""
LAWS_IN_DOUBT = ("grousers", "slip_sinkage", "sinkage_bias", "rate_dependence", "exit_angle")
"""Named effects with which a model confirms nothing.

Where the ground follows another law of the same name, such a model takes up the misfit and puts the
rest into c and tan phi. Half of the drives that were called identified were wrong: 45 of 84 by
wheel (docs/lateral.md), 21 of 47 by axle (docs/effects.md).
"""
_ITERATIONS, _CLOSE = 100, 1e-12
_SIGNALS = {
    "velocity": "slip and odometry",
    "load": "sinkage and the rover's mass",
    "torque": "torque, slip and sinkage of that axle or wheel",
    "acceleration": "the IMU's acceleration and pitch",
    "moment": "pitch and the sinkage of front and rear wheels",
    "bogie_moment": "the bogie's angle and the sinkage of its wheels",
    "roll_moment": "roll and the sinkage of left and right wheels",
    "lateral_velocity": "lateral velocity, yaw rate and roll",
    "yaw_rate": "yaw rate, steering and the track width",
}
"""What to look at first, by the kind of the row."""


def law_in_doubt(effects: Iterable[str]) -> str:
    """Return why a model with these named effects confirms no estimate; empty where it can."""
    found = [name for name in effects if name in LAWS_IN_DOUBT]
    return f"nothing tells another law of {', '.join(found)} from the ground" if found else ""


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
    # what honest seconds exceed with a probability [1], and a smaller number that costs little
    limit: Callable[[float], float]
    floor: Callable[[float], float]
    window: int  # [seconds of driving]
    how: str  # the window misses the model
    shares: Callable[[], Floats]  # [R] in which row it shows most

    def fails(self, probability: float) -> bool:
        """Return whether honest seconds exceed the value with less than ``probability`` [1]."""
        return self.value > self.floor(probability) and self.value > self.limit(probability)

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
        crossing: Crossing | None = None,
    ) -> None:
        """Take the names of the R rows, and seconds in order: those that count, those that wait.

        A second is an array [2 + 2 R], a SecondFit laid end to end. ``crossing`` is the last
        change that was let be; None: no change was.
        """
        self.rows = tuple(rows)
        self._columns = 2 + 2 * len(self.rows)
        self._recent = RecentSeconds(np.reshape([*judged], (-1, self._columns)), max(WINDOWS))
        self.pending = deque(pending, maxlen=DELAY)
        self.crossing = Crossing() if crossing is None else crossing

    @property
    def judged(self) -> Floats:
        """The seconds that count [n, 2 + 2 R]."""
        return self._recent.seconds

    def add(self, fit: SecondFit, changed: float, way: float) -> None:
        """Take a closed second.

        ``changed`` [1] is the probability of a change around it, ``way`` [wheelbases] the travel
        in it.
        """
        if self.crossing.explains(changed, way):
            self._recent = RecentSeconds(self.judged[:0], max(WINDOWS))
            self.pending.clear()
            return
        if len(self.pending) == DELAY:
            self._recent.append(self.pending[0])
        # no second counts for more than honest ones hardly ever reach
        size = [min(fit.misfit, limit(LARGEST, fit.degrees)), fit.degrees]
        misses = [*fit.single.tolist(), *fit.white.tolist()]
        within = [-REACH if each < -REACH else min(each, REACH) for each in misses]
        self.pending.append(np.array([*size, *within]))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what to keep, as arrays; ``judged`` and ``pending`` are [n, 2 + 2 R]."""
        return {
            "judged": self.judged.copy(),
            "pending": np.reshape([*self.pending], (-1, self._columns)),
            "since_change": np.array(self.crossing.since_change, dtype=np.int64),
        }

    def fits(self) -> tuple[RowFit, ...]:
        """Return how each row missed in the last seconds, of the rows that enough of them had."""
        if len(self.judged) < WINDOWS[0]:
            return ()
        single = self.judged[-PUBLISHED:, 2 : 2 + len(self.rows)]
        mean = np.add.reduce(single) / len(single)
        offsets: list[float] = mean.tolist()
        if all(map(math.isfinite, offsets)):  # nearly always all rows are there
            squares = np.add.reduce((single - mean) ** 2).tolist()
            spreads = [math.sqrt(each / len(single)) for each in squares]
            return tuple(map(RowFit, self.rows, offsets, spreads))
        there = np.isfinite(single)
        number = there.sum(0)
        least = np.maximum(number, 1)
        offset = np.where(there, single, 0.0).sum(0) / least
        spread = np.sqrt((np.where(there, single - offset, 0.0) ** 2).sum(0) / least)
        every = zip(self.rows, number.tolist(), offset.tolist(), spread.tolist(), strict=True)
        return tuple(RowFit(row, *fit) for row, n, *fit in every if n >= WINDOWS[0])

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
        doubt = f"{doubted.words(DOUBTFUL)}, {self._row(doubted)}" if doubted else self._unchecked()
        return ((self._disagreement(wrong),) if wrong else ()), doubt

    def _unchecked(self) -> str:
        """Return why the last seconds, which fit, confirm nothing; empty where they do.

        Without sinkages a drag of the drives looks like another ground, and no second has the load
        row. Half of them have to have it. The velocity alone is fitted by other soil constants,
        too, with another c and tan phi. By wheel nothing but torques tells c from tan phi: those
        of half of the wheels have to be there in half of all judged seconds.
        """
        last = np.isfinite(self.judged[-WINDOWS[0] :, 2 : 2 + len(self.rows)])
        if {self.rows[row] for row in np.flatnonzero(last.any(0))} == {"velocity"}:
            return (
                "the velocity alone tells neither a wrong soil constant nor a drag of the drives"
                " from the ground"
            )
        judged = np.count_nonzero(last.any(1))
        torques = [k for k, row in enumerate(self.rows) if row.startswith("torque")]
        read = np.isfinite(self.judged[:, [2 + k for k in torques]]).mean(1)  # share of wheels
        if "yaw_rate" in self.rows and np.count_nonzero(read >= 0.5) < len(read) / 2:
            return "without torques nothing tells c from tan phi in a model by wheel"
        if np.count_nonzero(last[:, self.rows.index("load")]) >= judged / 2:
            return ""
        return "without sinkages nothing tells a drag of the drives from the ground"

    def _disagreement(self, failed: Tested) -> Disagreement:
        row = self.rows[int(np.argmax(failed.shares()))]
        return Disagreement(
            "the model does not fit this rover or ground:"
            f" {failed.words(FALSE_ALARM)}, {self._row(failed)}",
            f"look at {_SIGNALS[row.rstrip('_0123456789')]} first; then {ADVICE}",
        )

    def _row(self, failed: Tested) -> str:
        return f"most in row {self.rows[int(np.argmax(failed.shares()))]}"

    def _tests(self) -> Iterator[Tested]:
        """Yield the tests of every window that may fail.

        A window that is not full has all seconds that there are. Nearly all tests are far below
        the least that any level asks for, and are not looked at further.
        """
        seconds = len(self.judged)
        single = self.judged[:, 2 : 2 + len(self.rows)]
        windows = list(dict.fromkeys(min(each, seconds) for each in WINDOWS))
        for window, told in zip(windows, self._recent.told(windows), strict=True):
            own = single[-window:]
            if told.distance > _floor(DOUBTFUL, told.freedom):
                size = told.distance, *_limits(told.freedom)
                yield Tested(*size, window, "", functools.partial(_size_shares, own))
            if window < FEWEST:
                continue
            if told.square > _floor(DOUBTFUL, told.present):
                side = told.square, *_limits(told.present)
                yield Tested(*side, window, " to one side,", functools.partial(_side_shares, own))
            # the limit of a skewed variable is above that of a normal one
            value = told.product / math.sqrt(max(told.compared, 1.0))
            if value > normal_limit(DOUBTFUL):
                most = functools.partial(
                    memory_limit, seconds=window, rows=round(told.compared / _compared(window), 1)
                )
                how = " alike one after another,"
                shares = functools.partial(_memory_shares, own)
                yield Tested(value, most, normal_limit, window, how, shares)


def _size_shares(single: Floats) -> Floats:
    """Return in which row [R] the squared distances of innovations [n, R] show most."""
    return np.asarray(np.nansum(single**2, 0))


def _side_shares(single: Floats) -> Floats:
    """Return in which row [R] the means show most."""
    number = np.isfinite(single).sum(0)
    return np.asarray(np.nansum(single, 0) ** 2 / np.maximum(number, 1))


def _memory_shares(single: Floats) -> Floats:
    """Return in which row [R] the products show most."""
    there = known(single)
    each = [products_of(there[:, :, [row]]).sum((0, 2)) for row in range(single.shape[1])]
    total, count = np.array(each).T
    return np.asarray(total / np.sqrt(np.maximum(count, 1.0)))


def _limits(degrees: int) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Return limit and floor of a chi-square variable."""
    most = functools.partial(limit, degrees=degrees)
    return most, functools.partial(_floor, degrees=degrees)


@functools.lru_cache
def _floor(probability: float, degrees: int) -> float:
    """Return less than what a chi-square variable exceeds with ``probability`` [1]."""
    # skewed upwards, so above that of a normal variable with its moments
    return degrees + math.sqrt(2.0 * degrees) * normal_limit(probability)


@functools.lru_cache
def normal_limit(probability: float) -> float:
    """Return what a standard normal variable exceeds with ``probability`` [1]."""
    return -float(normal_quantile(probability))


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

    def at(nearness: float) -> tuple[float, float]:
        """Return sum and probability to exceed it; ``nearness`` of the largest saddle point."""
        point = -0.5 * math.expm1(-nearness) / values[-1]
        rest = 1.0 - 2.0 * point * values
        total = rows * float((values / rest).sum())
        spread = rows * float((2.0 * values**2 / rest**2).sum())
        below = -0.5 * rows * float(np.log(rest).sum())
        signed = math.sqrt(2.0 * (point * total - below))
        density = math.exp(-0.5 * signed**2) / math.sqrt(2.0 * math.pi)
        beyond = 1.0 / (point * math.sqrt(spread)) - 1.0 / signed
        return total, float(normal_cdf(-signed)) + density * beyond

    nearness = _root(lambda each: math.log(max(at(each)[1], 1e-300) / probability), 1e-3, 20.0)
    return at(nearness)[0] / math.sqrt(rows * _compared(seconds))


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a falling function is zero (false position; Dowell and Jarratt 1971)."""
    above, below = function(low), function(high)
    middle, was_above = low, False
    for number in range(_ITERATIONS):
        last = middle
        middle = low + (high - low) * above / (above - below)
        value = function(middle)
        again = number > 0 and (value > 0.0) == was_above  # the other end stays a second time
        was_above = value > 0.0
        if was_above:
            low, above, below = middle, value, below * (0.5 if again else 1.0)
        else:
            high, below, above = middle, value, above * (0.5 if again else 1.0)
        if abs(middle - last) < _CLOSE:
            break
    return middle


@functools.lru_cache
def limit(probability: float, degrees: int) -> float:
    """Return what a chi-square variable exceeds with ``probability`` [1]; infinite for 0."""
    return chi_square_limit(degrees, probability)
