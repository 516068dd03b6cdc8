# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write samples as the estimator's input messages to a bag."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from terrain_estimator.bags import BagTopic, BagWriter, Message
from terrain_estimator.importing.mapping import Mapping
from terrain_estimator.importing.samples import MeasuredValue, TableSample
from terrain_estimator.topics import (
    INPUT_TYPES,
    LATERAL_IN_TWIST,
    PITCH_IN_ORIENTATION,
    PITCH_IN_POSE,
    YAW_IN_TWIST,
)
from terramechanics.description.layout import STEERING_SUFFIX

UNKNOWN = -1.0  # variance of what was not measured; in sensor_msgs/Imu the first element

_OF_JOINTS = ("wheel_rate", "torque", "bogie_angle", "steering")

BOGIE = "bogie"
"""Name of the bogie's joint, the default of the estimator's parameter bogie_joint."""


@dataclass(slots=True)
class SampleWriter:
    """Write each sample as the messages of one instant.

    wheel_slip, wheel_sinkage and odom are always written, with NaN for what was not measured;
    joint_states and imu only where one of their signals is mapped.
    """

    writer: BagWriter
    mapping: Mapping
    _topics: dict[str, BagTopic] = field(default_factory=dict)
    _sequence: int = 0

    def write_all(self, samples: Iterable[TableSample]) -> int:
        """Write all samples; return their number."""
        builders: dict[str, Callable[[TableSample], Message]] = {
            "wheel_slip": self._slip,
            "wheel_sinkage": self._sinkage,
            "odom": self._odom,
        }
        if any(self.mapping.measures(signal) for signal in _OF_JOINTS):
            builders["joint_states"] = self._joints
        if any(self.mapping.measures(signal) for signal in ("pitch", "acceleration")):
            builders["imu"] = self._imu
        self._topics = {
            name: self.writer.add_topic(f"/{name}", INPUT_TYPES[name]) for name in builders
        }
        for sample in samples:
            for name, build in builders.items():
                self.writer.write_message(self._topics[name], build(sample), sample.stamp_ns)
            self._sequence += 1
        return self._sequence

    def _header(self, sample: TableSample, frame: str) -> Message:
        sec, nanosec = divmod(sample.stamp_ns, 1_000_000_000)
        stamp = self.writer.types.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.writer.types.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def _slip(self, sample: TableSample) -> Message:
        return self.writer.types.make(
            INPUT_TYPES["wheel_slip"],
            header=self._header(sample, self.mapping.frame),
            sequence=self._sequence,
            wheel=[wheel.name for wheel in self.mapping.wheels],
            slip=_values(sample.slip),
            slip_stddev=_deviations(sample.slip),
        )

    def _sinkage(self, sample: TableSample) -> Message:
        return self.writer.types.make(
            INPUT_TYPES["wheel_sinkage"],
            header=self._header(sample, self.mapping.frame),
            sequence=self._sequence,
            reference=self.mapping.sinkage_reference,
            wheel=[wheel.name for wheel in self.mapping.wheels],
            sinkage=_values(sample.sinkage),
            sinkage_stddev=_deviations(sample.sinkage),
            contact_angle=_values(sample.contact_angle),
            contact_angle_stddev=_deviations(sample.contact_angle),
        )

    def _odom(self, sample: TableSample) -> Message:
        odom = self.writer.types.make(
            INPUT_TYPES["odom"],
            header=self._header(sample, "odom"),
            child_frame_id=self.mapping.frame,
        )
        odom.twist.twist.linear.x = sample.velocity.value
        odom.twist.covariance[0] = _variance(sample.velocity)
        odom.twist.twist.linear.y, odom.twist.covariance[LATERAL_IN_TWIST] = _optional(
            sample.lateral_velocity
        )
        odom.twist.twist.angular.z, odom.twist.covariance[YAW_IN_TWIST] = _optional(sample.yaw_rate)
        odom.pose.covariance[PITCH_IN_POSE] = self._orient(odom.pose.pose.orientation, sample)
        return odom

    def _joints(self, sample: TableSample) -> Message:
        angles = {BOGIE: sample.bogie_angle} if self.mapping.measures("bogie_angle") else {}
        for wheel, angle in zip(self.mapping.wheels, sample.steering, strict=False):
            if wheel.steering:
                angles[f"{wheel.name}{STEERING_SUFFIX}"] = angle
        unknown = [math.nan] * len(angles)
        return self.writer.types.make(
            INPUT_TYPES["joint_states"],
            header=self._header(sample, ""),
            name=[*(wheel.name for wheel in self.mapping.wheels), *angles],
            position=[*[math.nan] * len(self.mapping.wheels), *angles.values()] if angles else [],
            velocity=[*sample.wheel_rate, *unknown] if self.mapping.measures("wheel_rate") else [],
            effort=[*sample.torque, *unknown] if self.mapping.measures("torque") else [],
        )

    def _imu(self, sample: TableSample) -> Message:
        imu = self.writer.types.make(
            INPUT_TYPES["imu"], header=self._header(sample, self.mapping.frame)
        )
        imu.orientation_covariance[PITCH_IN_ORIENTATION] = self._orient(imu.orientation, sample)
        if math.isnan(sample.pitch.value):
            imu.orientation_covariance[0] = UNKNOWN
        imu.angular_velocity_covariance[0] = UNKNOWN
        imu.linear_acceleration.x = (
            0.0 if math.isnan(sample.acceleration.value) else sample.acceleration.value
        )
        imu.linear_acceleration_covariance[0] = (
            UNKNOWN if math.isnan(sample.acceleration.value) else _variance(sample.acceleration)
        )
        return imu

    @staticmethod
    def _orient(orientation: Message, sample: TableSample) -> float:
        """Set a quaternion and return the pitch's variance; all zeros where there is no pitch.

        First the pitch, about y; REP-103's rotation is positive nose down. Then the turn about x
        that lifts y to the roll, which is 0 where it was not measured.
        """
        pitch, roll = sample.pitch.value, sample.roll
        if math.isnan(pitch):
            orientation.w = 0.0
            return 0.0
        about_y, about_x = -0.5 * pitch, 0.0
        if not math.isnan(roll):
            about_x = 0.5 * math.asin(max(-1.0, min(1.0, math.sin(roll) / math.cos(pitch))))
        orientation.w = math.cos(about_y) * math.cos(about_x)
        orientation.x = math.cos(about_y) * math.sin(about_x)
        orientation.y = math.sin(about_y) * math.cos(about_x)
        orientation.z = -math.sin(about_y) * math.sin(about_x)
        return _variance(sample.pitch)


def _values(entries: list[MeasuredValue]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([entry.value for entry in entries])


def _deviations(entries: list[MeasuredValue]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([entry.deviation for entry in entries])


def _optional(entry: MeasuredValue) -> tuple[float, float]:
    """Return value and variance, 0 and UNKNOWN where it was not measured."""
    return (0.0, UNKNOWN) if math.isnan(entry.value) else (entry.value, _variance(entry))


def _variance(entry: MeasuredValue) -> float:
    """Return the variance; 0, which means unknown in ROS, where there is no measurement."""
    return 0.0 if math.isnan(entry.deviation) else entry.deviation**2
