# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The grid of costs: where the track was, as large as it must be, and as Nav2 reads it."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from rover_parameters.parameters import configure
from rover_parameters.records import ConfigError
from terrain_estimator.bags import Types
from terrain_estimator.config.map import GridConfig, MapConfig
from terrain_estimator.messaging.map_grid import BLOCK, Grid, costs, drawn, grid_message
from terrain_estimator.messaging.map_track import POINT
from terrain_estimator.nodes.common import message_types
from terrain_estimator.topics import Make

SMALL = GridConfig(resolution=0.1, reach=0.0)
TYPES = Types()


def track(*places: tuple[float, float, float]) -> NDArray[np.void]:
    """Return points at x, y with a climbable slope."""
    points = np.zeros(len(places), dtype=POINT)
    for name, values in zip(("x", "y", "slope_limit"), zip(*places, strict=True), strict=True):
        points[name] = values
    return points


def grid(points: NDArray[np.void], config: GridConfig = SMALL) -> Grid:
    found = drawn(points, config)
    assert found is not None
    return found


def value(found: Grid, x: float, y: float) -> int:
    column, row = (
        math.floor((at - edge) / found.resolution)
        for at, edge in zip((x, y), found.origin, strict=True)
    )
    return int(found.cost[row, column])


def test_the_cost_falls_from_lethal_to_free_with_the_climbable_slope() -> None:
    slopes = np.array([-0.7, 0.0, 0.0025, 0.05, 0.125, 0.2, 0.25, 0.7])
    assert costs(slopes, GridConfig()).tolist() == [100, 100, 98, 80, 50, 20, 0, 0]


def test_cells_of_the_track_have_its_cost_and_all_others_are_unknown() -> None:
    found = grid(track((0.05, 0.05, 0.0), (0.35, -0.25, 0.25)))
    assert value(found, 0.05, 0.05) == 100
    assert value(found, 0.35, -0.25) == 0
    assert (found.cost >= 0).sum() == 2
    assert found.cost.min() == -1


def test_a_track_is_as_wide_as_its_reach_and_a_later_pass_counts() -> None:
    config = GridConfig(resolution=0.1, reach=0.3)
    found = grid(track((1.05, 1.05, 0.0), (1.25, 1.05, 0.25)), config)
    assert value(found, 1.34, 1.05) == value(found, 1.25, 1.24) == 0
    assert value(found, 0.85, 1.05) == 100
    assert value(found, 1.15, 1.05) == 0, "within reach of both"
    assert value(found, 1.05, 1.55) == -1


def test_it_grows_by_blocks_of_cells_of_which_the_corners_stay_the_same() -> None:
    first, second = (grid(track((0.05, 0.05, 0.1), (x, 0.05, 0.1))) for x in (0.3, 3.0))
    assert first.cost.shape == second.cost.shape == (BLOCK, BLOCK)
    wider = grid(track((0.05, 0.05, 0.1), (3.3, 0.05, 0.1)))
    assert wider.cost.shape == (BLOCK, 2 * BLOCK)
    assert first.origin == wider.origin == (0.0, 0.0)


@pytest.mark.parametrize("far", [100.0, 1e6, 3e38])
def test_its_memory_is_bounded_however_far_the_odometry_jumps(far: float) -> None:
    found = grid(track((-far, 0.0, 0.0), (far, 0.5 * far, 0.25)), GridConfig(cells=10_000))
    assert found.cost.size <= 10_000
    assert sorted(set(found.cost.flat)) == [-1, 0, 100]


def test_it_is_no_wider_than_nav2_takes() -> None:
    found = grid(track((0.0, 0.0, 0.0), (4000.0, 0.0, 0.25)), GridConfig(cells=100_000_000))
    assert found.cost.shape[1] <= 2**15 - 1
    assert found.resolution == pytest.approx(0.2)


def test_without_a_known_slope_there_is_no_grid() -> None:
    assert drawn(track((0.0, 0.0, math.nan)), SMALL) is None
    assert drawn(np.zeros(0, dtype=POINT), SMALL) is None


@pytest.mark.parametrize("make", [TYPES.make, message_types.make], ids=["bag", "rclpy"])
def test_the_message_is_row_by_row_from_its_origin(make: Make) -> None:
    found = grid(track((-0.05, 0.15, 0.0), (0.25, 0.15, 0.25)))
    header = make("std_msgs/msg/Header", stamp=make("builtin_interfaces/msg/Time", sec=7))
    header.frame_id = "odom"
    message = grid_message(found, make, header)
    info = message.info
    assert (message.header.frame_id, info.map_load_time.sec) == ("odom", 7)
    assert (info.width, info.height) == (2 * BLOCK, BLOCK)
    assert info.resolution == pytest.approx(0.1)
    assert info.origin.position.x == pytest.approx(-3.2)
    assert (info.origin.position.y, info.origin.orientation.w) == (0.0, 1.0)
    assert len(message.data) == info.width * info.height
    assert message.data[info.width + 31] == 100
    assert message.data[info.width + 34] == 0


def test_each_parameter_changes_the_grid() -> None:
    points = track((0.0, 0.0, 0.15), (200.0, 10.0, 0.15))
    plain = grid(points, GridConfig())
    for name, other in {
        "grid.resolution": 0.2,
        "grid.reach": 0.0,
        "grid.cells": 10_000,
        "grid.free_slope": 0.5,
        "grid.lethal_slope": 0.1,
    }.items():
        changed = grid(points, configure(MapConfig, {name: other}).grid)
        assert (plain.resolution, plain.cost.tobytes()) != (
            changed.resolution,
            changed.cost.tobytes(),
        ), name


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"grid.reach": 6.0}, r"grid.reach: 6 m are more than 50 cells of grid.resolution 0.1 m"),
        ({"grid.lethal_slope": 0.3}, r"grid.free_slope: 0.25 must be above grid.lethal_slope 0.3"),
        ({"grid.reech": 0.1}, r"grid.reech: did you mean grid.reach\?"),
        ({"grid.cells": 10}, r"grid.cells"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_by_name(
    given: dict[str, float], words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        configure(MapConfig, given)
