# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Costs beside the track as nav_msgs/OccupancyGrid, which Nav2's static layer takes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.config.map import GridConfig
from terrain_estimator.topics import Make, Message

UNKNOWN, LETHAL = -1, 100
HIGHEST = 98
"""Cost of ground that is hardly climbed; Nav2 takes 99 for the edge of an obstacle."""
BLOCK = 32
"""[cells] Grids grow by so many, since Nav2 makes a costmap anew whenever the size changes."""
WIDEST = 2**15 - 1
"""[cells] Nav2 refuses wider and higher grids."""
_AT_ONCE = 1_000_000
"""Cells that are drawn in one operation."""


@dataclass(frozen=True, slots=True)
class Grid:
    """Costs [height, width], the size of a cell [m], and the corner of the first cell [m]."""

    cost: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]


def costs(slope_limit: NDArray[np.floating], config: GridConfig) -> NDArray[np.int8]:
    """Return the cost of ground on which the rover climbs at most that slope [n] [rad]."""
    share = (config.free_slope - slope_limit) / (config.free_slope - config.lethal_slope)
    cost = np.rint(LETHAL * np.clip(share, 0.0, 1.0))
    return np.where(share < 1.0, np.minimum(cost, HIGHEST), cost).astype(np.int8)


def drawn(points: NDArray[np.void], config: GridConfig) -> Grid | None:
    """Draw ``points`` of a track, oldest first, so that a later pass counts; None without any.

    A point whose ``slope_limit`` is not known is not drawn.
    """
    known = points[np.isfinite(points["slope_limit"])]
    if not known.size:
        return None
    place = np.column_stack([known["x"], known["y"]]).astype(np.float64)
    cost = costs(known["slope_limit"], config)
    resolution, origin, shape = _frame(place, config)
    grid = np.full(shape, UNKNOWN, dtype=np.int8)
    aside = int(config.reach / resolution) + 1
    steps = np.arange(-aside, aside + 1)
    offset = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    chunk = max(_AT_ONCE // len(offset), 1)
    for start in range(0, len(place), chunk):
        here = (place[start : start + chunk] - origin) / resolution  # [cells]
        cell = np.floor(here)[:, None, :] + offset
        away = np.linalg.norm(cell + 0.5 - here[:, None, :], axis=-1) * resolution
        near = (away <= config.reach) | ~offset.any(-1)
        column, row = np.moveaxis(cell.astype(np.int64), -1, 0)
        near &= (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        value = np.broadcast_to(cost[start : start + chunk, None], near.shape)
        grid[row[near], column[near]] = value[near]
    return Grid(grid, resolution, (float(origin[0]), float(origin[1])))


def _frame(
    place: NDArray[np.float64], config: GridConfig
) -> tuple[float, NDArray[np.float64], tuple[int, int]]:
    """Return the size of a cell, the origin and (height, width) around all places [n, 2]."""
    resolution = config.resolution
    low, high = place.min(0) - config.reach, place.max(0) + config.reach
    while True:
        block = BLOCK * resolution
        first, last = np.floor(low / block), np.floor(high / block) + 1.0
        width, height = (last - first) * BLOCK
        if width * height <= config.cells and max(width, height) <= WIDEST:
            return resolution, first * block, (int(height), int(width))
        resolution *= 2.0


def grid_message(grid: Grid, make: Make, header: Message) -> Message:
    """Build nav_msgs/OccupancyGrid; ``header`` has the frame of the positions."""
    x, y = grid.origin
    origin = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
        orientation=make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    height, width = grid.cost.shape
    info = make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=header.stamp,
        resolution=grid.resolution,
        width=width,
        height=height,
        origin=origin,
    )
    return make("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=grid.cost.reshape(-1))
