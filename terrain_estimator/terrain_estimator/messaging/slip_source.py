# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Slip of every wheel from its rate and the rover's velocity, with its standard deviation.

i = 1 - v / (r w) (:func:`terramechanics.vehicle.rover.Rover.slip`), so to first order sd(i)^2 =
n (sd(v) / (r w))^2 + (1 - i)^2 (n (sd(r) / r)^2 + (sd(w) / w)^2), where n is the number of turning
wheels of the same axle.

With a track width v is that of each wheel's centre, v_x -+ yaw rate times half the width. Its
motion across the wheel's heading, which ``NAME_steering`` in joint_states turns, goes into
lateral_slip and slip_angle where lateral velocity and yaw rate are measured.

All wheels share the errors of v and of the rover file's r. The estimator treats wheels as
independent and so divides these errors by sqrt(n) in the mean of an axle; the factor n cancels
that: exactly for equal rates, and never too small (the root mean square of 1 / (r w) is no smaller
than its mean).
"""

import math
from dataclasses import dataclass

import numpy as np

from rover_parameters.records import ConfigError
from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.messaging.pairing import InputTopic, MessageSet, Synchronizer
from terrain_estimator.observation import Floats
from terrain_estimator.topics import (
    BODY_FRAME,
    INPUT_TYPES,
    LATERAL_IN_TWIST,
    UNDISTURBED,
    YAW_IN_TWIST,
    Make,
    Message,
    stamp_ns,
)
from terramechanics.description.layout import STEERING_SUFFIX
from terramechanics.vehicle.rover import Rover

ODOMETRY = "odometry"
VELOCITY_TYPES = {
    ODOMETRY: "nav_msgs/msg/Odometry",
    "twist": "geometry_msgs/msg/TwistWithCovarianceStamped",
}
"""Message types of a velocity; both hold it in twist.twist.linear.x."""
JOINTS, VELOCITY = "joint_states", "velocity"
TWICE = (
    "velocity comes from the estimator's own input odom: its noise would enter slip and velocity"
    " alike, which the estimator treats as independent. Give velocity another source"
    " (docs/bring_your_own_rover.md)"
)


class SlipSourceError(ValueError):
    """A message cannot be used; the text names the field and the value."""


@dataclass(frozen=True, slots=True)
class Slips:
    """Slip [wheels] in the order of the rover file, and its deviation.

    NaN for a wheel that stands, and where the slip overflows. The deviations give the right one for
    the mean over an axle whose wheels are treated as independent.
    """

    slip: Floats
    sd: Floats


class SlipSource:
    """Pair wheel rates with velocities; a slip has the stamp of its wheel rates."""

    def __init__(self, rover: Rover, config: SlipSourceConfig) -> None:
        """Start without messages; ConfigError where the kind of velocity is unknown."""
        if config.velocity_type not in VELOCITY_TYPES:
            raise ConfigError(
                f"parameter velocity_type: {config.velocity_type!r} is unknown, give one of"
                f" {', '.join(VELOCITY_TYPES)}"
            )
        self._rover, self._config = rover, config
        self._axle_x = np.array([rover.axle_x[axle] for axle in rover.wheel_axle])
        self._sides = np.array([1.0 if wheel.side == "left" else -1.0 for wheel in rover.wheels])
        topics = (InputTopic(JOINTS, required=True), InputTopic(VELOCITY, required=True))
        self._synchronizer = Synchronizer(topics, round(config.tolerance_s * 1e9))
        self._sequence = 0
        self._turned = False  # whether rates of the rover's wheels have arrived

    def pair(self, topic: str, message: Message) -> list[MessageSet]:
        """Add a message of JOINTS or VELOCITY; return the pairs that it completes.

        Other joints, such as a mast's or an arm's, are skipped. Until the wheels' rates arrive they
        are accepted, so that the refusal of the pair names the missing wheels.
        """
        if topic == JOINTS:
            ours = not set(self._rover.wheel_names).isdisjoint(message.name)
            self._turned = self._turned or ours
            if self._turned and not ours:
                return []
        return self._synchronizer.add((JOINTS, VELOCITY).index(topic), stamp_ns(message), message)

    def slip_message(self, pair: MessageSet, make: Make) -> Message:
        """Return the wheel_slip message of a pair; SlipSourceError where it cannot be used."""
        joints, velocity = pair.messages
        self._check_frame(velocity)
        slips = self._slips(joints, velocity)
        lateral_slip, slip_angle = self._across(joints, velocity, slips)
        self._sequence += 1
        return make(
            INPUT_TYPES["wheel_slip"],
            header=make(
                "std_msgs/msg/Header",
                stamp=joints.header.stamp,
                frame_id=self._config.body_frame or BODY_FRAME,
            ),
            sequence=self._sequence - 1,
            wheel=list(self._rover.wheel_names),
            slip=slips.slip,
            slip_stddev=slips.sd,
            lateral_slip=lateral_slip,
            slip_angle=slip_angle,
        )

    def sinkage_message(self, slip: Message, make: Make) -> Message:
        """Return the wheel_sinkage message beside ``slip``, in which nothing is measured."""
        nothing = np.full(len(slip.wheel), math.nan)
        return make(
            INPUT_TYPES["wheel_sinkage"],
            header=slip.header,
            sequence=slip.sequence,
            reference=UNDISTURBED,
            wheel=slip.wheel,
            sinkage=nothing,
            sinkage_stddev=nothing,
            contact_angle=nothing,
            contact_angle_stddev=nothing,
        )

    def _check_frame(self, velocity: Message) -> None:
        """Refuse a velocity in another frame; a camera's linear.x is not along body x."""
        odometry = self._config.velocity_type == ODOMETRY
        field, frame = (
            ("child_frame_id", velocity.child_frame_id)
            if odometry
            else ("header.frame_id", velocity.header.frame_id)
        )
        if self._config.body_frame and frame != self._config.body_frame:
            raise SlipSourceError(
                f"velocity ({field}) is in frame {frame!r}, expected {self._config.body_frame!r}: "
                "transform it, so that linear.x is along body x, or correct its frame or body_frame"
            )

    def _slips(self, joints: Message, velocity: Message) -> Slips:
        speed, variance = float(velocity.twist.twist.linear.x), float(velocity.twist.covariance[0])
        deviation = math.sqrt(variance) if variance > 0.0 else self._config.default_velocity_sd
        if not math.isfinite(speed) or not 0.0 < deviation < math.inf:
            raise SlipSourceError(
                f"velocity {speed:g} m/s with variance {variance:g} (twist.covariance[0]) cannot be"
                " used: publish a variance above zero, or set default_sd.velocity"
            )
        rates = self._rates(joints)
        if not self._config.track_width:
            return slips_of(self._rover, rates, speed, deviation, self._config)
        yaw_rate = float(velocity.twist.twist.angular.z)
        yaw_variance = float(velocity.twist.covariance[YAW_IN_TWIST])
        if not (math.isfinite(yaw_rate) and math.isfinite(yaw_variance)):
            raise SlipSourceError(
                f"yaw rate {yaw_rate:g} rad/s with variance {yaw_variance:g} cannot be used:"
                " correct twist.twist.angular.z and twist.covariance[35], or set track_width to 0"
            )
        left = 0.5 * self._config.track_width * self._sides
        spread = np.abs(left) * math.sqrt(max(yaw_variance, 0.0))
        speeds, deviations = speed - yaw_rate * left, np.hypot(deviation, spread)
        return slips_of(self._rover, rates, speeds, deviations, self._config)

    def _across(self, joints: Message, velocity: Message, slips: Slips) -> tuple[Floats, Floats]:
        """Return lateral slip [1] and slip angle [rad] of each wheel.

        NaN where slip or steering angle is; empty where the motion of the wheels is not known.
        """
        twist, variances = velocity.twist.twist, velocity.twist.covariance
        left, turn = float(twist.linear.y), float(twist.angular.z)
        # a variance of zero is one that nobody has set
        known = variances[LATERAL_IN_TWIST] > 0.0 and variances[YAW_IN_TWIST] > 0.0
        if not (self._config.track_width and known and math.isfinite(left)):
            return np.empty(0), np.empty(0)
        steered = self._steering(joints)
        with np.errstate(all="ignore"):
            ahead = twist.linear.x - turn * 0.5 * self._config.track_width * self._sides
            aside = left + turn * self._axle_x
            along = np.cos(steered) * ahead + np.sin(steered) * aside
            across = np.cos(steered) * aside - np.sin(steered) * ahead
            lateral = across / (self._rover.wheel_radius * np.abs(self._rates(joints)))
        told = np.isfinite(slips.slip) & np.isfinite(lateral)
        angle = np.arctan2(across, along)
        return np.where(told, lateral, np.nan), np.where(told, angle, np.nan)

    def _steering(self, joints: Message) -> Floats:
        """Return the steering angle of each wheel [rad]: 0 without a joint, NaN without a value."""
        angles = dict.fromkeys(joints.name, math.nan)
        angles |= zip(joints.name, joints.position, strict=False)
        names = self._rover.wheel_names
        return np.array([angles.get(f"{name}{STEERING_SUFFIX}", 0.0) for name in names])

    def _rates(self, joints: Message) -> Floats:
        rates = dict(zip(joints.name, joints.velocity, strict=False))
        missing = [name for name in self._rover.wheel_names if name not in rates]
        if missing:
            raise SlipSourceError(
                f"joint_states: no velocity of {', '.join(missing)}; it has those of"
                f" {', '.join(rates) or 'no joint'}"
            )
        return np.array([rates[name] for name in self._rover.wheel_names])


