# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The search for the highest rate, and its bar: a share of the empty node's in the same run."""

import math
from collections.abc import Callable

import pytest

from benchmarks.live import Sent
from benchmarks.rate import CLOSE, RATES_HZ, SHARE, Highest, line, search


def drive(tried: list[float], drops: float, late: float = math.inf) -> Callable[[float], Sent]:
    """Return drives of a node that drops from a rate on, and of a sender that is late from one."""

    def drive(rate: float) -> Sent:
        tried.append(rate)
        answered = {} if rate >= drops else {1: 0.001}
        return Sent(sent_s={1: 0.0}, latency_s=answered, late_s=0.5 if rate >= late else 0.0)

    return drive


@pytest.mark.parametrize("limit", [60.0, 350.0, 777.0, 1001.0, 2799.0])
def test_the_highest_rate_is_found_to_a_twentieth(limit: float) -> None:
    tried: list[float] = []
    found = search(drive(tried, limit))
    assert limit / CLOSE <= found.rate_hz < limit
    assert found.dropped
    failed = min(rate for rate in tried if rate >= limit)
    assert found.why == f"at {failed:g} Hz 1 of 1 sets were not answered, 0 messages not received"
    assert CLOSE < 1.0 / SHARE, "else a node below the bar could end at the rate of the empty one"
    assert len(tried) <= len(RATES_HZ) + 4


def test_a_search_that_ends_before_the_node_drops_says_so() -> None:
    whole = search(drive([], math.inf))
    assert (whole.rate_hz, whole.dropped) == (RATES_HZ[-1], False)
    late = search(drive([], math.inf, late=900.0))
    assert 900.0 / CLOSE <= late.rate_hz < 900.0
    assert (late.why.endswith("Hz the sender was late"), late.dropped) == (True, False)
    assert search(drive([], 0.0)).rate_hz == 0.0


def test_the_bar_is_a_share_of_the_empty_nodes_rate() -> None:
    found = Highest(899.0, "a", dropped=True)
    below, above = (line(found, Highest(rate, "b", dropped=True)) for rate in (1000.0, 998.0))
    assert (below.bar, below.met, below.against) == (900.0, False, 1000.0)
    assert above.met
    assert "before it dropped any" not in below.note
    assert "before it dropped any" in line(found, Highest(998.0, "b", dropped=False)).note
    nothing = Highest(0.0, "c", dropped=True)
    assert not line(nothing, nothing).met, "two nodes that answer nothing meet no bar"
