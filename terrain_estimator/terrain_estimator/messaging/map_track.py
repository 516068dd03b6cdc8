# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimates along the track as evenly spaced points of a map, in bounded number."""

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.messaging.messages import Status
from terrain_estimator.topics import Make, Message, stamp_ns

POINT = np.dtype(
    {
        "names": [
            "x",
            "y",
            "z",
            "cohesion",
            "tan_phi",
            "cohesion_stddev",
            "tan_phi_stddev",
            "time",
            "slope_limit",
        ],
        "formats": ["<f4"] * 7 + ["<f8", "<f4"],
    }
)
"""Fields of a point [m, m, m, Pa, 1, Pa, 1, s, rad]; viewers need x, y, z in single precision."""
_LARGEST = float(np.finfo(np.float32).max)
"""Larger values are infinite in single precision."""
_KINDS = {"<f4": 7, "<f8": 8}  # sensor_msgs/PointField: FLOAT32, FLOAT64


Judge: TypeAlias = Callable[[Message], float]
"""The steepest slope that the rover climbs on the ground of an estimate [rad]."""


class MapTrack:
    """Points along the way, at least a spacing apart.

    When they are too many, every second one is removed and the spacing doubles.

    Where stamps go back (a bag loops, another run begins, a clock was set back) the track starts
    again: places and times of two runs do not belong on one map.
    """

    def __init__(self, spacing_m: float, capacity: int) -> None:
        """Start an empty track."""
        self._least_m, self._capacity = spacing_m, capacity
        self._latest_ns = 0
        self._begin()

    def _begin(self) -> None:
        self._spacing_m = self._least_m
        self._points: list[tuple[float, ...]] = []

    def __len__(self) -> int:
        return len(self._points)

    def add(
        self, estimate: Message, odometry: Message, climbable: Judge = lambda _: math.nan
    ) -> bool:
        """Add an estimate at the rover's position; return whether the points changed.

        ``climbable`` returns the steepest slope [rad] on such ground, NaN where it is not known.

        Values that are not finite add no point, nor does an estimate without observations or of a
        model that does not fit: it is the prior, and holds no information about the place.
        """
        now = stamp_ns(estimate)
        anew = bool(self._points) and now < self._latest_ns
        if anew:
            self._begin()
        self._latest_ns = now
        learnt = estimate.observations_used > 0 and estimate.status != Status.DISAGREES
        return (learnt and self._append(estimate, odometry, climbable)) or anew

    def _append(self, estimate: Message, odometry: Message, climbable: Judge) -> bool:
        place = odometry.pose.pose.position
        values = (
            estimate.cohesion,
            estimate.tan_phi,
            estimate.cohesion_stddev,
            estimate.tan_phi_stddev,
        )
        point = (place.x, place.y, place.z, *values, stamp_ns(estimate) * 1e-9)
        if not all(abs(value) <= _LARGEST for value in point):
            return False
        if self._points and math.dist(point[:3], self._points[-1][:3]) < self._spacing_m:
            return False
        if len(self._points) == self._capacity:
            self._points = self._points[::2]
            self._spacing_m *= 2.0
        self._points.append((*point, climbable(estimate)))
        return True

    def points(self) -> NDArray[np.void]:
        """Return all points, oldest first."""
        return np.array(self._points, dtype=POINT)


def cloud_message(track: MapTrack, make: Make, header: Message) -> Message:
    """Build sensor_msgs/PointCloud2 from the points; ``header`` has the frame of the positions."""
    points = track.points()
    fields = [
        make(
            "sensor_msgs/msg/PointField",
            name=name,
            offset=kind[1],
            datatype=_KINDS[kind[0].str],
            count=1,
        )
        for name, kind in (POINT.fields or {}).items()
    ]
    return make(
        "sensor_msgs/msg/PointCloud2",
        header=header,
        height=1,
        width=len(track),
        fields=fields,
        is_bigendian=False,
        point_step=POINT.itemsize,
        row_step=POINT.itemsize * len(track),
        data=np.frombuffer(points.tobytes(), dtype=np.uint8),
        is_dense=bool(np.isfinite(points["slope_limit"]).all()),
    )
