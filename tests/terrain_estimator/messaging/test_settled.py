# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Observations are counted by what became of their second."""

from terrain_estimator.messaging.settled import SettledOutcomes
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update
from tests.terrain_estimator import updates

A, P, G = Outcome.ACCEPTED, Outcome.ACCEPTED_PARTIALLY, Outcome.GATED


def update(outcome: Outcome, waiting: int, settled: int = 0) -> Update:
    made = updates.update(0, outcome)
    return made._replace(
        estimate=made.estimate._replace(observations_waiting=waiting),
        decision=made.decision._replace(settled=settled),
    )


def counted(*made: Update) -> SettledOutcomes:
    found = SettledOutcomes()
    for each in made:
        found.add(each)
    return found


def test_observations_count_when_their_second_ends() -> None:
    waiting = [update(A if k else P, k + 1) for k in range(9)]
    assert counted(*waiting).outcomes == {}
    taken = counted(*waiting, update(A, 0, 10))
    assert taken.outcomes == {A: 9, P: 1}
    assert (taken.used, taken.refused, taken.seconds_taken, taken.seconds) == (10, 0, 1, 1)


def test_a_refused_second_is_ten_refused_observations() -> None:
    refused = counted(*(update(A, k + 1) for k in range(9)), update(G, 0, 9))
    assert refused.outcomes == {G: 10}
    assert (refused.used, refused.refused, refused.seconds_refused) == (0, 10, 1)


def test_an_observation_that_is_refused_alone_ends_no_second() -> None:
    alone = counted(update(A, 1), update(G, 1), update(Outcome.STANDSTILL, 1))
    assert alone.outcomes == {G: 1, Outcome.STANDSTILL: 1}
    assert alone.seconds == 0


def test_a_gap_ends_the_second_before_it() -> None:
    """The observation after the gap waits if that second was taken, and is left out with it."""
    before = [update(A, 1), update(P, 2), update(A, 3)]
    taken = counted(*before, update(A, 1, 3))
    assert taken.outcomes == {A: 2, P: 1}
    refused = counted(*before, update(G, 0, 3))
    assert refused.outcomes == {G: 4}
    assert (taken.seconds_taken, refused.seconds_refused) == (1, 1)


def test_what_was_withdrawn_or_forgotten_is_not_counted() -> None:
    """The first reading passed and was averaged with the next ones; then a reset, and a restart."""
    withdrawn = counted(update(A, 1), *(update(A, k + 1) for k in range(9)), update(A, 0, 10))
    assert withdrawn.outcomes == {A: 10}
    reset = counted(update(A, 1), update(A, 2), update(A, 1), update(A, 2))
    assert reset.outcomes == {}
    restored = counted(update(A, 6), update(A, 7), update(A, 0, 8))
    assert restored.outcomes == {A: 3}, "five of that second were counted by another run"
    assert restored.seconds_taken == 1
