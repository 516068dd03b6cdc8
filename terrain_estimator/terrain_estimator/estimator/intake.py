# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What became of the accepted observations: they enter the posterior, or not, second by second.

A second is a block of the model: ten observations, or fewer where a gap ends it. Each is taken into
the posterior or left out as a whole, when it ends. An observation that is refused by itself is in
none: it leaves a gap.
"""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from terrain_estimator.update import Disagreement, Seconds

WINDOW = 60
"""[seconds of driving] Closed ones that are judged."""
FEWEST = 10
"""[seconds of driving] Fewer are not judged."""
LONELY = 10
"""Observations refused by themselves, with none accepted between them, that count as a second."""
LEAST_TAKEN = 0.5
"""[1] Share of the seconds that a model takes where it fits rover and ground.

Where all is right it leaves out gate_probability of them, and those of a border that it crosses.
"""
MOST_ALONE = 0.1
"""[1] Share of the observations that may be refused by themselves in seconds that confirm a model.

Where all is right it is gate_probability. Single readings of a sensor may be wrong, too.
"""
ADVICE = (
    "check the model, the rover file, the stated standard deviations and the sensors, in this"
    " order; ground that varies along the way needs a model made with --ground-variation;"
    " find_missing_effect names rows and effects from recordings"
)


class ClosedSecond(NamedTuple):
    """A second that ended: whether it was taken, its observations, and those refused before."""

    taken: bool
    held: int
    alone: int  # refused by themselves since the second before


class Intake:
    """Counts since the last return to the prior, and the last closed seconds."""

    def __init__(self, window: Iterable[ClosedSecond] = (), alone: int = 0) -> None:
        """Start with the last closed seconds, and the observations refused since."""
        self.used = self.waiting = 0  # observations in the posterior and in the open second
        self.alone = alone  # observations refused by themselves since a second was counted
        self.time_used_s = self.time_waiting_s = 0.0
        self.window = deque(window, maxlen=WINDOW)
        self._judge()

    def wait(self, time_s: float) -> None:
        """Count an observation of the open second, ``time_s`` after the last accepted one."""
        self.waiting += 1
        self.time_waiting_s += time_s

    def leave_out(self) -> None:
        """Count an observation that was refused by itself; so many are a refused second."""
        self.alone += 1
        if self.alone >= LONELY:
            self._count(0, taken=False)

    def take(self) -> int:
        """End the open second, which enters the posterior; return its observations."""
        self.used += self.waiting
        self.time_used_s += self.time_waiting_s
        return self._end(taken=True)

    def refuse(self) -> int:
        """End the open second, which is left out; return its observations."""
        return self._end(taken=False)

    def _end(self, *, taken: bool) -> int:
        settled, self.waiting, self.time_waiting_s = self.waiting, 0, 0.0
        if settled:  # a second of which more was refused than taken is not of a model that fits
            self._count(settled, taken=taken and settled >= self.alone)
        return settled

    def _count(self, held: int, *, taken: bool) -> None:
        """Count a second."""
        self.window.append(ClosedSecond(taken, held, self.alone))
        self.alone = 0
        self._judge()

    def _judge(self) -> None:
        """Count the last closed seconds, and say what they disagree with."""
        self.seconds = Seconds(len(self.window), sum(each.taken for each in self.window))
        self.disagreements = mostly_refused(self.seconds)

    def doubt(self, gate_probability: float) -> str:
        """Return why the last seconds do not confirm the model; empty where they may.

        ``gate_probability`` [1] is the share of good observations that is refused.
        """
        alone = sum(each.alone for each in self.window) + self.alone
        every = alone + sum(each.held for each in self.window)
        if alone <= (MOST_ALONE + gate_probability) * every:
            return ""
        return (
            f"{alone} of the {every} observations in the last {len(self.window)} seconds of driving"
            " were refused by themselves"
        )


def mostly_refused(seconds: Seconds) -> tuple[Disagreement, ...]:
    """Return the disagreement of a model that left out most of the last seconds; empty if none."""
    judged, taken = seconds
    if judged < FEWEST or taken >= LEAST_TAKEN * judged:
        return ()
    finding = (
        f"the model does not fit this rover or ground: {taken} of the last {judged} seconds of"
        " driving were taken"
    )
    return (Disagreement(finding, ADVICE),)
