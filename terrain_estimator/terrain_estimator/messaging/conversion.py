# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Convert one set of messages into an observation.

Named wheels become axles, and REP-103 frames become the conventions of the estimator.

Messages are duck-typed: the classes of rclpy and of rosbags have the same attribute names, so
that the live node and replay run the same code. Sums are plain Python sums: their order, and so
every bit of the result, is fixed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion_rules import (
    ANY,
    NOT_MEASURED,
    Bounds,
    acceleration_of,
    deviation_of,
    finite_mean,
    mean,
    mean_deviation,
    optional_of,
    pitch_of,
    roll_of,
    usable,
)
from terrain_estimator.messaging.sizes import Oversized
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import (
    LATERAL_IN_TWIST,
    LOCAL,
    PITCH_IN_ORIENTATION,
    PITCH_IN_POSE,
    ROLL_IN_ORIENTATION,
    ROLL_IN_POSE,
    UNDISTURBED,
    YAW_IN_RATES,
    YAW_IN_TWIST,
    Message,
)
from terramechanics.description.layout import STEERING_SUFFIX
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import wheel_order

_Angle = tuple[float, float]  # [rad] and its standard deviation
Groups = tuple[tuple[int, ...], ...]  # per axle: positions of its wheels in the message


def stations_of(rover: Rover, *, by_wheel: bool) -> dict[str, int]:
    """Return the place of every wheel in an observation: that of its axle, or one of its own."""
    if by_wheel:
        return {rover.wheel_names[k]: place for place, k in enumerate(wheel_order(rover))}
    return dict(zip(rover.wheel_names, rover.wheel_axle, strict=True))


class Mark(IntEnum):
    """Place of a conversion in the search for the rate of the readings."""

    NONE = 0
    FIRST = 1  # the estimator may have to return to its state before this one
    WITHDRAWS = 2  # the estimator returns to its state before the first one


class Conversion(NamedTuple):
    """An observation, or the reason why there is none.

    ``notes`` name single wheels and sensors that were left out.
    """

    stamp_ns: int
    observation: Observation | None
    outcome: Outcome = Outcome.ACCEPTED
    detail: str = ""
    notes: tuple[str, ...] = ()
    mark: Mark = Mark.NONE


@dataclass(slots=True)
class _Notes:
    """Wheels and sensors left out while one set is converted."""

    texts: list[str] = field(default_factory=list)


class _Signal(NamedTuple):
    """One measured quantity of all wheels, as a message carries it."""

    topic: str
    names: list[str]
    values: Message
    deviations: Message
    bounds: Bounds


STRAIGHT = 0.02
"""[rad] Angle up to which a wheel that nothing steers is straight: a zero that is not exact."""


class WrongWheelsError(ValueError):
    """Wheel names or array lengths of a message do not match the rover."""


