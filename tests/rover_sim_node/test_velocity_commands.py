# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Velocity commands become wheel rates; what a planar rover cannot do is refused with a reason."""

import math

import pytest

from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.velocity_commands import VelocityCommands
from terramechanics.presets import load_rover

ROVER = load_rover("mars_rover")
NOTHING = (0.0, 0.0, 0.0)


def commands() -> VelocityCommands:
    return VelocityCommands(
        ROVER, SimulatorConfig(cmd_vel_acceleration=0.2, cmd_vel_timeout=0.5, cmd_vel_limit=1.0)
    )


def speeds(followed: VelocityCommands, first: int, last: int) -> list[float]:
    """Commanded circumferential speeds of steps first to last."""
    return [
        float(followed.command(0.1 * step)[0, 0]) * ROVER.wheel_radius
        for step in range(first, last + 1)
    ]


def test_the_wheels_gain_speed_with_bounded_acceleration_and_keep_it() -> None:
    followed = commands()
    assert followed.request((0.05, 0.0, 0.0), NOTHING) == ""
    assert speeds(followed, 1, 5) == pytest.approx([0.02, 0.04, 0.05, 0.05, 0.05])


def test_a_stale_command_stops_the_rover() -> None:
    followed = commands()
    followed.request((0.04, 0.0, 0.0), NOTHING)
    assert speeds(followed, 1, 9) == pytest.approx(
        [0.02, 0.04, 0.04, 0.04, 0.04, 0.02, 0.0, 0.0, 0.0]
    )


def test_a_repeated_command_keeps_it_going() -> None:
    followed = commands()
    for step in range(1, 30):
        followed.request((0.1, 0.0, 0.0), NOTHING)
        speeds(followed, step, step)
    assert speeds(followed, 30, 30) == pytest.approx([0.1])


def test_commands_that_would_be_stale_before_the_next_sample_are_refused_at_the_start() -> None:
    with pytest.raises(
        ConfigError, match=r"cmd_vel_timeout: 0\.5 s is over before the next sample, 1 s later"
    ):
        VelocityCommands(ROVER, SimulatorConfig(rate=1.0))
    followed = VelocityCommands(ROVER, SimulatorConfig(rate=1.0, cmd_vel_timeout=1.0))
    followed.request((0.1, 0.0, 0.0), NOTHING)
    assert float(followed.command(1.0)[0, 0]) > 0.0


def test_without_a_command_the_rover_stands() -> None:
    assert speeds(commands(), 1, 3) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("linear", "angular", "reason"),
    [
        ((0.1, 0.0, 0.0), (0.0, 0.0, 0.2), "set steering"),
        ((0.1, 0.1, 0.0), NOTHING, "along x alone"),
        ((-0.1, 0.0, 0.0), NOTHING, "drives forward"),
        ((1.1, 0.0, 0.0), NOTHING, "outside 0 to 1"),
        ((math.nan, 0.0, 0.0), NOTHING, "not finite"),
        ((0.1, 0.0, 0.0), (0.0, 0.0, math.inf), "not finite"),
    ],
)
def test_a_command_that_cannot_be_followed_is_refused_and_changes_nothing(
    linear: tuple[float, float, float], angular: tuple[float, float, float], reason: str
) -> None:
    followed = commands()
    assert reason in followed.request(linear, angular)
    assert speeds(followed, 1, 2) == [0.0, 0.0]
