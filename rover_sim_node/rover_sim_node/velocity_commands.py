# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drive schedule that follows velocity commands with the wheel rates of a rover without slip."""

import math

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from terramechanics.simulation.schedules import Command
from terramechanics.vehicle.rover import Rover

_ROUNDING = 1e-9  # [s]


def check_timeout(config: SimulatorConfig) -> None:
    """Raise ConfigError where every command would be stale before the next sample."""
    if config.cmd_vel_timeout + _ROUNDING < 1.0 / config.rate:
        raise ConfigError(
            f"parameter cmd_vel_timeout: {config.cmd_vel_timeout:g} s is over before the next"
            f" sample, {1.0 / config.rate:g} s later: the rover would never move; give more, or a"
            " higher rate"
        )


def is_fresh(time: float, fresh_until: float) -> bool:
    """Return whether a command still holds at ``time`` [s]."""
    return time <= fresh_until + _ROUNDING


class VelocityCommands:
    """Turn the last velocity command into wheel rates, with bounded acceleration.

    A stale command stops the rover.
    """

    kind = Command.RATE

    def __init__(self, rover: Rover, config: SimulatorConfig) -> None:
        """Start at rest.

        Raises ConfigError where every command would be stale before the next sample.
        """
        check_timeout(config)
        self.start_velocity = torch.zeros(1, dtype=torch.float64)
        self._rover, self._config = rover, config
        self._wanted, self._speed = 0.0, 0.0
        self._fresh_until, self._now = -math.inf, 0.0

    def request(
        self, linear: tuple[float, float, float], angular: tuple[float, float, float]
    ) -> str:
        """Accept a velocity command [m/s], [rad/s], or return the reason for a refusal, else ""."""
        if not all(math.isfinite(value) for value in (*linear, *angular)):
            return "it is not finite"
        if any(angular):
            return (
                f"the simulated rover drives straight: angular is {angular}, expected zeros; set"
                " steering for one that turns"
            )
        if any(linear[1:]):
            return f"the simulated rover moves along x alone: linear is {linear}"
        if not 0.0 <= linear[0] <= self._config.cmd_vel_limit:
            return (
                f"linear.x is {linear[0]:g} m/s, outside 0 to {self._config.cmd_vel_limit:g}: the"
                " simulated rover drives forward"
            )
        self._wanted = linear[0]
        self._fresh_until = self._now + self._config.cmd_vel_timeout
        return ""

    def command(self, time: float) -> Tensor:
        """Return the same wheel rate for every axle at ``time`` [s]: [1, axles] [rad/s]."""
        wanted = self._wanted if is_fresh(time, self._fresh_until) else 0.0
        most = self._config.cmd_vel_acceleration * (time - self._now)
        self._speed += min(max(wanted - self._speed, -most), most)
        self._now = time
        return torch.full(
            (1, self._rover.axles), self._speed / self._rover.wheel_radius, dtype=torch.float64
        )
