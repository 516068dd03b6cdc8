# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Observations by what became of them: their outcome once their second has ended."""

from collections import Counter

from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update


class SettledOutcomes:
    """Counts of observations and seconds; what waits in the open second is not counted yet.

    The observations of a refused second have the outcome of the one that ended it. A reading that
    was withdrawn, and an open second that a reset forgot, are never counted.
    """

    def __init__(self) -> None:
        """Start without an observation."""
        self.outcomes: Counter[Outcome] = Counter()
        self.seconds_taken = self.seconds_refused = 0
        self._waiting: list[Outcome] = []

    def add(self, update: Update) -> Counter[Outcome]:
        """Count an update; return the outcomes that it settles, its own among them or not."""
        decision = update.decision
        used = decision.outcome.used
        if used:
            self._waiting.append(decision.outcome)
        gone = max(0, len(self._waiting) - update.estimate.observations_waiting)
        ended = self._waiting[:gone][-decision.settled :] if decision.settled else []
        del self._waiting[:gone]
        if used and not decision.settled:  # as nearly always
            return Counter()
        settled = Counter(ended if used else {decision.outcome: 1 + len(ended)})
        self.seconds_taken += used and decision.settled > 0
        self.seconds_refused += not used and decision.settled > 0
        self.outcomes += settled
        return settled

    @property
    def seconds(self) -> int:
        """Closed seconds of driving."""
        return self.seconds_taken + self.seconds_refused

    @property
    def used(self) -> int:
        """Observations that entered the posterior."""
        return sum(count for outcome, count in self.outcomes.items() if outcome.used)

    @property
    def refused(self) -> int:
        """Observations that did not."""
        return self.outcomes.total() - self.used
