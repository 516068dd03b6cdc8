# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Convert readings to messages.

Pitch is nose-up inside, and nose-down in the messages' REP-103 axes (x forward, y left, z up).
"""

import array
import math
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Quaternion
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header
from torch import Tensor

from msg_defs.msg import TerrainTruth, WheelSinkage, WheelSlip
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.reading import FIXED, STRAIGHT, GroundTruth, SimulatedReading
from terramechanics.description.layout import BOGIE, STEERING_SUFFIX, suspension_joints
from terramechanics.effects import describe
from terramechanics.terrain.soil import CONSTANTS

SECOND_NS = 1_000_000_000
TYPES: dict[str, type[Any]] = {
    "wheel_slip": WheelSlip,
    "wheel_sinkage": WheelSinkage,
    "odom": Odometry,
    "joint_states": JointState,
    "imu": Imu,
}
"""Topics of every step."""

_TRUTH_FIELDS = {
    "n": "sinkage_exponent",
    "k_c": "cohesive_modulus",
    "k_phi": "frictional_modulus",
    "shear_modulus": "shear_modulus",
    "c1": "stress_angle_offset",
    "c2": "stress_angle_slope",
}


def time_message(stamp_ns: int) -> Time:
    """Return a time of ``stamp_ns`` nanoseconds."""
    seconds, nanoseconds = divmod(stamp_ns, SECOND_NS)
    return Time(sec=seconds, nanosec=nanoseconds)


def clock_message(stamp_ns: int) -> Clock:
    """Return the message of /clock at ``stamp_ns``."""
    return Clock(clock=time_message(stamp_ns))


def step_messages(
    reading: SimulatedReading, config: SimulatorConfig, stamp_ns: int, sequence: int
) -> dict[str, Any]:
    """Return the messages of one step, by topic, all with the same stamp."""
    body = Header(stamp=time_message(stamp_ns), frame_id=config.body_frame)
    track = Header(stamp=time_message(stamp_ns), frame_id=config.odom_frame)
    return {
        "wheel_slip": _slip(reading, body, sequence),
        "wheel_sinkage": _sinkage(reading, body, sequence, config),
        "odom": _odometry(reading, track, config.body_frame),
        "joint_states": _joint_states(reading, body),
        "imu": _imu(reading, body),
    }


def truth_message(
    truth: GroundTruth, config: SimulatorConfig, stamp_ns: int, sequence: int
) -> TerrainTruth:
    """Return the true ground and the active effect; an effect of size 0 is not active."""
    cohesion, tan_phi = truth.strength
    effects = [describe(config.effect)] if config.effect and config.effect_size else []
    constants = {
        _TRUTH_FIELDS[name]: value for name, value in zip(CONSTANTS, truth.constants, strict=True)
    }
    return TerrainTruth(
        header=Header(stamp=time_message(stamp_ns), frame_id=config.odom_frame),
        sequence=sequence,
        soil=truth.soil,
        position=truth.position,
        cohesion=cohesion,
        tan_phi=tan_phi,
        friction_angle=math.atan(tan_phi),
        effect=[effect.name for effect in effects],
        effect_value=[config.effect_size for _ in effects],
        effect_unit=[effect.unit for effect in effects],
        **constants,
    )


def _slip(reading: SimulatedReading, header: Header, sequence: int) -> WheelSlip:
    measured = reading.measured
    names = list(reading.rover.wheel_names)
    return WheelSlip(
        header=header,
        sequence=sequence,
        wheel=names,
        slip=_doubles(measured.slip),
        slip_stddev=_doubles(measured.slip_sd),
        lateral_slip=_doubles(reading.across.lateral_slip),
        slip_angle=_doubles(reading.across.slip_angle),
    )


def _sinkage(
    reading: SimulatedReading, header: Header, sequence: int, config: SimulatorConfig
) -> WheelSinkage:
    measured, nothing = reading.measured, [math.nan] * len(reading.rover.wheel_names)
    depth, angle = config.sinkage_sensor, config.contact_angle_sensor
    return WheelSinkage(
        header=header,
        sequence=sequence,
        reference=config.sinkage_reference,
        wheel=list(reading.rover.wheel_names),
        sinkage=_doubles(measured.sinkage) if depth else nothing,
        sinkage_stddev=_doubles(measured.sinkage_sd) if depth else nothing,
        contact_angle=_doubles(measured.contact_angle) if angle else nothing,
        contact_angle_stddev=_doubles(measured.contact_angle_sd) if angle else nothing,
    )


def _odometry(reading: SimulatedReading, header: Header, body_frame: str) -> Odometry:
    message = Odometry(header=header, child_frame_id=body_frame)
    measured, moved = reading.measured, reading.sideways
    place, twist = message.pose.pose.position, message.twist.twist
    place.x, place.y, place.z = reading.odometry
    message.pose.pose.orientation = _orientation(reading)
    message.pose.covariance = _diagonal(
        *reading.odometry_variance,
        moved.roll_sd**2,
        float(measured.pitch_sd) ** 2,
        moved.yaw_sd**2,
    )
    twist.linear.x, twist.linear.y = float(measured.velocity), moved.lateral_velocity
    twist.angular.z = moved.yaw_rate
    # The rate of pitch is not measured.
    message.twist.covariance = _diagonal(
        float(measured.velocity_sd) ** 2,
        moved.lateral_velocity_sd**2,
        FIXED,
        FIXED,
        1.0,
        moved.yaw_rate_sd**2,
    )
    return message


def _joint_states(reading: SimulatedReading, header: Header) -> JointState:
    """Return every wheel, the suspension's joints, and the steering of wheels that have one."""
    measured, names = reading.measured, list(reading.rover.wheel_names)
    # left and right move alike, so the rocker does not turn against the body
    moved = {BOGIE: (reading.bogie_angle, reading.bogie_rate)}
    joints = [(name, *moved.get(name, (0.0, 0.0))) for name in suspension_joints(reading.rover)]
    if reading.steering is not None:
        angles = zip(names, reading.steering.tolist(), strict=True)
        joints += [(f"{name}{STEERING_SUFFIX}", angle, math.nan) for name, angle in angles]
    return JointState(
        header=header,
        name=[*names, *(name for name, _, _ in joints)],
        position=_doubles(reading.wheel_angle, *(angle for _, angle, _ in joints)),
        velocity=_doubles(measured.wheel_rate, *(rate for _, _, rate in joints)),
        effort=_doubles(measured.torque, *[math.nan] * len(joints)),
    )


