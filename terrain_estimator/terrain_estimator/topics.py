# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Names and types of messages and topics, without importing ROS."""

from collections.abc import Callable
from typing import Any, TypeAlias

Message: TypeAlias = Any
"""A ROS message, duck-typed: of rclpy's class, or of the equal one that is read from a bag."""

Make: TypeAlias = Callable[..., Message]
"""A factory ``make(type_name, **fields)``: rclpy's classes live, those of the bags offline."""

INPUT_TYPES = {
    "wheel_slip": "msg_defs/msg/WheelSlip",
    "wheel_sinkage": "msg_defs/msg/WheelSinkage",
    "odom": "nav_msgs/msg/Odometry",
    "joint_states": "sensor_msgs/msg/JointState",
    "imu": "sensor_msgs/msg/Imu",
}
"""Types of the estimator's input topics."""

BODY_FRAME = "base_link"
"""Frame of the rover's body by REP 105, published where the user names none."""

UNDISTURBED = "undisturbed"
"""Reference of a sinkage that is measured from ground where no wheel has been."""

LOCAL = "local"
"""Reference of a sinkage that is measured from the ground right before the wheel, in a track."""

REQUIRED_INPUTS = ("wheel_slip", "wheel_sinkage", "odom")
"""Inputs that every observation needs; the first gives the stamps."""

ROLL_IN_POSE = 21  # (3, 3) of a 6 x 6 covariance, row-major: rotation about x
PITCH_IN_POSE = 28  # (4, 4) of a 6 x 6 covariance, row-major: rotation about y
LATERAL_IN_TWIST = 7  # (1, 1): velocity along y
YAW_IN_TWIST = 35  # (5, 5): rate of rotation about z
YAW_IN_RATES = 8  # (2, 2) of a 3 x 3 covariance
ROLL_IN_ORIENTATION = 0  # (0, 0) of a 3 x 3 covariance
PITCH_IN_ORIENTATION = 4  # (1, 1) of a 3 x 3 covariance

ESTIMATE = "msg_defs/msg/TerrainEstimate"
PREDICTION = "msg_defs/msg/MotionPrediction"
HEALTH = "msg_defs/msg/EstimatorHealth"
DECISION = "msg_defs/msg/MeasurementDecision"
ADVICE = "msg_defs/msg/TractionAdvice"
TRUTH = "msg_defs/msg/TerrainTruth"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

OUTPUT_TYPES = {"terrain_estimate": ESTIMATE, "motion_prediction": PREDICTION}
"""Types of the output topics that depend on the stamped inputs alone; replay writes them too."""

LISTENED = {"terrain_estimate": ESTIMATE} | {topic: INPUT_TYPES[topic] for topic in REQUIRED_INPUTS}
"""Types of the topics that planner, watch and dashboard need."""

OPTIONAL_TOPICS = ("traction_advice", "terrain_map", "ground_truth/terrain", "/diagnostics")
"""Topics that not every rover has; the recorder does not miss them."""

RECORDED_TOPICS = (*INPUT_TYPES, *OUTPUT_TYPES, "estimator_health", *OPTIONAL_TOPICS)
"""Topics that the recorder records by default: all of the suite."""


def paired_inputs(*, use_imu: bool) -> tuple[str, ...]:
    """Return the input topics of one observation; unused ones are not waited for."""
    return tuple(name for name in INPUT_TYPES if name != "imu" or use_imu)


def stamp_ns(message: Message) -> int:
    """Return the stamp [ns] of a message with a header."""
    stamp = message.header.stamp
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)
