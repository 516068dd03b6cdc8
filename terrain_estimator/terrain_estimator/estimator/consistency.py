# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Test whether the last seconds fit the model as well as honest noise lets them.

A small variance says that data are many, not that the model is right: a wrong law or a hidden
effect gives a sharp and wrong estimate whose seconds fit a little worse than they should, each
within its gate. The squared Mahalanobis distance of a second from its prediction is chi-square
distributed, with as many degrees of freedom as it has rows less one (Bar-Shalom, Li and Kirubarajan
2001, section 5.4, on the normalised innovation squared), and seconds are independent. So their sums
over some windows are tested.

A change of the ground makes seconds misfit, too, until the posterior has followed it. So seconds
are judged after a delay, and those before an accepted change are forgotten. A model that is wrong
can look like a ground that changes all the time; that is told as well.
"""

import functools
import itertools
from collections import deque
from collections.abc import Iterable
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
LARGEST = 1e-5
"""[1] A second contributes no more than honest ones exceed with this probability."""
DELAY = 5
"""[seconds of driving] In which a change of the ground may explain a misfit."""
CHANGING = 0.5
"""[1] Probability of a change above which it is accepted."""
RECENT = 60
"""[seconds of driving] In which accepted changes are counted."""
MOST_CHANGING = 15
"""[seconds of driving] Of these in which the ground may change; one change takes about four."""
ADVICE = f"{CHECK}; find_missing_effect names rows and effects from a recording"


class Fit(NamedTuple):
    """How one closed second fitted."""

    misfit: float  # [1] squared Mahalanobis distance
    degrees: int  # of freedom


class Consistency:
    """The fits of the last closed seconds of driving."""

    def __init__(
        self,
        judged: Iterable[Fit] = (),
        pending: Iterable[Fit] = (),
        changing: Iterable[bool] = (),
    ) -> None:
        """Start with seconds in their order: those that count, those that wait, and changes."""
        self.judged = deque(judged, maxlen=max(WINDOWS))
        self.pending = deque(pending, maxlen=DELAY)
        self.changing = deque(changing, maxlen=RECENT)

    def add(self, fit: Fit, changed: float) -> None:
        """Take a closed second; ``changed`` [1] is the probability of a change around it."""
        self.changing.append(changed > CHANGING)
        if self.changing[-1]:
            self.judged.clear()
            self.pending.clear()
            return
        if len(self.pending) == DELAY:
            self.judged.append(self.pending[0])
        self.pending.append(fit)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what to keep, as arrays; ``judged`` and ``pending`` are [n, 2] as Fit."""
        return {
            "judged": np.array(self.judged, dtype=np.float64).reshape(-1, len(Fit._fields)),
            "pending": np.array(self.pending, dtype=np.float64).reshape(-1, len(Fit._fields)),
            "changing": np.array(self.changing, dtype=np.int64),
        }

    def disagreements(self) -> tuple[Disagreement, ...]:
        """Return the reasons why the model does not fit; empty where it does."""
        return (*self._worse(), *self._restless())

    def _worse(self) -> Iterable[Disagreement]:
        newest_first = list(reversed(self.judged))
        for window in WINDOWS:
            if len(newest_first) < window:
                return
            seconds = itertools.islice(newest_first, window)
            bounded = [(min(each.misfit, limit(LARGEST, each.degrees)), each) for each in seconds]
            total = sum(value for value, _ in bounded)
            degrees = sum(each.degrees for _, each in bounded)
            if total > limit(FALSE_ALARM, degrees):
                yield Disagreement(
                    f"the model does not fit this rover or ground: the last {window} seconds of"
                    f" driving miss it by {total / degrees:.2g} times their stated variance, where"
                    f" noise explains {limit(FALSE_ALARM, degrees) / degrees:.2g}",
                    ADVICE,
                )
                return

    def _restless(self) -> Iterable[Disagreement]:
        count = sum(self.changing)
        if count > MOST_CHANGING:
            yield Disagreement(
                "the model does not fit this rover or ground: it explains the last"
                f" {len(self.changing)} seconds of driving by changes of the ground in {count} of"
                " them",
                ADVICE,
            )


@functools.lru_cache
def limit(probability: float, degrees: int) -> float:
    """Return what a chi-square variable exceeds with ``probability`` [1]."""
    return float(chdtri(degrees, probability))
