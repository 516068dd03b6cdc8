# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of a rover that turns as observations by wheel, by way of their messages."""

from collections.abc import Sequence

from rover_sim_node.messages import step_messages
from rover_sim_node.turning_run import TurningRun
from terrain_estimator.config.estimator import ConversionConfig, CoreConfig
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Observation

INPUTS = ("wheel_slip", "wheel_sinkage", "odom", "joint_states", "imu")
Twist = tuple[float, float]
"""v_x [m/s] and yaw rate [rad/s]."""


def turning_observations(
    model: LoadedModel, run: TurningRun, twists: Sequence[Twist], seconds: float
) -> list[Observation]:
    """Return what the node makes of a drive at 10 Hz, with ``seconds`` for each of the twists."""
    core = CoreConfig().of_model(by_wheel=True)
    converter = Converter(model.rover, ConversionConfig(), core, model.metadata.steered)
    found = []
    for ahead, turn in twists:
        for _ in range(round(10.0 * seconds)):
            run.commands.request((ahead, 0.0, 0.0), (0.0, 0.0, turn))
            reading = run.step()
            stamp_ns = round(1e9 * reading.time)
            messages = step_messages(reading, run.config, stamp_ns, 0)
            inputs = tuple(messages[each] for each in INPUTS)
            observation = converter.convert(stamp_ns, inputs).observation
            assert observation is not None
            found.append(observation)
    return found
