# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of rovers with two axles and with the bogie in front, and what becomes of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.messages import step_messages
from rover_sim_node.reading import SimulatedReading
from rover_sim_node.run import SimulatedRun
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.observation import Observation
from tests.rovers import BOGIE_IN_FRONT, FOUR_WHEELS, rover_file

WHEELS = ["front_left", "front_right", "rear_left", "rear_right"]


def driven(rover: str, steps: int) -> tuple[SimulatedRun, list[SimulatedReading]]:
    run = SimulatedRun(SimulatorConfig(rover=rover, seed=5, noise=0.0))
    return run, [run.step() for _ in range(steps)]


def observed(run: SimulatedRun, step: dict[str, Any], *, joints: bool = True) -> Observation:
    converter = Converter(run.rover, ConversionConfig(), CoreConfig())
    names = ("wheel_slip", "wheel_sinkage", "odom", "joint_states", "imu")
    messages = tuple(step[name] if joints or name != "joint_states" else None for name in names)
    observation = converter.convert(0, messages).observation
    assert observation is not None
    return observation


def test_four_wheels_publish_as_many_values_and_no_joint_of_a_suspension() -> None:
    run, readings = driven("four_wheel_rover", 3)
    step = step_messages(readings[-1], SimulatorConfig(), 0, 0)
    assert step["wheel_slip"].wheel == step["wheel_sinkage"].wheel == WHEELS
    joints = step["joint_states"]
    assert joints.name == WHEELS
    assert len(joints.position) == len(joints.velocity) == len(joints.effort) == 4
    observation = observed(run, step)
    assert observation.slip.shape == observation.sinkage.shape == observation.torque.shape == (2,)
    measured = readings[-1].measured
    np.testing.assert_allclose(observation.slip, measured.slip[::2])
    np.testing.assert_allclose(observation.torque, measured.torque[::2])


def test_the_angle_of_no_joint_is_zero_with_and_without_joint_states() -> None:
    run, readings = driven("four_wheel_rover", 1)
    step = step_messages(readings[-1], SimulatorConfig(), 0, 0)
    assert observed(run, step).bogie_angle == 0.0
    assert observed(run, step, joints=False).bogie_angle == 0.0
    step["joint_states"].name = [*WHEELS[:3], "bogie"]
    step["joint_states"].position = [0.0, 0.0, 0.0, 0.4]
    assert observed(run, step).bogie_angle == 0.0


def test_a_rover_file_with_the_bogie_in_front_publishes_its_angle(tmp_path: Path) -> None:
    run, readings = driven(rover_file(BOGIE_IN_FRONT, tmp_path / "front.yaml"), 60)
    assert run.rover == BOGIE_IN_FRONT
    step = step_messages(readings[-1], SimulatorConfig(), 0, 0)
    assert step["joint_states"].name[-2:] == ["rocker", "bogie"]
    angle = readings[-1].bogie_angle
    assert abs(angle) > 1e-4  # over hills
    assert observed(run, step).bogie_angle == angle


def test_an_axle_that_the_rover_lacks_is_refused() -> None:
    config = SimulatorConfig(rover=FOUR_WHEELS.name, effect="failed_wheel", effect_size=0.5)
    with pytest.raises(ConfigError, match=r"effect_axle: 2 is none of the 2 axles .* give 0 to 1"):
        SimulatedRun(config)
