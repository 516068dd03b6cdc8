# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Markers of wheels stand where the wheels are, and their arrows bear and drive the rover."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import torch
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from rover_sim_node.config import SimulatorConfig
from rover_sim_node.messages import step_messages
from rover_sim_node.reading import SimulatedReading
from rover_sim_node.run import SimulatedRun
from rover_sim_node.viewing import ARROW_RADII, UNKNOWN, marker_message, transform_message
from terramechanics.presets import load_rover, rover_names

HEADER = Header(frame_id="base_link")


def reading(rover: str, steps: int = 3, **values: Any) -> SimulatedReading:
    run = SimulatedRun(SimulatorConfig(rover=rover, noise=0.0, **values))
    return [run.step() for _ in range(steps)][-1]


def markers(read: SimulatedReading, space: str, track_width: float = 0.0) -> list[Marker]:
    found = marker_message(read, HEADER, track_width).markers
    return [marker for marker in found if marker.ns == space]


@pytest.mark.parametrize("name", rover_names())
def test_arrows_are_forces_that_bear_the_weight_and_accelerate_the_rover(name: str) -> None:
    read, rover = reading(name), load_rover(name)
    newtons = rover.weight / len(rover.wheels) / (ARROW_RADII * rover.wheel_radius)
    tips = [
        (tip.x - foot.x, tip.z - foot.z)
        for foot, tip in (marker.points for marker in markers(read, "forces"))
    ]
    along, upward = newtons * np.sum(tips, axis=0)
    pitch, acceleration = float(read.measured.pitch), float(read.measured.acceleration)
    assert along == pytest.approx(rover.mass * acceleration, abs=1e-3 * rover.weight)
    assert upward == pytest.approx(rover.weight * math.cos(pitch), rel=2e-3)


def test_wheels_are_drawn_at_their_size_on_the_ground_of_the_body() -> None:
    read = reading("four_wheel_rover")
    wheels = markers(read, "wheels", track_width=0.6)
    assert [marker.id for marker in wheels] == [0, 1, 2, 3]
    places = [(m.pose.position.x, m.pose.position.y, m.pose.position.z) for m in wheels]
    assert places == [(x, y, 0.165) for x in (0.255, -0.255) for y in (0.3, -0.3)]
    assert all(m.header.frame_id == "base_link" for m in wheels)
    assert (wheels[0].scale.x, wheels[0].scale.y, wheels[0].scale.z) == (0.33, 0.33, 0.12)


def test_the_bogie_takes_its_wheels_along() -> None:
    read = reading("mars_rover", 40, seed=5)
    assert abs(read.bogie_angle) > 1e-4
    height = [marker.pose.position.z - 0.13 for marker in markers(read, "wheels")]
    assert height[0] == 0.0
    assert math.copysign(1.0, height[2]) == math.copysign(1.0, read.bogie_angle)
    assert height[2] * height[4] < 0.0


def test_a_wheel_that_stands_is_grey_and_one_that_slips_is_redder() -> None:
    still = reading("mars_rover", 1, schedule="cmd_vel")
    assert all(marker.color == UNKNOWN for marker in markers(still, "wheels"))
    gentle = markers(reading("mars_rover", schedule="S3"), "wheels")[0].color
    read = reading("mars_rover", schedule="S3")
    slip = torch.full((6,), 0.9)
    spins = dataclasses.replace(read, measured=dataclasses.replace(read.measured, slip=slip))
    assert gentle.r < markers(spins, "wheels")[0].color.r == 1.0


def test_an_unknown_force_has_no_arrow() -> None:
    read = reading("mars_rover")
    force = read.ground_force.clone()
    force[0, 0], force[1] = torch.nan, 0.0
    changed = dataclasses.replace(read, ground_force=force)
    actions = [marker.action for marker in markers(changed, "forces")]
    assert actions == [Marker.DELETE] * 2 + [Marker.ADD] * 4


def test_the_transform_is_the_pose_of_the_odometry() -> None:
    config = SimulatorConfig(body_frame="chassis", odom_frame="track")
    odometry = step_messages(reading("mars_rover", 20), config, 5, 0)["odom"]
    (transform,) = transform_message(odometry).transforms
    assert (transform.header, transform.child_frame_id) == (odometry.header, "chassis")
    assert transform.header.frame_id == "track"
    pose, moved = odometry.pose.pose, transform.transform
    assert moved.rotation == pose.orientation
    assert moved.translation.x == pose.position.x > 0.0
    assert (moved.translation.y, moved.translation.z) == (pose.position.y, pose.position.z)
