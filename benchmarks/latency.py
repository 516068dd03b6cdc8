# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator node at 10 Hz: latency from the last topic on, processor and memory."""

import math
import time
from collections.abc import Iterator

import numpy as np
import psutil

from benchmarks.lines import BenchmarkLine, Effort
from benchmarks.live import EMPTY, ESTIMATOR, WARM_UP, facing, sets

RATE_HZ, SECONDS = 10.0, 120.0
HIGH_MS, SHARE, MEMORY_MB, READY_S = 4.0, 2.5, 100.0, 0.6


def lines(effort: Effort) -> Iterator[BenchmarkLine]:
    """Yield latency, processor and memory, beside a node that answers without estimating."""
    seconds = effort.seconds(SECONDS, least=3.0)
    latencies, share, memory, ready, lost = observed(ESTIMATOR, seconds)
    bare, bare_share, bare_memory, bare_ready, _ = observed(EMPTY, seconds)
    note = f"{len(latencies) - lost} estimates, {lost} lost, which count as infinitely late"
    for what, at, bar in (("99th percentile", 0.99, HIGH_MS), ("median", 0.5, None)):
        value, against = (
            float(np.quantile(each, at, method="higher")) for each in (latencies, bare)
        )
        yield BenchmarkLine(
            f"topic in to estimate out at 10 Hz: {what}",
            value,
            "ms",
            bar,
            reference=EMPTY,
            against=against,
            note=note,
        )
    yield BenchmarkLine(
        "estimator node at 10 Hz: processor",
        share,
        "% of a core",
        SHARE,
        reference=EMPTY,
        against=bare_share,
    )
    yield BenchmarkLine(
        "estimator node at 10 Hz: resident memory",
        memory,
        "MB",
        MEMORY_MB,
        reference=EMPTY,
        against=bare_memory,
    )
    yield BenchmarkLine(
        "estimator node: processor time until it is ready",
        ready,
        "s",
        READY_S,
        reference=EMPTY,
        against=bare_ready,
    )


def observed(node: str, seconds: float) -> tuple[list[float], float, float, float, int]:
    """Return latencies [ms], share of a core [%], memory [MB], start [s], sets without an answer.

    The memory is the resident one, the start the processor time until all topics were matched.

    A set without an answer has an infinite latency.
    """
    steps = round(seconds * RATE_HZ)
    with facing(node) as (rover, process):
        found = psutil.Process(process.pid)
        started = found.cpu_times()
        instants = sets(WARM_UP + steps)
        rover.drive(instants, WARM_UP, 2.0 * RATE_HZ)
        before, begun_s = found.cpu_times(), time.perf_counter()
        sent = rover.drive(instants, steps, RATE_HZ)
        after, spent_s = found.cpu_times(), time.perf_counter() - begun_s
        share = 100.0 * (after.user + after.system - before.user - before.system) / spent_s
        return (
            [1e3 * sent.latency_s.get(stamp_ns, math.inf) for stamp_ns in sent.sent_s],
            share,
            found.memory_info().rss / 1e6,
            started.user + started.system,
            sent.lost,
        )
