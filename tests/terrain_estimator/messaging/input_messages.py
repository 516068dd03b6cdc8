# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of one instant, for tests of their conversion."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import Types
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion import (
    Conversion,
    Converter,
)
from terrain_estimator.nodes.common import message_types
from terrain_estimator.observation import Observation
from terrain_estimator.topics import (
    Make,
)
from terramechanics.presets import load_rover
from terramechanics.vehicle.rover import Rover

ROVER: Rover = load_rover("mars_rover")
WHEELS = list(ROVER.wheel_names)
STAMP = 12_500_000_000
FACTORIES = pytest.mark.parametrize(
    "make", [message_types.make, Types().make], ids=["rclpy", "bags"]
)
OFFLINE = Types().make


def spread(values: list[float], delta: float = 0.0) -> list[float]:
    """Return values per axle as values per wheel, left and right apart by twice ``delta``."""
    return [
        values[wheel.axle] + (delta if wheel.side == "left" else -delta) for wheel in ROVER.wheels
    ]


def quaternion(make: Make, nose_up: float) -> Any:
    """Return the orientation of a rover with its nose up: a negative rotation about y (REP-103)."""
    return make(
        "geometry_msgs/msg/Quaternion",
        x=0.0,
        y=math.sin(-nose_up / 2),
        z=0.0,
        w=math.cos(nose_up / 2),
    )


def vector(make: Make, **components: float) -> Any:
    return make("geometry_msgs/msg/Vector3", **components)


def covariance(size: int, **entries: float) -> Any:
    values = np.zeros(size)
    for key, value in entries.items():
        values[int(key[1:])] = value
    return values


def wheel_slip(make: Make, **changes: Any) -> Any:
    fields = {
        "wheel": WHEELS,
        "slip": spread([0.1, 0.2, 0.3], 0.02),
        "slip_stddev": [0.01] * 6,
        "header": header(make),
    }
    return make("msg_defs/msg/WheelSlip", **(fields | changes))


def wheel_sinkage(make: Make, **changes: Any) -> Any:
    fields = {
        "header": header(make),
        "wheel": WHEELS,
        "sinkage": spread([0.018, 0.02, 0.016]),
        "sinkage_stddev": [0.001] * 6,
        "contact_angle": spread([0.05, 0.0, -0.05]),
        "contact_angle_stddev": [0.005] * 6,
    }
    return make("msg_defs/msg/WheelSinkage", **(fields | changes))


def header(make: Make, frame: str = "base_link") -> Any:
    return make(
        "std_msgs/msg/Header",
        stamp=make("builtin_interfaces/msg/Time", sec=12, nanosec=500_000_000),
        frame_id=frame,
    )


def odom(
    make: Make,
    velocity_variance: float = 1e-4,
    pitch_variance: float = 4e-4,
    frame: str = "base_link",
) -> Any:
    pose = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point"),
        orientation=quaternion(make, 0.03),
    )
    twist = make("geometry_msgs/msg/Twist", linear=vector(make, x=0.17), angular=vector(make))
    return make(
        "nav_msgs/msg/Odometry",
        header=header(make, "odom"),
        child_frame_id=frame,
        pose=make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=pose,
            covariance=covariance(36, _28=pitch_variance),
        ),
        twist=make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=twist,
            covariance=covariance(36, _0=velocity_variance),
        ),
    )


def joint_states(make: Make, **changes: Any) -> Any:
    fields = {
        "header": header(make, ""),
        "name": ["rocker", *reversed(WHEELS), "bogie"],
        "position": [0.0] * 8,
        "velocity": [0.0, *reversed(spread([1.5, 1.6, 1.7])), 0.0],
        "effort": [0.0, *reversed(spread([10.0, 12.0, 14.0], 0.5)), 0.0],
    }
    return make("sensor_msgs/msg/JointState", **(fields | changes))


def imu(make: Make, **changes: Any) -> Any:
    fields = {
        "header": header(make),
        "orientation": quaternion(make, 0.05),
        "orientation_covariance": covariance(9, _4=2.5e-5),
        "angular_velocity": vector(make),
        "linear_acceleration": vector(make, x=0.25),
        "linear_acceleration_covariance": covariance(9, _0=4e-4),
    }
    return make("sensor_msgs/msg/Imu", **(fields | changes))


def messages(make: Make = OFFLINE) -> dict[str, Any]:
    makers: dict[str, Callable[[Make], Any]] = {
        "wheel_slip": wheel_slip,
        "wheel_sinkage": wheel_sinkage,
        "odom": odom,
        "joint_states": joint_states,
        "imu": imu,
    }
    return {name: build(make) for name, build in makers.items()}


def convert(
    core: CoreConfig | None = None, config: ConversionConfig | None = None, **changes: Any
) -> Conversion:
    converter = Converter(ROVER, config or ConversionConfig(), core or CoreConfig())
    return converter.convert(STAMP, tuple((messages() | changes).values()))


def observed(conversion: Conversion) -> Observation:
    assert conversion.observation is not None, conversion.detail
    return conversion.observation
