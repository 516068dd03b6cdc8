# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Test whether the last seconds fit the model as well as honest noise lets them.

A small variance says that data are many, not that the model is right: a wrong law or a hidden
effect gives a sharp and wrong estimate whose seconds fit a little worse than they should, each
within its gate. The squared Mahalanobis distance of a second from its prediction is chi-square
distributed, with as many degrees of freedom as it has rows less one (Bar-Shalom, Li and Kirubarajan
2001, section 5.4, on the normalised innovation squared), and seconds are independent. So their sums
over some windows are tested.

The test has two levels. Seconds that honest noise hardly ever gives DISAGREE with the model. To
pass that test does not show that the model fits. So seconds that honest noise gives in one of fifty
cases leave the estimate unconfirmed, and no parameter is called identified.

A change of the ground makes seconds misfit, too, until the posterior has followed it. So seconds
are judged after a delay, and those before an accepted change are forgotten. A model that is wrong
looks like a ground that changes all the time: only one change in REST seconds is let be.
"""

import functools
import math
from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from terrain_estimator.estimator.intake import ADVICE as CHECK
from terrain_estimator.update import Disagreement

WINDOWS = (10, 20, 60, 300)
"""[seconds of driving] Over which misfits are added: strong ones are found early, weak ones late.
"""
FALSE_ALARM = 1e-6
"""[1] Probability that honest seconds fail one test: one in 3 days of four tests a second."""
DOUBTFUL = 0.02
"""[1] Probability that honest seconds fail one test of what confirms an estimate."""
LARGEST = 1e-5
"""[1] A second contributes no more than honest ones exceed with this probability."""
DELAY = 5
"""[seconds of driving] In which a change of the ground may explain a misfit."""
CHANGING = 0.5
"""[1] Probability of a change above which it is accepted."""
CROSSING = 15
"""[seconds of driving] From the first sign of a change until the last axle has crossed."""
REST = 45
"""[seconds of driving] From one change to the next; an earlier one explains no misfit."""
ADVICE = f"{CHECK}; find_missing_effect names rows and effects from a recording"


class SecondFit(NamedTuple):
    """How one closed second fitted."""

    misfit: float  # [1] squared Mahalanobis distance
    degrees: int  # of freedom


class Consistency:
    """The fits of the last closed seconds of driving."""

    def __init__(
        self,
        judged: Iterable[SecondFit] = (),
        pending: Iterable[SecondFit] = (),
        since_change: int = REST,
    ) -> None:
        """Start with seconds in their order: those that count, and those that wait.

        ``since_change`` [seconds of driving] is the time since a change was let be, up to REST.
        """
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
        self.pending.append(fit)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what to keep, as arrays; ``judged`` and ``pending`` are [n, 2] as SecondFit."""
        return {
            "judged": np.array(self.judged, dtype=np.float64).reshape(-1, len(SecondFit._fields)),
            "pending": np.array(self.pending, dtype=np.float64).reshape(-1, len(SecondFit._fields)),
            "since_change": np.array(self.since_change, dtype=np.int64),
        }

    def disagreements(self) -> tuple[Disagreement, ...]:
        """Return the reason why the model does not fit; empty where it does."""
        failed = self._failed(FALSE_ALARM)
        return (
            (Disagreement(f"the model does not fit this rover or ground: {failed}", ADVICE),)
            if failed
            else ()
        )

    def doubt(self) -> str:
        """Return why the last seconds do not confirm that the model fits; empty where they do."""
        if len(self.judged) < WINDOWS[0]:
            needed = WINDOWS[0] + DELAY
            return f"the fit is judged from {needed} seconds of driving on one ground"
        return self._failed(DOUBTFUL)

    def _failed(self, probability: float) -> str:
        """Return in words which window honest seconds exceed with less than ``probability``."""
        for window, (total, degrees) in self._sums():
            most = limit(probability, degrees)
            if total > most:
                return (
                    f"the last {window} seconds of driving miss it by {total / degrees:.3g} times"
                    f" their stated variance, where noise explains {most / degrees:.3g}"
                )
        return ""

    def _sums(self) -> Iterator[tuple[int, SecondFit]]:
        """Yield every window that is full, and the sum of its seconds."""
        newest_first = list(reversed(self.judged))
        for window in WINDOWS:
            if len(newest_first) < window:
                return
            seconds = newest_first[:window]
            total = sum(min(each.misfit, limit(LARGEST, each.degrees)) for each in seconds)
            yield window, SecondFit(total, sum(each.degrees for each in seconds))


@functools.lru_cache
def limit(probability: float, degrees: int) -> float:
    """Return what a chi-square variable exceeds with ``probability`` [1]; infinite for 0."""
    return float(chdtri(degrees, probability)) if probability > 0.0 else math.inf
