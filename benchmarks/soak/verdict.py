# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Required length of a soak, its quantities, and their allowed growth."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from benchmarks.soak.core import ProcessSample
from benchmarks.soak.live import FACTOR, RoverSeries
from benchmarks.trend import Trend, counted, trend
from terramechanics.simulation.sample import TIME_STEP

HOURS, DDS_HOURS = 24.0, 2.0
"""Simulated hours of every rover, through the core and over DDS."""
RATE_HZ = FACTOR / TIME_STEP
LEAST_RATE = 0.99
"""[1] Least rate, as a share of RATE_HZ."""

MEMORY = 0.01
"""[1] Allowed growth of memory in a run: 3 MB of 300; in 24 simulated hours 4 B an observation."""
TIME = 0.1
"""[1] Allowed growth of the time of a set of messages, as the machine's other load varies."""
RATE = 0.01
"""[1] Allowed change of the rate, up or down."""


@dataclass(frozen=True, slots=True)
class Ran:
    """Length of a soak, with an entry for each rover."""

    core_hours: list[float]
    dds_hours: list[float]
    dds_rate_hz: list[float]  # medians
    minutes: float  # of wall time

    @classmethod
    def of(
        cls, core: Sequence[Sequence[ProcessSample]], series: Sequence[RoverSeries], minutes: float
    ) -> Self:
        """Return the length that the samples show."""
        rates = [float(np.median(rover.rate_hz)) for rover in series]
        return cls(
            [samples[-1].hours for samples in core],
            [rover.hours for rover in series],
            rates,
            minutes,
        )

    def shortfalls(self) -> Iterator[str]:
        """Yield a text for each part that fell short."""
        parts = (
            ("core", "simulated hours", self.core_hours, HOURS),
            ("DDS", "simulated hours", self.dds_hours, DDS_HOURS),
            ("DDS", "estimates/s", self.dds_rate_hz, LEAST_RATE * RATE_HZ),
        )
        for part, unit, values, least in parts:
            for rover, value in enumerate(values, 1):
                if value < least:
                    yield (
                        f"{part}, rover{rover}: {value:.3g} {unit}, at least {least:.3g} are wanted"
                    )


def core_trends(rover: str, samples: Sequence[ProcessSample]) -> Iterator[Trend]:
    """Yield the trends of one rover's hours without ROS."""
    hours = [sample.hours for sample in samples]
    for name, allowed in (("memory_mb", MEMORY), ("blocks", MEMORY), ("set_us", TIME)):
        yield trend(
            f"core, {rover}: {name}", hours, [getattr(sample, name) for sample in samples], allowed
        )
    for name in ("abnormal", "not_finite", "troubled"):
        yield counted(
            f"core, {rover}: {name}", hours, [getattr(sample, name) for sample in samples]
        )


def live_trends(series: RoverSeries) -> Iterator[Trend]:
    """Yield the trends of one rover over DDS."""
    for name in ("estimator_mb", "simulator_mb"):
        yield trend(f"DDS, {series.rover}: {name}", series.seconds, getattr(series, name), MEMORY)
    yield trend(
        f"DDS, {series.rover}: rate_hz", series.seconds, series.rate_hz, RATE, both_ways=True
    )
    for name, counts in series.counters.items():
        yield counted(f"DDS, {series.rover}: {name}", series.seconds, counts)