def slips_of(
    rover: Rover,
    rates: Floats,
    speed: float | Floats,
    speed_sd: float | Floats,
    config: SlipSourceConfig,
) -> Slips:
    """Return the slips at wheel rates ``rates`` [wheels] [rad/s].

    ``speed`` [m/s] is that along body x, of the rover or of each wheel's centre [wheels].
    """
    turns = (
        np.isfinite(rates)
        & (rates != 0.0)
        & (np.abs(rates) * rover.wheel_radius >= config.standstill_speed)
    )
    rate = np.where(turns, rates, 1.0)
    by_rate = config.rate_sd / np.abs(rate)
    axle = np.array(rover.wheel_axle)
    shared = np.sqrt([np.count_nonzero(turns & (axle == each)) for each in axle])
    with np.errstate(over="ignore", invalid="ignore"):
        slip, at_rest, at_unit = (
            rover.slip(np.full_like(rate, velocity), rate) for velocity in (speed, 0.0, 1.0)
        )
        # hypot: the square of a deviation overflows long before the deviation does
        deviation = np.hypot(
            shared * speed_sd * (at_rest - at_unit),
            (1.0 - slip) * np.hypot(shared * config.radius_sd, by_rate),
        )
    known = turns & np.isfinite(slip) & np.isfinite(deviation)
    return Slips(np.where(known, slip, np.nan), np.where(known, deviation, np.nan))
