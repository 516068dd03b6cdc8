# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Points of the map: evenly spaced, bounded, readable as any point cloud."""

import math
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import Types
from terrain_estimator.messaging.map_track import POINT, MapTrack, cloud_message
from terrain_estimator.messaging.messages import Status
from terrain_estimator.topics import Message

TYPES = Types()


def estimate(
    time_s: float, cohesion: float = 1500.0, used: int = 1, status: Status = Status.IDENTIFIED
) -> Message:
    header = TYPES.make(
        "std_msgs/msg/Header",
        stamp=TYPES.make("builtin_interfaces/msg/Time", sec=int(time_s), nanosec=0),
        frame_id="",
    )
    values = {
        "cohesion": cohesion,
        "cohesion_stddev": 200.0,
        "tan_phi": 0.6,
        "tan_phi_stddev": 0.04,
    }
    return TYPES.make(
        "msg_defs/msg/TerrainEstimate",
        header=header,
        covariance=np.zeros(4),
        observations_used=used,
        status=int(status),
        **values,
    )


def odometry(x: float, z: float = 0.0) -> Message:
    position = TYPES.make("geometry_msgs/msg/Point", x=x, y=0.5, z=z)
    pose = TYPES.make("geometry_msgs/msg/Pose", position=position)
    return TYPES.make(
        "nav_msgs/msg/Odometry",
        pose=TYPES.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
    )


def filled(count: int, **values: Any) -> MapTrack:
    track = MapTrack(values.get("spacing_m", 0.1), values.get("capacity", 1000))
    for step in range(count):
        track.add(estimate(step, 1000.0 + step), odometry(0.05 * step))
    return track


def test_points_are_a_spacing_apart_and_carry_what_was_estimated_there() -> None:
    points = filled(9, spacing_m=0.099).points()
    np.testing.assert_allclose(points["x"], [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)
    np.testing.assert_allclose(points["cohesion"], [1000.0, 1002.0, 1004.0, 1006.0, 1008.0])
    assert points[1].tolist()[1:3] == (0.5, 0.0)
    assert points["time"].tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]


def test_memory_is_bounded_and_the_whole_way_stays() -> None:
    track = filled(4000, capacity=50, spacing_m=0.01)
    points = track.points()
    assert 25 <= len(track) <= 50
    assert points["x"][0] == 0.0
    assert points["x"][-1] > 0.9 * 0.05 * 3999
    gaps = np.diff(points["x"])
    assert gaps.max() < 3.0 * gaps.min()


def test_the_prior_is_no_point() -> None:
    track = MapTrack(0.1, 10)
    assert not track.add(estimate(0.0, used=0), odometry(0.0))
    assert not track.add(estimate(1.0, status=Status.DISAGREES), odometry(0.0))
    assert track.add(estimate(2.0, status=Status.CONVERGING), odometry(0.0))


def test_what_is_not_finite_is_no_point() -> None:
    track = MapTrack(0.1, 10)
    assert not track.add(estimate(0.0, math.nan), odometry(0.0))
    assert not track.add(estimate(0.0), odometry(math.inf))
    assert not track.add(estimate(0.0), odometry(-1e39)), "infinite in single precision"
    assert len(track) == 0
    assert cloud_message(track, TYPES.make, estimate(0.0).header).width == 0


def test_an_estimate_without_observations_is_no_point() -> None:
    track = MapTrack(0.1, 10)
    assert not track.add(estimate(0.0, used=0), odometry(0.0))
    assert len(track) == 0


def test_stamps_that_go_back_begin_another_track_at_the_first_spacing() -> None:
    track = filled(200, capacity=20, spacing_m=0.05)  # so many that the spacing has doubled
    assert track.add(estimate(3.0, used=0), odometry(0.3))
    assert len(track) == 0
    assert cloud_message(track, TYPES.make, estimate(3.0).header).width == 0
    for step in range(4, 8):
        assert track.add(estimate(step), odometry(0.06 * step))
    assert track.points()["time"].tolist() == [4.0, 5.0, 6.0, 7.0]
    assert not track.add(estimate(9.0), odometry(0.06 * 7))
    assert track.add(estimate(8.0, math.nan), odometry(0.5))
    assert len(track) == 0


def test_the_cloud_is_laid_out_as_its_fields_say() -> None:
    track = MapTrack(0.0001, 1000)
    for step in range(5):
        track.add(estimate(step, 1000.0 + step), odometry(0.05 * step), lambda _: 0.2)
    message = cloud_message(track, TYPES.make, estimate(4.0).header)
    kinds = {7: "<f4", 8: "<f8"}
    described = np.dtype(
        {
            "names": [field.name for field in message.fields],
            "formats": [kinds[field.datatype] for field in message.fields],
            "offsets": [field.offset for field in message.fields],
            "itemsize": message.point_step,
        }
    )
    assert described == POINT
    points = np.frombuffer(message.data.tobytes(), dtype=described)
    assert (message.width, message.row_step) == (5, 5 * message.point_step)
    np.testing.assert_array_equal(points, track.points())
    assert message.is_dense


def test_a_climbable_slope_is_asked_for_once_a_point_and_may_be_unknown() -> None:
    track, asked = MapTrack(0.1, 10), list[float]()

    def climbable(message: Message) -> float:
        asked.append(message.cohesion)
        return 0.2 if message.cohesion > 1000.0 else math.nan

    for step, cohesion in enumerate((1500.0, 1600.0, 900.0)):
        track.add(estimate(step, cohesion), odometry(0.06 * step), climbable)
    assert asked == [1500.0, 900.0]
    assert track.points()["slope_limit"].tolist() == pytest.approx([0.2, math.nan], nan_ok=True)
    assert not cloud_message(track, TYPES.make, estimate(4.0).header).is_dense