def _imu(reading: SimulatedReading, header: Header) -> Imu:
    measured, moved = reading.measured, reading.sideways
    spread = float(measured.acceleration_sd)
    message = Imu(header=header, orientation=_orientation(reading))
    message.orientation_covariance = _diagonal(
        moved.roll_sd**2, float(measured.pitch_sd) ** 2, moved.yaw_sd**2
    )
    if moved is STRAIGHT:
        message.angular_velocity_covariance = _diagonal(-1.0, 0.0, 0.0)  # not measured
    else:
        message.angular_velocity.z = moved.yaw_rate
        rate = moved.yaw_rate_sd**2
        message.angular_velocity_covariance = _diagonal(rate, rate, rate)
    felt = message.linear_acceleration
    felt.x, (felt.y, felt.z) = float(measured.acceleration), reading.specific_force
    message.linear_acceleration_covariance = _diagonal(spread**2, spread**2, spread**2)
    return message


def _orientation(reading: SimulatedReading) -> Quaternion:
    """Return the attitude: nose-up is a negative rotation about y, which points left."""
    half = (
        0.5 * reading.sideways.roll,
        -0.5 * float(reading.measured.pitch),
        0.5 * reading.sideways.yaw,
    )
    (sr, sp, sy), (cr, cp, cy) = map(math.sin, half), map(math.cos, half)
    return Quaternion(
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


def _diagonal(*variances: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.diag(variances).reshape(-1)


def _doubles(values: Tensor, *more: float) -> "array.array[float]":
    return array.array("d", [*values.tolist(), *more])
