# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the slip source node."""

from dataclasses import dataclass

from rover_parameters.records import entry, number
from terrain_estimator.topics import BODY_FRAME


@dataclass(frozen=True, slots=True)
class SlipSourceConfig:
    """All parameters of the slip source node."""

    rover: str = entry(
        "name or file of the rover: wheel radius, names and order of the wheels", "mars_rover"
    )
    velocity_type: str = entry(
        "message of the velocity: odometry (nav_msgs) or twist"
        " (geometry_msgs/TwistWithCovarianceStamped)",
        "odometry",
    )
    body_frame: str = entry(
        f"frame_id of the velocity and of the published slip; empty: any, and {BODY_FRAME} is"
        " published",
        BODY_FRAME,
        empty=True,
    )
    track_width: float = number(
        "distance between the centres of left and right wheels, by which the yaw rate of velocity"
        " (twist.twist.angular.z) changes their speeds; 0: as straight ahead",
        "m",
        0.0,
        100.0,
        default=0.0,
    )
    standstill_speed: float = number(
        "rim speed below which a wheel counts as standing; its slip is NaN",
        "m/s",
        0.0,
        1.0,
        default=0.01,
    )
    radius_sd: float = number(
        "relative standard deviation of the rolling radius",
        "1",
        0.0,
        1.0,
        default=0.01,
        key="radius_deviation",
    )
    rate_sd: float = number(
        "standard deviation of a wheel rate", "rad/s", 0.0, 10.0, default=0.0, key="rate_deviation"
    )
    default_velocity_sd: float = number(
        "standard deviation for a velocity without a variance; 0: it is refused",
        "m/s",
        0.0,
        10.0,
        default=0.0,
        key="default_sd.velocity",
    )
    tolerance_s: float = number(
        "largest difference between the stamps of a wheel rate and a velocity; 0: equal stamps"
        " only",
        "s",
        0.0,
        1.0,
        default=0.02,
        key="pairing_tolerance",
    )
    empty_sinkage: bool = entry(
        "publish wheel_sinkage, too, with NaN for all sinkages and contact angles, for a rover that"
        " measures neither",
        default=False,
    )
