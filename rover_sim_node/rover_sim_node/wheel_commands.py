# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Commands wheel by wheel of a rover that turns: rates, and angles of the joints that steer."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from rover_sim_node.config import SimulatorConfig
from rover_sim_node.twist_commands import ACKERMANN, SKID
from rover_sim_node.velocity_commands import check_timeout, is_fresh
from terramechanics.description.layout import STEERING_SUFFIX
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import chassis_places

STEEPEST = 0.5 * math.pi
"""[rad] Largest angle of a wheel's heading from that of the body."""


class WheelCommands:
    """Follow the last rates and steering angles, with bounded accelerations of the rims.

    Stale rates are zero. Steering angles follow at once, and stay.
    """

    def __init__(self, rover: Rover, config: SimulatorConfig) -> None:
        """Start at rest, straight. Raises ConfigError that names a wrong parameter."""
        check_timeout(config)
        self._config, self._radius = config, rover.wheel_radius
        self._places = dict(zip(rover.wheel_names, chassis_places(rover), strict=True))
        last = rover.axles - 1
        self._steered = {
            f"{wheel.name}{STEERING_SUFFIX}": self._places[wheel.name]
            for wheel in rover.wheels
            if config.steering != SKID and not (config.steering == ACKERMANN and wheel.axle == last)
        }
        count = len(rover.wheels)
        self._wanted, self._rim, self._steering = torch.zeros(3, count, dtype=torch.float64)
        self._fresh_until, self._now = -math.inf, 0.0

    def request(self, names: Sequence[str], rates: Sequence[float], angles: Sequence[float]) -> str:
        """Accept rates [rad/s] of wheels and angles [rad] of joints that steer, by their names.

        Every wheel needs a rate; a joint that is left out keeps its angle. Returns the reason for a
        refusal, else "".
        """
        known = (*self._places, *self._steered)
        if unknown := [name for name in names if name not in known]:
            return f"{unknown[0]} is no joint to command: known are {', '.join(known)}"
        if missing := [name for name in self._places if name not in names]:
            return f"wheel {missing[0]} is missing: give velocity for every wheel"
        if len(set(names)) < len(names) or any(
            given and len(given) != len(names) for given in (rates, angles)
        ):
            return (
                f"it has {len(names)} names, {len(rates)} velocities and {len(angles)} positions:"
                " give each name once, with a velocity of wheels and a position of joints that"
                " steer"
            )
        wanted, steering = self._wanted.clone(), self._steering.clone()
        for at, name in enumerate(names):
            steers = name in self._steered
            values, kind = (angles, "position") if steers else (rates, "velocity")
            value = float(values[at]) if values else math.nan
            if not math.isfinite(value):
                return f"{name} has no finite {kind}"
            limit = STEEPEST if steers else self._config.cmd_vel_limit / self._radius
            if abs(value) > limit:
                return (
                    f"{kind} of {name} is {value:.3g}, beyond {limit:.3g}"
                    f"{'' if steers else ' (cmd_vel_limit over the radius)'}"
                )
            if steers:
                steering[self._steered[name]] = value
            else:
                wanted[self._places[name]] = value * self._radius
        self._wanted, self._steering = wanted, steering
        self._fresh_until = self._now + self._config.cmd_vel_timeout
        return ""

    def command(self, time: float) -> tuple[Tensor, Tensor]:
        """Return rim speeds [m/s] and steering angles [rad] at ``time`` [s]: [1, wheels] each."""
        fresh = is_fresh(time, self._fresh_until)
        wanted = self._wanted if fresh else torch.zeros_like(self._wanted)
        most = self._config.cmd_vel_acceleration * (time - self._now)
        self._rim = self._rim + (wanted - self._rim).clamp(-most, most)
        self._now = time
        return self._rim.unsqueeze(0), self._steering.unsqueeze(0)
