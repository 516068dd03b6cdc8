# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The grid of costs of the map node: latched, in the odometry's frame, by the estimates."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from msg_defs.msg import TerrainEstimate
from rover_parameters.records import ConfigError
from terrain_estimator.messaging.map_track import POINT
from terrain_estimator.model.metadata import MODELS, read_metadata
from terrain_estimator.nodes.terrain_map import MapNode
from tests.system.listening import LATCHED, Listener
from tests.system.processes import Starter

MODEL = read_metadata(MODELS / "mars_rover.json")
SOILS = [soil.name for soil in MODEL.soils]
FIRM, SOFT = (3000.0, 0.75), (300.0, 0.2)


def drive(
    listener: Listener,
    grounds: Sequence[tuple[float, float]],
    soils: Sequence[str] = SOILS,
    sha256: str = MODEL.sha256,
) -> None:
    """Publish an identified estimate of each ground, a metre further each."""
    odometry = listener.publisher(Odometry, "odom")
    estimates = listener.publisher(TerrainEstimate, "terrain_estimate")
    for step, (cohesion, tan_phi) in enumerate(grounds):
        header = Header(frame_id="map")
        header.stamp.sec = step + 1
        estimate = TerrainEstimate(
            header=header,
            model_id="of the test",
            model_sha256=sha256,
            cohesion=cohesion,
            tan_phi=tan_phi,
            covariance=np.diag([100.0**2, 0.02**2]).reshape(-1),
            soil=list(soils),
            soil_probability=[1.0, *[0.0] * (len(soils) - 1)],
            cohesion_identified=True,
            tan_phi_identified=True,
            observations_used=1,
        )
        place = Odometry(header=header)
        place.pose.pose.position.x = 0.05 + step
        estimates.publish(estimate)
        odometry.publish(place)
        listener.spin_until(lambda: True, "what came is taken")


def hosted(listener: Listener, **values: Any) -> MapNode:
    given = [Parameter(name, value=value) for name, value in values.items()]
    return listener.host(MapNode, parameter_overrides=given)


def slopes(listener: Listener, **values: Any) -> list[float]:
    """Return the climbable slopes of firm and soft ground on the cloud."""
    node = hosted(listener, period=0.0, **values)
    clouds = listener.collect(PointCloud2, "terrain_map", LATCHED)
    drive(listener, [FIRM, SOFT])
    listener.spin_until(lambda: bool(clouds) and clouds[-1].width == 2, "both points are there")
    listener.leave(node)
    return np.frombuffer(bytes(clouds[-1].data), dtype=POINT)["slope_limit"].tolist()


def test_a_late_reader_gets_the_costs_of_the_whole_track(
    start: Starter, listener: Listener
) -> None:
    process = start("terrain_estimator", "terrain_map", "--ros-args", "-p", "period:=0.0")
    process.wait_for_output("ready", timeout=60.0)
    early = listener.collect(OccupancyGrid, "terrain_grid", LATCHED)
    drive(listener, [FIRM, SOFT])
    listener.wait_for_messages(early, 2)
    late = listener.collect(OccupancyGrid, "terrain_grid", LATCHED)
    listener.wait_for_messages(late, 1)
    grid = late[0]
    assert grid.header.frame_id == "map"
    cost = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    row = int((0.0 - grid.info.origin.position.y) / grid.info.resolution + 1e-6)
    firm, soft, beyond = (
        cost[row, int((x - grid.info.origin.position.x) / grid.info.resolution + 1e-6)]
        for x in (0.05, 1.05, 2.05)
    )
    assert 0 <= firm < 50
    assert soft == 100
    assert beyond == -1
    assert process.interrupt(60.0) == 0


def test_the_slope_is_one_that_the_rover_climbs_and_falls_with_each_doubt(
    listener: Listener,
) -> None:
    firm, soft = slopes(listener)
    assert 0.15 < firm < 0.6
    assert soft < 0.05
    assert slopes(listener, slip_limit=0.2)[0] < firm
    assert slopes(listener, pull_deviation=0.1)[0] < firm


@pytest.mark.parametrize(
    ("estimates", "words"),
    [
        ({"sha256": "0" * 64}, f"of model of the test: this node has {MODEL.model_id}: give both"),
        ({"soils": ["chalk"]}, "of model of the test: its soils are chalk"),
    ],
    ids=["model", "soils"],
)
def test_an_estimate_of_another_model_has_a_point_and_no_cost(
    estimates: dict[str, Any],
    words: str,
    listener: Listener,
    capfd: pytest.CaptureFixture[str],
) -> None:
    node = hosted(listener, period=0.0)
    clouds = listener.collect(PointCloud2, "terrain_map", LATCHED)
    grids = listener.collect(OccupancyGrid, "terrain_grid", LATCHED)
    drive(listener, [FIRM], **estimates)
    listener.wait_for_messages(clouds, 1)
    assert (clouds[0].width, clouds[0].is_dense, grids) == (1, False, [])
    assert f"terrain_grid lacks an estimate {words}" in capfd.readouterr().err
    listener.leave(node)


def test_what_is_wrong_is_named(listener: Listener) -> None:
    with pytest.raises(ConfigError, match="lunar_rover"):
        hosted(listener, model="lunar_rover")
    with pytest.raises(
        ConfigError,
        match=r"rover four_wheel_rover: .* the model .* is for.*"
        r" train --rover four_wheel_rover --soil loose_sand .* --out models",
    ):
        hosted(listener, rover="four_wheel_rover")
    with pytest.raises(ConfigError, match=r"grid\.reach"):
        hosted(listener, **{"grid.reach": 60.0})