class Converter:
    """Convert sets of messages for one rover.

    A set is (wheel_slip, wheel_sinkage, odom, joint_states or None, imu or None).
    """

    def __init__(
        self,
        rover: Rover,
        config: ConversionConfig,
        core: CoreConfig,
        steered: tuple[bool, ...] = (),
    ) -> None:
        """Prepare for one rover; ``core`` selects the sensors and the range of slip.

        ``steered`` says of each wheel of a model by wheel whether a joint turns it: no wheels are
        then averaged. Empty: the model is by axle.
        """
        self.rover, self.config, self.core = rover, config, core
        self._stations = stations_of(rover, by_wheel=bool(steered))
        self.stations = max(self._stations.values()) + 1
        # of each wheel, in the order of the stations; empty: nothing steers it
        self.steering_joints = [
            f"{name}{STEERING_SUFFIX}" if turns else ""
            for name, turns in zip(self._stations, steered, strict=False)
        ]
        self.unsteered_joints = frozenset(
            f"{name}{STEERING_SUFFIX}"
            for name, turns in zip(self._stations, steered, strict=False)
            if not turns
        )
        absolute = 0.01 * 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)
        self.torque_absolute_sd = config.torque_absolute_sd or absolute
        self.slip_bounds = Bounds(core.slip_minimum, core.slip_maximum)
        self._radius = rover.wheel_radius
        # without a joint, all axles are where the rover file has them
        self.known_angle = math.nan if rover.suspension else 0.0
        self.bogie_joints = {name.strip() for name in config.bogie_joint.split(",")}
        own = (*self._stations, *filter(None, self.steering_joints))
        self._joints_read = self.bogie_joints.union(own)
        # by topic: the last names and their groups
        self._groups: dict[str, tuple[list[str], Groups]] = {}

    def concerns(self, topic: str, message: Message) -> bool:
        """Return whether a message concerns this rover's wheels or bogie.

        The joints of a mast or an arm may arrive on joint_states, too.
        """
        return topic != "joint_states" or not self._joints_read.isdisjoint(message.name)

    def convert(self, stamp_ns: int, messages: tuple[Message, ...]) -> Conversion:
        """Convert one set to one observation.

        Refusals are WRONG_FRAME and WRONG_WHEELS, with the names in ``detail``.
        """
        slip, sinkage, odom, joints, imu = (*messages, None)[
            :5
        ]  # the set has no imu where it is not used
        if not self.core.use_imu:
            imu = None
        for large in (slip, sinkage, odom):
            if isinstance(large, Oversized):
                return Conversion(stamp_ns, None, Outcome.WRONG_WHEELS, large.detail)
        notes = _Notes()
        joints, imu = (_unless_oversized(each, notes) for each in (joints, imu))
        wrong = self.wrong_frame(slip, sinkage, odom, imu) or wrong_reference(sinkage)
        if wrong:
            return Conversion(stamp_ns, None, Outcome.WRONG_FRAME, wrong)
        try:
            observation = self._observe(stamp_ns, (slip, sinkage, odom, joints), imu, notes)
        except WrongWheelsError as error:
            return Conversion(stamp_ns, None, Outcome.WRONG_WHEELS, str(error))
        return Conversion(stamp_ns, observation, notes=tuple(notes.texts))

    def sinkage_bounds(self, *, local: bool) -> Bounds:
        """Return the range of a sinkage [m]; a wheel may ride above the bottom of a track."""
        return Bounds(-self._radius if local else 0.0, self._radius)

    def wrong_frame(self, slip: Message, sinkage: Message, odom: Message, imu: Message) -> str:
        """Name the first message whose frame is not the body's; empty where all are right."""
        expected = self.config.body_frame
        if not expected:
            return ""
        frames = [("odom (child_frame_id)", odom.child_frame_id)]
        frames += [
            (name, message.header.frame_id)
            for name, message in (("wheel_slip", slip), ("wheel_sinkage", sinkage), ("imu", imu))
            if message
        ]
        for name, frame in frames:
            if frame != expected:
                return f"{name} is in frame {frame!r}, expected {expected!r}"
        return ""

    def _observe(
        self, stamp_ns: int, messages: tuple[Message, ...], imu: Message, notes: _Notes
    ) -> Observation:
        slip, sinkage, odom, joints = messages
        slips, slip_sds = self._axle_means(
            _Signal("wheel_slip", slip.wheel, slip.slip, slip.slip_stddev, self.slip_bounds), notes
        )
        depth = _Signal(
            "wheel_sinkage",
            sinkage.wheel,
            sinkage.sinkage,
            sinkage.sinkage_stddev,
            self.sinkage_bounds(local=is_local(sinkage)),
        )
        angle = _Signal(
            "wheel_sinkage",
            sinkage.wheel,
            sinkage.contact_angle,
            sinkage.contact_angle_stddev,
            ANY,
        )
        sinkages, sinkage_sds = self._axle_means(depth, notes)
        angles, angle_sds = self._axle_means(angle, notes)
        rates, torques, torque_sds = self._joints(joints, notes)
        (pitch, pitch_sd), (roll, roll_sd) = self._attitude(odom, imu)
        acceleration, acceleration_sd = self._acceleration(imu)
        lateral_velocity, lateral_velocity_sd = optional_of(
            odom.twist.twist.linear.y,
            odom.twist.covariance[LATERAL_IN_TWIST],
            self.config.default_lateral_velocity_sd,
        )
        yaw_rate, yaw_rate_sd = self._yaw_rate(odom, imu)
        return Observation(
            stamp_ns=stamp_ns,
            slip=np.array(slips),
            slip_sd=np.array(slip_sds),
            sinkage=np.array(sinkages),
            sinkage_sd=np.array(sinkage_sds),
            contact_angle=np.array(angles),
            contact_angle_sd=np.array(angle_sds),
            wheel_rate=np.array(rates),
            torque=np.array(torques),
            torque_sd=np.array(torque_sds),
            velocity=float(odom.twist.twist.linear.x),
            velocity_sd=deviation_of(odom.twist.covariance[0], self.config.default_velocity_sd),
            pitch=pitch,
            pitch_sd=pitch_sd,
            acceleration=acceleration,
            acceleration_sd=acceleration_sd,
            bogie_angle=self._bogie_angle(joints),
            roll=roll,
            roll_sd=roll_sd,
            lateral_velocity=lateral_velocity,
            lateral_velocity_sd=lateral_velocity_sd,
            yaw_rate=yaw_rate,
            yaw_rate_sd=yaw_rate_sd,
            steering=self._steering(joints),
            local=is_local(sinkage),
        )

    def _steering(self, joints: Message) -> Floats | None:
        """Return the angles [rad] of single wheels; NaN where a joint that steers is missing.

        Raises WrongWheelsError where a wheel is steered that the model takes as straight.
        """
        if joints is not None and not self.unsteered_joints.isdisjoint(joints.name):
            self._refuse_steering(joints)
        if not any(self.steering_joints):
            return None
        known: dict[str, float] = {}
        if joints is not None:
            known = dict(zip(joints.name, joints.position.tolist(), strict=False))
        return np.array(
            [known.get(joint, math.nan) if joint else 0.0 for joint in self.steering_joints]
        )

    def _refuse_steering(self, joints: Message) -> None:
        for name, angle in zip(joints.name, joints.position.tolist(), strict=False):
            if name in self.unsteered_joints and abs(angle) > STRAIGHT:
                raise WrongWheelsError(
                    f"joint_states: {name} is {angle:.3g} rad, but the model takes that wheel as"
                    " straight: write it anew with model_by_wheel --steered"
                )

    def _axle_means(self, signal: _Signal, notes: _Notes) -> tuple[list[float], list[float]]:
        """Return the mean over the wheels of each axle, and the standard deviation of that mean."""
        topic, names = signal.topic, signal.names
        groups = self.match(topic, names)
        values, deviations = signal.values.tolist(), signal.deviations.tolist()
        if not len(values) == len(deviations) == len(names):
            raise WrongWheelsError(
                f"{topic}: {len(names)} wheels, but {len(values)} values and {len(deviations)}"
                " standard deviations"
            )
        means, sds = [], []
        for group in groups:
            picked = usable(group, values, deviations, signal.bounds)
            if len(picked) < len(group):
                left_out = [at for at in group if at not in picked and not math.isnan(values[at])]
                notes.texts += [
                    f"{topic}: wheel {names[at]} with {values[at]:.3g} left out" for at in left_out
                ]
            means.append(mean([values[at] for at in picked]))
            sds.append(mean_deviation([deviations[at] for at in picked]))
        return means, sds

    def match(self, topic: str, names: list[str]) -> Groups:
        """Return the positions of each axle's wheels in a message.

        The message must have the rover's wheels, each once, and no others.
        """
        cached = self._groups.get(topic)
        if cached is not None and cached[0] == names:
            return cached[1]
        missing, foreign = self._stations.keys() - set(names), set(names) - self._stations.keys()
        if missing or foreign or len(names) != len(self._stations):
            raise WrongWheelsError(
                f"{topic}: got wheels {list(names)}, the model's rover {self.rover.name} has"
                f" {list(self._stations)}; another rover needs a model of its own"
            )
        return self._remember(topic, names)

    def _remember(self, topic: str, names: list[str]) -> Groups:
        """Find each axle's wheels among ``names``; keep the positions for the next message."""
        station_of = [self._stations.get(name) for name in names]
        groups = tuple(
            tuple(at for at, station in enumerate(station_of) if station == wanted)
            for wanted in range(self.stations)
        )
        self._groups[topic] = (list(names), groups)
        return groups

    def _joints(
        self, joints: Message, notes: _Notes
    ) -> tuple[list[float], list[float], list[float]]:
        """Return wheel rate [rad/s], torque of one wheel [N m] and its deviation, per axle.

        NaN where a value is not measured.
        """
        unknown = [math.nan] * self.stations
        if joints is None:
            return unknown, unknown, unknown
        names = joints.name
        groups = self.joint_groups(names)
        rates = self._joint_means(groups, "velocity", (names, joints.velocity.tolist()), notes)
        if not self.core.use_torque:
            return rates, unknown, unknown
        efforts = joints.effort.tolist()
        torques = self._joint_means(groups, "effort", (names, efforts), notes)
        measured = zip(groups, torques, strict=True)
        return (
            rates,
            torques,
            [
                math.nan if math.isnan(torque) else self._torque_deviation(group, efforts)
                for group, torque in measured
            ],
        )

    def joint_groups(self, names: list[str]) -> Groups:
        """Return the positions of each axle's wheels among the joints; there may be others."""
        cached = self._groups.get("joint_states")
        if cached is not None and cached[0] == names:
            return cached[1]
        return self._remember("joint_states", names)

    def _joint_means(
        self, groups: Groups, what: str, named: tuple[Sequence[str], list[float]], notes: _Notes
    ) -> list[float]:
        """Return the mean over the wheels of each axle.

        An empty array means "not measured", as in sensor_msgs.
        """
        names, values = named
        if len(values) != len(names):
            if values:
                notes.texts.append(
                    f"joint_states: {what} has {len(values)} values for {len(names)} names,"
                    " left out"
                )
            return [math.nan] * len(groups)
        if math.inf in values or -math.inf in values:
            notes.texts.append(f"joint_states: infinite {what} left out")
        return [finite_mean([values[at] for at in group]) for group in groups]

    def _bogie_angle(self, joints: Message) -> float:
        """Return the bogies' mean joint angle [rad], nose up; NaN where it is not measured.

        It is 0 of a rover without a joint, whatever the message has.
        """
        if joints is None or not self.rover.suspension:
            return self.known_angle
        angles = [
            angle
            for name, angle in zip(joints.name, joints.position.tolist(), strict=False)
            if name in self.bogie_joints
        ]
        angle = mean(angles) if angles else math.nan
        return -angle if self.config.bogie_nose_down else angle

    def _torque_deviation(self, group: tuple[int, ...], efforts: list[float]) -> float:
        return mean_deviation(
            [self.torque_deviation(efforts[at]) for at in group if math.isfinite(efforts[at])]
        )

    def torque_deviation(self, torque: float) -> float:
        """Return the standard deviation [N m] of the torque of one wheel."""
        return math.hypot(self.config.torque_relative_sd * torque, self.torque_absolute_sd)

    def _attitude(self, odom: Message, imu: Message) -> tuple[_Angle, _Angle]:
        """Return the nose-up pitch and the roll.

        The imu gives them where it has an orientation, else odom. A roll without a variance is
        known as well as the pitch.
        """
        if imu is not None and imu.orientation_covariance[0] != NOT_MEASURED:
            orientation, covariance = imu.orientation, imu.orientation_covariance
            places = PITCH_IN_ORIENTATION, ROLL_IN_ORIENTATION
        else:
            orientation, covariance = odom.pose.pose.orientation, odom.pose.covariance
            places = PITCH_IN_POSE, ROLL_IN_POSE
        pitch_sd = deviation_of(covariance[places[0]], self.config.default_pitch_sd)
        roll_sd = deviation_of(covariance[places[1]], pitch_sd)
        return (nose_up_pitch(orientation), pitch_sd), (roll_left_up(orientation), roll_sd)

    def _yaw_rate(self, odom: Message, imu: Message) -> tuple[float, float]:
        """Return the yaw rate [rad/s] and its deviation: the imu's where it is usable."""
        default, given = self.config.default_yaw_rate_sd, (math.nan, math.nan)
        if imu is not None and imu.angular_velocity_covariance[0] != NOT_MEASURED:
            variance = imu.angular_velocity_covariance[YAW_IN_RATES]
            given = optional_of(imu.angular_velocity.z, variance, default)
        if math.isfinite(given[0]):
            return given
        twist = odom.twist
        return optional_of(twist.twist.angular.z, twist.covariance[YAW_IN_TWIST], default)

    def _acceleration(self, imu: Message) -> tuple[float, float]:
        """Return specific force along body x [m/s^2] and its deviation; NaN where not measured."""
        if imu is None:
            return math.nan, math.nan
        return acceleration_of(
            imu.linear_acceleration.x,
            imu.linear_acceleration_covariance[0],
            self.config.default_acceleration_sd,
        )


