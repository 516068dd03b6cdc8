# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the dataset's names mean, and what a user states beside them.

Names and units are those that its authors publish. What they leave open is an option: the axes of
the pose, the signs of the wheels, the fields of the encoders' message.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from rover_parameters.records import ConfigError
from terrain_estimator.importing.units import factor
from terrain_estimator.observation import Floats
from terramechanics.vehicle.rover import Rover

SOURCE = 'RoSE Lab, "Rover Mobility in a Lunar Analogue Dataset", CC BY 4.0'
WHEELS = 4
"""1 is front left, 2 front right, 3 back left, 4 back right."""
TIME = "time_s"
POSITION = ("pos_x", "pos_y", "pos_z")
ORIENTATION = ("quat_x", "quat_y", "quat_z", "quat_w")
RATES = ("vel1_rad_s", "vel2_rad_s", "vel3_rad_s", "vel4_rad_s")
CURRENTS = ("current1", "current2", "current3", "current4")
ACCELERATION = ("lin_acc_x", "lin_acc_y", "lin_acc_z")
POSE_TOPIC, ENCODER_TOPIC, IMU_TOPIC = "/optitrack/pose", "/motor/encoder", "/imu/data"
POSE_TYPE, IMU_TYPE = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/Imu"
AXES = ("x", "-x", "y", "-y", "z", "-z")
STAMPS = ("header", "log")


@dataclass(frozen=True, slots=True)
class RoseOptions:
    """What the user states about a trial. Raises ConfigError where it does not fit together."""

    columns: dict[str, str] = field(default_factory=dict)  # name of the schema: that in the file
    position_unit: str = "m"
    rate_unit: str = "rad/s"
    body_axes: tuple[str, str] = ("x", "z")  # forward and up in the frame of the pose
    world_up: str = "z"  # in the frame that the pose is given in
    wheel_signs: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)  # of wheels 1 to 4
    pose_left: float = 0.0  # [m] place of the pose's origin, left of the body's middle
    pose_ahead: float = 0.0  # [m] the same, ahead of the body's origin
    track_width: float | None = None  # [m] between left and right wheels' centres
    window: float | None = None  # [s] over which a line is put through poses
    position_sd: float | None = None  # [m] of one pose; None: by what the lines miss
    pitch_sd: float = np.radians(0.5)  # [rad] of the pose's alignment to the body
    contact_angle_sd: float = 0.0  # [rad] of the ground below a wheel; 0: it is not known
    rate_sd: float = 0.0  # [rad/s] of one reading
    radius_sd: float = 0.01  # [1] relative, of the rolling radius
    standstill: float = 0.01  # [m/s] of a rim
    turn_rate: float = 0.05  # [rad/s]
    straight_only: bool = False
    torque_gain: float | None = None  # [N m] for each unit of the raw current
    torque_sd: float = 0.0  # [1] relative
    acceleration_axis: str = ""  # of the imu that points forward
    acceleration_sd: float = 0.0  # [m/s^2] of one reading
    rate_fields: tuple[str, ...] = ()  # of the encoders' message
    current_fields: tuple[str, ...] = ()
    stamps: str = "header"  # or log

    def __post_init__(self) -> None:
        """Check what is independent of the file."""
        factor("length", self.position_unit)
        factor("wheel rate", self.rate_unit)
        for name in self.columns:
            if name not in (TIME, *POSITION, *ORIENTATION, *RATES, *CURRENTS, *ACCELERATION):
                raise ConfigError(f"--column {name}=...: the schema has no column {name}")
        forward, up = self.body_axes
        if forward[-1] == up[-1]:
            raise ConfigError(f"--body-axes {forward},{up}: give two different axes")
        if self.track_width is None and not self.straight_only:
            raise ConfigError(
                "where the rover turns, slip differs from wheel to wheel: give --track-width"
                " (metres between the left and the right wheels' centres), or --straight-only"
            )
        if (self.torque_gain is None) != (self.torque_sd == 0.0):
            raise ConfigError("--torque-gain and --torque-sd: give both, or neither")
        if bool(self.acceleration_axis) != (self.acceleration_sd > 0.0):
            raise ConfigError("--acceleration-axis and --acceleration-sd: give both, or neither")

    def column(self, name: str) -> str:
        """Return the file's name of a column."""
        return self.columns.get(name, name)


def axis(name: str) -> Floats:
    """Return the unit vector [3] of an axis such as -y."""
    found = np.zeros(3)
    found["xyz".index(name[-1])] = -1.0 if name.startswith("-") else 1.0
    return found


def axis_near(vector: Floats) -> str:
    """Return the axis that is nearest to a vector [3]."""
    at = int(np.abs(vector).argmax())
    return f"{'-' if vector[at] < 0.0 else ''}{'xyz'[at]}"


def wheel_order(rover: Rover) -> list[int]:
    """Return for each wheel of a rover its index among the dataset's. Raises ConfigError."""
    places = [(wheel.axle, wheel.side) for wheel in rover.wheels]
    wanted = [(axle, side) for axle in (0, 1) for side in ("left", "right")]
    if sorted(places) != sorted(wanted):
        raise ConfigError(
            f"rover {rover.name}: the dataset's rover has two axles with a wheel left and right:"
            " give such a rover file with --rover"
        )
    return [wanted.index(place) for place in places]


def names(text: str) -> tuple[str, ...]:
    """Split a list at its commas."""
    return tuple(part.strip() for part in re.split(",", text) if part.strip())
