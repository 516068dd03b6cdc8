# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated trial of a four-wheel skid-steer rover, written in the schema of RoSE Lab's dataset.

The rover drives straight, turns, and drives straight again, up a slope of loose sand. Poses have
the noise of a motion capture; encoders come at 10 Hz. The fields of the encoders' message are not
published: those here are the test's.
"""

import csv
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from terrain_estimator.bags import BagWriter, Definition
from terrain_estimator.bags.format.definitions import type_hash
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.spatial import BodySimulation, Plane
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.steering import skid_command

ROVER = load_rover("four_wheel_rover")
TRACK = 0.55
CHASSIS = Chassis.of(ROVER, TRACK, 4.0)
TO_SCHEMA = [0, 2, 1, 3]
"""Front left, front right, back left, back right among the chassis' wheels."""
SLOPE = 0.05  # [1]
POSITION_SD, ANGLE_SD = 2e-4, 5e-4  # [m], [rad] of a pose
GAIN = 0.02  # [N m] for each unit of raw current
POSE_HZ, START = 120.0, 1000.0
HEADER = [
    "time_s",
    *(f"pos_{axis}" for axis in "xyz"),
    *(f"quat_{axis}" for axis in "xyzw"),
    *(f"{name}_{axis}" for name in ("ang_vel", "lin_acc") for axis in "xyz"),
    *(name.format(wheel) for name in ("enc{}", "enc{}_rad") for wheel in (1, 2, 3, 4)),
    *(name.format(wheel) for name in ("vel{}_rad_s", "current{}") for wheel in (1, 2, 3, 4)),
]
MOTOR = Definition(
    "custom_msgs/msg/MotorData",
    "std_msgs/Header header\nfloat64[4] speeds\nint32 load_a\nint32 load_b\nint32 load_c\n"
    "int32 load_d\nstring remark\n"
    + "=" * 80
    + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + "=" * 80
    + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
    "",
)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Driven:
    """True values at the ends of steps of 0.1 s, and what motion capture and encoders saw."""

    time: Array  # [n]
    velocity: Array  # [n, 3] v_x, v_y, yaw rate
    slip: Array  # [n, 4] in the schema's order
    rate: Array  # [n, 4]
    torque: Array  # [n, 4]
    sinkage: Array  # [n, 4]
    pose_time: Array  # [m]
    position: Array  # [m, 3]
    quaternion: Array  # [m, 4]

    def changed(self, **values: Any) -> "Driven":
        return replace(self, **values)


def twists(seconds: float) -> Array:
    """Return commands at 10 Hz: straight, a turn of 4 s to the left, straight."""
    time = np.arange(0.0, seconds, 0.1)
    forward = 0.3 * np.minimum(1.0, time / 2.0) + 0.03 * np.sin(time)
    turning = np.where((time > 0.4 * seconds) & (time < 0.4 * seconds + 4.0), 0.5, 0.0)
    return np.stack([forward, np.zeros_like(time), turning], -1)


