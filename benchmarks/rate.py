# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Highest rate at which the estimator node receives and answers every set of five topics.

The bar is a share of what a node reaches that answers without estimating, in the same run.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.live import EMPTY, ESTIMATOR, WARM_UP, Sent, facing, sets

SHARE = 0.9
"""[1] Least share of the empty node's highest rate."""
RATES_HZ = (50.0, 100.0, 200.0, 300.0, 400.0, 500.0, 700.0, 1000.0, 1400.0, 2000.0, 2800.0)
CLOSE = 1.05
"""[1] Between a rate without a loss and one with a loss that are closer than this, no other is
tried: less than 1 / SHARE, or two nodes far apart could end at the same rate."""
SECONDS = 10.0
LATE_S = 0.1
"""[s] Lateness of the sender beyond which it, and not the node, is the limit."""
MOST_SETS = 10_000_000
"""More than any search sends; they are made as they are sent."""


@dataclass(frozen=True, slots=True)
class Highest:
    """The end of a search: the highest rate without a loss, and why no higher one was found."""

    rate_hz: float  # 0 where the first fails
    why: str
    dropped: bool  # the node lost something at the next rate; else the search ended before


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the rate, beside that of a node that answers without estimating."""
    seconds = effort.seconds(SECONDS, least=1.0)
    yield line(*(highest(node, seconds) for node in (ESTIMATOR, EMPTY)))


def line(found: Highest, empty: Highest) -> BenchmarkLine:
    """Return the line of two searches; an empty node that answers at no rate gives no bar."""
    ended = "" if empty.dropped else ", before it dropped any: its highest rate is higher"
    return BenchmarkLine(
        "highest rate without a drop",
        found.rate_hz,
        "Hz",
        SHARE * empty.rate_hz if empty.rate_hz else math.nan,
        least=True,
        reference=EMPTY,
        against=empty.rate_hz,
        note=f"the estimator: {found.why}; the empty node: {empty.why}{ended}",
    )


def highest(node: str, seconds: float) -> Highest:
    """Return the highest rate of ESTIMATOR or EMPTY, each tried for so many seconds."""
    with facing(node) as (rover, _):
        instants = sets(MOST_SETS)
        rover.drive(instants, WARM_UP, 20.0)
        return search(lambda rate: rover.drive(instants, round(seconds * rate), rate))


def search(drive: Callable[[float], Sent]) -> Highest:
    """Return the highest rate [Hz] at which a ``drive`` loses nothing.

    The RATES_HZ come first, up to one that fails, then rates between the last two until these are
    CLOSE.
    """
    best, limit, end = 0.0, RATES_HZ[0], None
    for limit in RATES_HZ:
        if end := _failure(drive(limit), limit):
            break
        best = limit
    if end is None:
        return Highest(best, f"{best:g} Hz is the highest rate that is tried", dropped=False)
    while best and limit > CLOSE * best:
        rate = float(round(math.sqrt(best * limit)))
        if again := _failure(drive(rate), rate):
            limit, end = rate, again
        else:
            best = rate
    why, dropped = end
    return Highest(best, why, dropped)


def _failure(sent: Sent, rate: float) -> tuple[str, bool] | None:
    """Return why a drive at a ``rate`` fails, and whether the node is at fault; None if it is well.

    Else the sender is.
    """
    if sent.late_s > LATE_S:
        return f"at {rate:g} Hz the sender was late", False
    if sent.lost or sent.missed:
        words = f"{sent.lost} of {len(sent.sent_s)} sets were not answered"
        return f"at {rate:g} Hz {words}, {sent.missed} messages not received", True
    return None
