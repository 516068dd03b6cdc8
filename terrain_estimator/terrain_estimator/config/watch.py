# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the watch node."""

from dataclasses import dataclass

from rover_parameters.records import entry, number


@dataclass(frozen=True, slots=True)
class WatchConfig:
    """All parameters of the watch node."""

    period_s: float = number(
        "time between two lines, by the wall clock", "s", 0.1, 3600.0, default=1.0, key="period"
    )
    report: str = entry(
        "JSON file for rates and jitter, written at the end; needs 8 bytes of memory per message;"
        " empty: none",
        "",
    )
    real_time_factor: float = number(
        "the simulation's, so that rates refer to simulated time", "1", 0.01, 1000.0, default=1.0
    )
