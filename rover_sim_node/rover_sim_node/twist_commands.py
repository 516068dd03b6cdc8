# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Velocity commands of a rover that turns: rim speeds and steering angles that follow a twist."""

import math

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from rover_sim_node.velocity_commands import check_timeout, is_fresh
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.steering import ackermann_twist, skid_command, steered_command

SKID, ALL_WHEELS, ACKERMANN = "skid", "all_wheels", "ackermann"
STEERINGS = (SKID, ALL_WHEELS, ACKERMANN)
"""Ways to turn: no wheel is steered, every wheel is, or all but those of the rearmost axle are."""
SHARPEST = 0.8
"""[rad] Largest steering angle of a rover with Ackermann steering."""

Triple = tuple[float, float, float]


def check_steering(config: SimulatorConfig) -> None:
    """Raise ConfigError where the way to turn is none of STEERINGS."""
    if config.steering not in STEERINGS:
        raise ConfigError(
            f"parameter steering: {config.steering!r} is unknown, give one of"
            f" {', '.join(STEERINGS)}, or nothing for a rover that drives straight"
        )


class TwistCommands:
    """Turn the last velocity command into wheel commands, with bounded accelerations.

    A stale command stops the rover. Steering angles follow at once.
    """

    def __init__(self, chassis: Chassis, config: SimulatorConfig) -> None:
        """Start at rest. Raises ConfigError that names a wrong parameter."""
        check_timeout(config)
        self._chassis, self._config = chassis, config
        self._wanted, self._twist = torch.zeros(2, 3, dtype=torch.float64)
        self._fresh_until, self._now = -math.inf, 0.0

    def request(self, linear: Triple, angular: Triple) -> str:
        """Accept a velocity command [m/s], [rad/s], or return the reason for a refusal, else ""."""
        if not all(math.isfinite(value) for value in (*linear, *angular)):
            return "it is not finite"
        if linear[2] or any(angular[:2]):
            return (
                f"the rover moves on the ground: linear is {linear} and angular {angular}, expected"
                " linear x and y and angular z alone"
            )
        if linear[1] and self._config.steering != ALL_WHEELS:
            return (
                f"linear.y is {linear[1]:g} m/s: with {self._config.steering} steering the rover"
                " does not move sideways"
            )
        wanted = torch.tensor([linear[0], linear[1], angular[2]], dtype=torch.float64)
        rim, _ = self._wheels(wanted)
        fastest = float(rim.abs().amax())
        if fastest > self._config.cmd_vel_limit:
            return (
                f"a wheel would run at {fastest:.3g} m/s, beyond {self._config.cmd_vel_limit:g}"
                " (cmd_vel_limit)"
            )
        if float(self._possible(wanted)[2]) != angular[2]:
            return (
                f"angular.z is {angular[2]:g} rad/s, which steers a wheel by more than"
                f" {SHARPEST:g} rad at {linear[0]:g} m/s: turn less or drive faster"
            )
        self._wanted = wanted
        self._fresh_until = self._now + self._config.cmd_vel_timeout
        return ""

    def command(self, time: float) -> tuple[Tensor, Tensor]:
        """Return rim speeds [m/s] and steering angles [rad] at ``time`` [s]: [1, wheels] each."""
        fresh = is_fresh(time, self._fresh_until)
        wanted = self._wanted if fresh else torch.zeros_like(self._wanted)
        most = self._config.cmd_vel_acceleration * (time - self._now)
        bounds = torch.tensor([most, most, most / self._chassis.reach], dtype=torch.float64)
        self._twist = self._possible(self._twist + (wanted - self._twist).clamp(-bounds, bounds))
        self._now = time
        rim, steering = self._wheels(self._twist)
        return rim.unsqueeze(0), steering.unsqueeze(0)

    def _possible(self, twist: Tensor) -> Tensor:
        """Return a twist without what no steering angle allows: Ackermann steering has a limit."""
        if self._config.steering != ACKERMANN:
            return twist
        length = max(self._chassis.wheel_x) - min(self._chassis.wheel_x)
        steepest = math.tan(SHARPEST)
        # of the inner front wheel, whose hub is the slowest and the most turned
        most = twist[0].abs() * steepest / (length + max(self._chassis.wheel_y) * steepest)
        return torch.stack([twist[0], twist[1], twist[2].clamp(-most, most)])

    def _wheels(self, twist: Tensor) -> tuple[Tensor, Tensor]:
        if self._config.steering == SKID:
            return skid_command(self._chassis, twist)
        if self._config.steering == ACKERMANN:
            twist = ackermann_twist(self._chassis, twist[0], twist[2])
        return steered_command(self._chassis, twist)
