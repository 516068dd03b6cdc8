# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the map node."""

from dataclasses import dataclass

from rover_parameters.records import number


@dataclass(frozen=True, slots=True)
class MapConfig:
    """All parameters of the map node."""

    spacing_m: float = number(
        "smallest distance between two points",
        "m",
        0.0,
        1000.0,
        exclusive=True,
        default=0.1,
        key="spacing",
    )
    points: int = number(
        "largest number of points; beyond it every second point is removed and the spacing doubles",
        "1",
        2,
        1_000_000,
        default=5000,
    )
    period_s: float = number(
        "time between two clouds, by their stamps", "s", 0.0, 3600.0, default=1.0, key="period"
    )
    tolerance_s: float = number(
        "largest difference between the stamps of an estimate and its odometry; 0: equal stamps"
        " only",
        "s",
        0.0,
        1.0,
        default=0.0,
        key="pairing_tolerance",
    )
