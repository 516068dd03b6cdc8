# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated drives as messages, as a bag holds them, without a simulator process."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from terrain_estimator.bags import BagWriter, Types
from terrain_estimator.topics import INPUT_TYPES, Make, Message
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Measurement, Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.vehicle.rover import Rover

ROVER: Rover = load_rover("mars_rover")
JOINTS = (*ROVER.wheel_names, "bogie")
"""Names in joint_states."""
COHESION_PA, TAN_PHI = 1500.0, 0.6
START_NS = 100 * 1_000_000_000
STEP_NS = 100_000_000
Event = tuple[str, int, Any]  # topic, stamp [ns], message


@cache
def measured(seconds: float, seed: int) -> tuple[Sample, Measurement, Measurement]:
    """Return one S1 drive on loose sand: the truth, and the measurements of both sides."""
    generator = torch.Generator().manual_seed(seed)
    strength = torch.tensor([[COHESION_PA, TAN_PHI]], dtype=torch.float64)
    ground = Ground(
        [Patch(load_soil("loose_sand").constants().unsqueeze(0), strength, name="loose_sand")]
    )
    drive = simulate(ROVER, ground, "S1", seconds, generator, 1)
    left, right = (measure_drive(ROVER, drive.sample, Noise(), generator) for _ in range(2))
    return drive.sample, left, right


def drive_messages(make: Make, seconds: float = 10.0, seed: int = 1) -> Iterator[Event]:
    """Yield the five input topics at 10 Hz, by stamp, then in the order of INPUT_TYPES."""
    _, left, right = measured(seconds, seed)
    for step in range(left.velocity.shape[1]):
        stamp = START_NS + step * STEP_NS
        for topic, fields in _fields(make, left, right, step, _header(make, stamp)).items():
            yield topic, stamp, make(INPUT_TYPES[topic], **fields)


def write_bag(
    folder: Path,
    events: Iterator[Event] | list[Event],
    types: Types,
    namespace: str = "",
    *,
    recording: bool = False,
) -> Path:
    """Write messages of the input topics to a bag whose log times are their stamps."""
    with BagWriter(folder, recording=recording) as writer:
        topics = {
            name: writer.add_topic(f"{namespace}/{name}", type_name)
            for name, type_name in INPUT_TYPES.items()
        }
        for name, stamp, message in events:
            writer.write(topics[name], types.serialize(message), stamp)
    return folder


def _header(make: Make, stamp_ns: int) -> Any:
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    return make(
        "std_msgs/msg/Header",
        stamp=make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec),
        frame_id="base_link",
    )


def _fields(
    make: Make, left: Measurement, right: Measurement, step: int, header: Any
) -> dict[str, dict[str, Any]]:
    def wheels(name: str) -> Any:
        sides = {"left": getattr(left, name), "right": getattr(right, name)}
        return np.array(
            [
                float(sides[wheel.side].expand_as(left.slip)[0, step, wheel.axle])
                for wheel in ROVER.wheels
            ]
        )

    def scalar(name: str) -> float:
        return float(torch.as_tensor(getattr(left, name)).expand_as(left.velocity)[0, step])

    pitch = scalar("pitch")
    orientation = make(
        "geometry_msgs/msg/Quaternion", w=np.cos(pitch / 2), y=-np.sin(pitch / 2), x=0.0, z=0.0
    )
    names = list(ROVER.wheel_names)
    return {
        "wheel_slip": {
            "header": header,
            "sequence": step,
            "wheel": names,
            "slip": wheels("slip"),
            "slip_stddev": wheels("slip_sd"),
        },
        "wheel_sinkage": {
            "header": header,
            "sequence": step,
            "wheel": names,
            "sinkage": wheels("sinkage"),
            "sinkage_stddev": wheels("sinkage_sd"),
            "contact_angle": wheels("contact_angle"),
            "contact_angle_stddev": wheels("contact_angle_sd"),
        },
        "odom": _odom(make, header, orientation, scalar),
        "joint_states": {
            "header": header,
            "name": list(JOINTS),
            "position": np.append(np.zeros(len(names)), scalar("bogie_angle")),
            "velocity": np.append(wheels("wheel_rate"), np.nan),
            "effort": np.append(wheels("torque"), np.nan),
        },
        "imu": {
            "header": header,
            "orientation": orientation,
            "orientation_covariance": _diagonal(9, 4, scalar("pitch_sd")),
            "linear_acceleration": make("geometry_msgs/msg/Vector3", x=scalar("acceleration")),
            "linear_acceleration_covariance": _diagonal(9, 0, scalar("acceleration_sd")),
        },
    }


def _odom(
    make: Make, header: Message, orientation: Message, scalar: Callable[[str], float]
) -> dict[str, Any]:
    twist = make("geometry_msgs/msg/Vector3", x=scalar("velocity"))
    return {
        "header": make("std_msgs/msg/Header", stamp=header.stamp, frame_id="odom"),
        "child_frame_id": "base_link",
        "pose": make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=make("geometry_msgs/msg/Pose", orientation=orientation),
            covariance=_diagonal(36, 28, scalar("pitch_sd")),
        ),
        "twist": make(
            "geometry_msgs/msg/TwistWithCovariance",
            twist=make("geometry_msgs/msg/Twist", linear=twist),
            covariance=_diagonal(36, 0, scalar("velocity_sd")),
        ),
    }


def _diagonal(size: int, entry: int, deviation: float) -> Any:
    values = np.zeros(size)
    values[entry] = deviation**2
    return values
