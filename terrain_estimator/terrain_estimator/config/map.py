# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the map node."""

from dataclasses import dataclass, field

from rover_parameters.records import ConfigError, entry, number
from terrain_estimator.config.planner import pull_deviation_entry

MOST_CELLS_ASIDE = 50
"""Largest reach in cells, so that drawing a long track takes a fraction of a second."""


@dataclass(frozen=True, slots=True)
class GridConfig:
    """Parameters of the grid of costs. Raises ConfigError where they do not fit together."""

    resolution: float = number("size of a cell", "m", 0.01, 100.0, default=0.1)
    reach: float = number(
        "distance from the track up to which cells get its cost; 0: the cells on the track alone",
        "m",
        0.0,
        100.0,
        default=0.5,
    )
    cells: int = number(
        "largest number of cells; beyond it the size of a cell doubles",
        "1",
        10_000,
        100_000_000,
        default=1_000_000,
    )
    free_slope: float = number(
        "steepest climbable slope from which the cost is 0", "rad", -0.7, 0.7, default=0.25
    )
    lethal_slope: float = number(
        "steepest climbable slope up to which the cost is 100", "rad", -0.7, 0.7, default=0.0
    )

    def __post_init__(self) -> None:
        if self.reach > MOST_CELLS_ASIDE * self.resolution:
            raise ConfigError(
                f"parameter grid.reach: {self.reach:g} m are more than {MOST_CELLS_ASIDE} cells of"
                f" grid.resolution {self.resolution:g} m: give less, or larger cells"
            )
        if self.free_slope <= self.lethal_slope:
            raise ConfigError(
                f"parameter grid.free_slope: {self.free_slope:g} must be above grid.lethal_slope"
                f" {self.lethal_slope:g}"
            )


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
    model: str = entry(
        "name of an installed model, or path of a model file, as for the estimator, by which slopes"
        " are judged; empty: mars_rover",
        "",
    )
    rover: str = entry("name or file of the rover; empty: the model's", "")
    slip_limit: float = number(
        "slip up to which pull counts as available on a slope", "1", 0.1, 0.9, default=0.6
    )
    pull_deviation: float = pull_deviation_entry()
    grid: GridConfig = field(default_factory=GridConfig)