@cache
def driven(seconds: float = 20.0, seed: int = 0) -> Driven:
    soil = load_soil("loose_sand")
    simulation = BodySimulation(
        CHASSIS,
        soil.constants().expand(1, 6),
        soil.strength().expand(1, 2),
        Plane(slope_x=SLOPE),
    )
    samples = [
        simulation.step(*skid_command(CHASSIS, twist.unsqueeze(0)))
        for twist in torch.tensor(twists(seconds))
    ]
    assert all(bool(sample.solved.all()) for sample in samples)
    generator = np.random.default_rng(seed)
    time, velocity, heading, place = (
        np.array([getattr(sample, name)[0].tolist() for sample in samples])
        for name in ("time", "velocity", "heading", "position")
    )
    pose_time = np.arange(0.1, time[-1], 1.0 / POSE_HZ)
    # From one sample's time to the next the rover moves by the velocity of the first.
    along, across, turned = (np.interp(pose_time, time, values) for values in (*place.T, heading))
    tilt = np.arctan(SLOPE)
    position = np.stack([along * np.cos(tilt), across, along * np.sin(tilt)], -1)
    half = 0.5 * (turned + ANGLE_SD * generator.normal(size=len(turned)))
    zero, down = np.zeros_like(half), np.full_like(half, -0.5 * tilt)
    # nose up by the slope, then the heading in the slope
    quaternion = np.stack(
        [
            np.sin(down) * np.sin(half),
            np.sin(down) * np.cos(half),
            np.cos(down) * np.sin(half),
            np.cos(down) * np.cos(half) + zero,
        ],
        -1,
    )

    def wheels(values: list[torch.Tensor]) -> Array:
        return np.array([value[0].tolist() for value in values])[:, TO_SCHEMA]

    return Driven(
        time=time,
        velocity=velocity,
        slip=wheels([sample.slip for sample in samples]),
        rate=wheels([sample.rim / ROVER.wheel_radius for sample in samples]),
        torque=wheels([sample.torque for sample in samples]),
        sinkage=wheels([sample.sinkage for sample in samples]),
        pose_time=pose_time,
        position=position + POSITION_SD * generator.normal(size=position.shape),
        quaternion=quaternion,
    )


def rows(drive: Driven) -> list[list[float]]:
    """Return a row for each pose; the encoders' values are held between their readings."""
    found = []
    for time, position, quaternion in zip(
        drive.pose_time, drive.position, drive.quaternion, strict=True
    ):
        at = int(np.searchsorted(drive.time, time + 1e-9, side="right")) - 1
        rate, current = drive.rate[at], drive.torque[at] / GAIN
        found.append(
            [
                START + time,
                *position,
                *quaternion,
                *(0.0, 0.0, drive.velocity[at, 2]),
                *(9.81 * SLOPE, 0.0, 9.8),
                *np.zeros(8),
                *rate,
                *current,
            ]
        )
    return found


def write_table(path: Path, table: list[list[float]], header: list[str] = HEADER) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(table)
    return path


def write_recording(path: Path, drive: Driven, late: float = 0.0) -> Path:
    """Write a raw recording; the encoders' clock is ``late`` [s]."""
    with BagWriter(path) as writer:
        definition = replace(MOTOR, type_hash=type_hash(MOTOR.type_name, MOTOR.text))
        writer.types.add(definition)
        pose = writer.add_topic("/optitrack/pose", "geometry_msgs/msg/PoseStamped")
        motor = writer.add_topic("/motor/encoder", MOTOR.type_name, definition=definition)
        make = writer.types.make

        def header(seconds: float) -> Any:
            stamp = round(seconds * 1e9)
            parts = {"sec": stamp // 10**9, "nanosec": stamp % 10**9}
            return make("std_msgs/msg/Header", stamp=make("builtin_interfaces/msg/Time", **parts))

        events = [(time, True, at) for at, time in enumerate(drive.pose_time)]
        # the rates of a sample hold until the next one; they are read in the middle
        events += [(time + 0.05 * (at > 0), False, at) for at, time in enumerate(drive.time[:-1])]
        for time, is_pose, at in sorted(events):
            log = round((START + time) * 1e9)
            if is_pose:
                message = make("geometry_msgs/msg/PoseStamped", header=header(START + time))
                place, turn = message.pose.position, message.pose.orientation
                place.x, place.y, place.z = drive.position[at].tolist()
                turn.x, turn.y, turn.z, turn.w = drive.quaternion[at].tolist()
                writer.write_message(pose, message, log)
            else:
                loads = zip("abcd", drive.torque[at] / GAIN, strict=True)
                fields = {f"load_{name}": round(value) for name, value in loads}
                message = make(
                    MOTOR.type_name,
                    header=header(START + time + late),
                    speeds=np.ascontiguousarray(drive.rate[at]),
                    **fields,
                )
                writer.write_message(motor, message, log)
    return path
