# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What of a soak must not grow, and by how much it may."""

from collections.abc import Iterator, Sequence

from benchmarks.soak.core import Sample
from benchmarks.soak.live import Series
from benchmarks.trend import Trend, counted, trend

MEMORY = 0.01
"""[1] Of the level over a run: 3 MB of 300, over 24 simulated hours 4 bytes an observation."""
TIME = 0.1
"""[1] Of an update: what else the machine does comes and goes."""
RATE = 0.01
"""[1] Of the rate, up or down."""


def core_trends(rover: str, samples: Sequence[Sample]) -> Iterator[Trend]:
    """Of one rover's hours without ROS."""
    hours = [sample.hours for sample in samples]
    for name, allowed in (("memory_mb", MEMORY), ("blocks", MEMORY), ("update_us", TIME)):
        yield trend(f"core, {rover}: {name}", hours, [getattr(sample, name) for sample in samples], allowed)
    for name in ("abnormal", "not_finite"):
        yield counted(f"core, {rover}: {name}", hours, [getattr(sample, name) for sample in samples])


def live_trends(series: Series) -> Iterator[Trend]:
    """Of one rover over DDS."""
    for name in ("estimator_mb", "simulator_mb"):
        yield trend(f"DDS, {series.rover}: {name}", series.seconds, getattr(series, name), MEMORY)
    yield trend(f"DDS, {series.rover}: rate_hz", series.seconds, series.rate_hz, RATE, both_ways=True)
    for name, counts in series.counters.items():
        yield counted(f"DDS, {series.rover}: {name}", series.seconds, counts)