def wrong_reference(sinkage: Message) -> str:
    """Say why sinkages from this reference cannot be used; empty where they can."""
    reference = _reference(sinkage)
    if reference in {"", UNDISTURBED, LOCAL}:
        return ""
    return (
        f"wheel_sinkage: reference is {reference!r}, expected {UNDISTURBED!r}, for ground where no"
        f" wheel has been, or {LOCAL!r}, for the ground right before the wheel"
    )


def is_local(sinkage: Message) -> bool:
    """Return whether sinkages are from the ground right before each wheel."""
    return _reference(sinkage) == LOCAL


def _reference(sinkage: Message) -> str:
    return str(getattr(sinkage, "reference", ""))  # bags of before have none


def _unless_oversized(message: Message, notes: _Notes) -> Message:
    if isinstance(message, Oversized):
        notes.texts.append(message.detail)
        return None
    return message


def roll_left_up(orientation: Message) -> float:
    """Return the roll [rad], positive left side up, of a quaternion message; NaN where none."""
    return roll_of(orientation.x, orientation.y, orientation.z, orientation.w)


def nose_up_pitch(orientation: Message) -> float:
    """Return the pitch [rad], positive nose up, of a quaternion message; NaN where it is none."""
    return pitch_of(orientation.x, orientation.y, orientation.z, orientation.w)
