# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Highest rate at which the estimator node receives and answers every set of five topics."""

from collections.abc import Iterator

from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.live import EMPTY, ESTIMATOR, WARM_UP, facing, sets

BAR_HZ = 500.0
RATES_HZ = (50.0, 100.0, 200.0, 300.0, 400.0, 500.0, 700.0, 1000.0)
SECONDS = 10.0
LATE_S = 0.1
"""[s] Lateness of the sender beyond which it, and not the node, is the limit."""


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield the rate, beside that of a node that answers without estimating."""
    seconds = effort.seconds(SECONDS, least=1.0)
    (found, why), (bare, _) = (highest(node, seconds) for node in (ESTIMATOR, EMPTY))
    yield BenchmarkLine(
        "highest rate without a drop",
        found,
        "Hz",
        BAR_HZ,
        least=True,
        reference=EMPTY,
        against=bare,
        note=why,
    )


def highest(node: str, seconds: float) -> tuple[float, str]:
    """Return the last of RATES_HZ [Hz] before the first with a loss, and the end of the search.

    0 where the first rate fails.
    """
    best = 0.0
    with facing(node) as (rover, _):
        instants = sets(WARM_UP + sum(round(seconds * rate) for rate in RATES_HZ))
        rover.drive(instants, WARM_UP, 20.0)
        for rate in RATES_HZ:
            sent = rover.drive(instants, round(seconds * rate), rate)
            if sent.late_s > LATE_S:
                return best, f"at {rate:g} Hz the sender was late"
            if sent.lost or sent.missed:
                return (
                    best,
                    (
                        f"at {rate:g} Hz {sent.lost} of {len(sent.sent_s)} sets were not answered,"
                        f" {sent.missed} messages not received"
                    ),
                )
            best = rate
    return best, "the highest rate that is tried"
