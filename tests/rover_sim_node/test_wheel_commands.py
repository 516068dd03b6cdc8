# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Commands wheel by wheel drive as the twist that they follow from; what is wrong is refused."""

import dataclasses
import math

import pytest
import torch

from rover_parameters.records import ConfigError
from rover_sim_node.config import FOLLOW, FOLLOW_WHEELS, SimulatorConfig
from rover_sim_node.run import SimulatedRun
from rover_sim_node.turning_run import TurningRun
from rover_sim_node.wheel_commands import WheelCommands
from terramechanics.presets import load_rover
from terramechanics.vehicle.wheel_places import chassis_places

CONFIG = SimulatorConfig(
    rover="mars_rover", steering="all_wheels", schedule=FOLLOW_WHEELS, noise=0.0
)
ROVER = load_rover("mars_rover")
STEPS = 60


def test_the_commands_of_a_twist_drive_as_the_twist_does() -> None:
    """A turn with all wheels steered: each wheel gets another rate and another angle.

    The twist is what accelerates slowly here; outer wheels then do so faster than it.
    """
    twist = TurningRun(dataclasses.replace(CONFIG, schedule=FOLLOW))
    wheels = TurningRun(dataclasses.replace(CONFIG, cmd_vel_acceleration=10.0))
    assert wheels.wheel_commands is not None
    assert twist.wheel_commands is None
    order = chassis_places(ROVER)
    found = []
    for step in range(1, STEPS + 1):
        assert twist.commands.request((0.15, 0.02, 0.0), (0.0, 0.0, 0.05)) == ""
        found.append(twist.step())
        rim, steering = twist.commands.command(step * 0.1)
        rates = (rim[0, order] / ROVER.wheel_radius).tolist()
        names = [*ROVER.wheel_names, *(f"{name}_steering" for name in ROVER.wheel_names)]
        given = [*rates, *[0.0] * len(rates)], [*[0.0] * len(rates), *steering[0, order].tolist()]
        assert wheels.wheel_commands.request(names, *given) == ""
        torch.testing.assert_close(wheels.step().measured.slip, found[-1].measured.slip)
    assert float(found[-1].measured.velocity) > 0.1


def test_rims_accelerate_by_the_limit_and_stop_when_commands_do() -> None:
    commands = WheelCommands(ROVER, CONFIG)
    rates = [1.0] * len(ROVER.wheels)
    assert commands.request(ROVER.wheel_names, rates, []) == ""
    rim, _ = commands.command(0.1)
    torch.testing.assert_close(rim, torch.full_like(rim, 0.1 * CONFIG.cmd_vel_acceleration))
    assert commands.request(ROVER.wheel_names, rates, []) == ""
    for step in range(2, 7):
        rim, _ = commands.command(0.1 * step)
    fastest = float(rim.max())
    rim, _ = commands.command(0.8)
    assert float(rim.max()) < fastest


def request(**changed: object) -> str:
    commands = WheelCommands(ROVER, dataclasses.replace(CONFIG, steering="ackermann"))
    names = [*ROVER.wheel_names, "front_left_steering"]
    given = {"names": names, "rates": [0.5] * 7, "angles": [0.1] * 7} | changed
    return commands.request(given["names"], given["rates"], given["angles"])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"names": [*ROVER.wheel_names, "rear_left_steering"]}, "rear_left_steering is no joint"),
        ({"names": [*ROVER.wheel_names[1:], "front_left_steering"]}, "front_left is missing"),
        ({"rates": [0.5] * 6}, "7 names, 6 velocities"),
        ({"rates": []}, "front_left has no finite velocity"),
        ({"rates": [math.nan] * 7}, "front_left has no finite velocity"),
        ({"angles": []}, "front_left_steering has no finite position"),
        ({"angles": [2.0] * 7}, "position of front_left_steering is 2"),
        ({"rates": [100.0] * 7}, "velocity of front_left is 100"),
    ],
)
def test_what_is_wrong_is_refused_by_name_and_changes_nothing(
    changed: dict[str, object], words: str
) -> None:
    assert request() == ""
    assert words in request(**changed)


def test_without_steering_there_are_no_wheel_commands() -> None:
    with pytest.raises(ConfigError, match="schedule: 'wheel_commands' is unknown"):
        SimulatedRun(dataclasses.replace(CONFIG, steering=""))
