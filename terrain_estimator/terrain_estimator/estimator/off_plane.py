# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The refusal of what a planar model does not describe: a lean to a side, a turn, a slide."""

import math
from collections.abc import Iterable
from typing import NamedTuple

from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.model.metadata import Metadata
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import STEEPEST_STEERING, WheelPlaces

FASTEST = 100.0
"""[m/s] of rover and rim; beyond it a sensor is broken or a unit is wrong."""
DEVIATIONS = (1e-9, 1e9)
"""[SI] Standard deviations outside have squares or ratios that overflow."""
_STEEPEST_LEAN = 0.5
"""[rad] Roll beyond which the wheels of a model by wheel no longer press on a plane."""
_STRONGEST_TURN = 0.2
"""[g] No rover turns and slides with more; beyond it a sensor is broken or a unit is wrong."""
_FASTEST_TURN = 10.0
"""[rad/s] No rover turns faster; beyond it a unit is wrong."""
_TURN_BOUND = 2.0
"""[standard deviations] Noise allowed to what is perhaps a turn.

It says nothing of c and tan phi: a refusal in vain costs a twentieth of the data and no bias, a
turn that passes biases them.
"""
Refusal = tuple[Outcome, str] | None
"""The outcome and its detail; None where nothing is refused."""


def is_deviation(value: float) -> bool:
    """Return whether a number can be a standard deviation; NaN cannot."""
    return DEVIATIONS[0] <= value <= DEVIATIONS[1]


def refuse_off_plane(
    observation: Observation, rims: list[float], rover: Rover, config: CoreConfig
) -> Refusal:
    """Refuse a rover that leans to a side, moves sideways or turns: the model is planar.

    Wheels share their shear between along and across, and left and right carry different loads.
    What that does to c and tan phi, and so where the limits are, is in docs/lateral.md. Noise may
    explain a motion, but not a lean: its noise is far below the limit. What is not measured counts
    as zero.
    """
    lean = abs(observation.roll)
    if config.roll_limit and lean > config.roll_limit:
        degrees = f"{math.degrees(lean):.1f} deg to a side"
        limit = f"beyond roll_limit ({math.degrees(config.roll_limit):.1f} deg)"
        return Outcome.NOT_PLANAR, f"the rover leans {degrees}, {limit}"
    if not config.turn_limit or _is_straight(observation, rover, config.turn_limit):
        return None
    moved = sideways_of(observation, rims, rover)
    if not moved.beyond(config.turn_limit):
        return None
    motion = f"lateral velocity {moved.left:.3g} m/s and yaw rate {moved.turn:.3g} rad/s"
    share = f"turn_limit ({config.turn_limit:g} of {moved.speed:.3g} m/s)"
    aside = f"{moved.sideways:.3g} m/s, beyond {share} and noise ({moved.noise:.3g} m/s)"
    return Outcome.NOT_PLANAR, f"{motion} move an axle sideways by {aside}"


def _is_straight(observation: Observation, rover: Rover, limit: float) -> bool:
    """Return whether no axle moves aside by more than ``limit`` [1] of the velocity.

    Then :meth:`Sideways.beyond` is false, too: this spares most observations the rest.
    """
    left, _ = _known(observation.lateral_velocity, observation.lateral_velocity_sd)
    turn, _ = _known(observation.yaw_rate, observation.yaw_rate_sd)
    furthest = max(rover.axle_x[0], -rover.axle_x[-1])
    return abs(left) + furthest * abs(turn) <= limit * max(observation.velocity, 0.0)


class Sideways(NamedTuple):
    """Motion to the side; what is not measured counts as zero."""

    left: float  # [m/s] lateral velocity
    turn: float  # [rad/s] yaw rate
    sideways: float  # [m/s] of the axle that moves most to a side
    noise: float  # [m/s] allowed to it
    turning: float  # [m/s] of the outer axles by the turn alone, less the noise allowed to it
    speed: float  # [m/s] of the rims, or of the rover where that is more

    def beyond(self, limit: float) -> bool:
        """Return whether an axle moves aside by more than ``limit`` [1] of the speed, and noise."""
        return self.sideways - self.noise > limit * self.speed

    def turns(self, limit: float) -> bool:
        """Return whether it does so because the rover turns, rather than slides or crabs."""
        return self.turning > limit * self.speed


def sideways_of(observation: Observation, rims: Iterable[float], rover: Rover) -> Sideways:
    """Return the motion to the side; ``rims`` are the speeds of the axles' rims [m/s]."""
    left, left_sd = _known(observation.lateral_velocity, observation.lateral_velocity_sd)
    turn, turn_sd = _known(observation.yaw_rate, observation.yaw_rate_sd)
    reach = 0.5 * (rover.axle_x[0] - rover.axle_x[-1])
    return Sideways(
        left,
        turn,
        max(abs(left + x * turn) for x in rover.axle_x),
        _TURN_BOUND * math.hypot(left_sd, rover.reach * turn_sd),
        reach * (abs(turn) - _TURN_BOUND * turn_sd),
        # a rate that no wheel has is masked later
        max([0.0, observation.velocity, *(rim for rim in rims if abs(rim) <= FASTEST)]),
    )


def _known(value: float, deviation: float) -> tuple[float, float]:
    """Return a value and its deviation; zeros where it is not measured."""
    return (value, deviation) if math.isfinite(value) and deviation >= 0.0 else (0.0, 0.0)


class SingleWheels(NamedTuple):
    """What the screening needs of the wheels of a model by wheel."""

    names: tuple[str, ...]
    steered: bool  # whether joints turn any of them
    gravity: float  # [m/s^2]

    @classmethod
    def of(cls, metadata: Metadata) -> "SingleWheels | None":
        """Return those of a model; None where it is by axle."""
        return cls.at(metadata.rover, metadata.wheel_places)

    @classmethod
    def at(cls, rover: Rover, places: WheelPlaces | None) -> "SingleWheels | None":
        """Return those at ``places`` of a rover; None where there are none."""
        if places is None:
            return None
        return cls(places.wheels(rover), any(places.steers(rover)), rover.gravity)


def refuse_motion(observation: Observation, wheels: SingleWheels) -> Refusal:
    """Refuse an observation that does not tell a model by wheel how each wheel moves.

    It needs lateral velocity, yaw rate and roll, and of every wheel its rate, and its steering
    where a joint turns it.
    """
    limits = {"lateral_velocity": FASTEST, "yaw_rate": _FASTEST_TURN, "roll": _STEEPEST_LEAN}
    for name, limit in limits.items():
        value, what = getattr(observation, name), name.replace("_", " ")
        if not math.isfinite(value):
            needed = f"{what} is {value}, which a model by wheel needs, with its variance"
            return Outcome.NOT_FINITE, needed
        if abs(value) > limit:
            return Outcome.OUT_OF_RANGE, f"{what} {value:g} is not within +-{limit:g}"
        deviation = getattr(observation, f"{name}_sd", 1.0)
        if not is_deviation(deviation):
            return Outcome.BAD_DEVIATION, f"the standard deviation of {what} is {deviation:g}"
    pulled = abs(observation.lateral_velocity * observation.yaw_rate)
    if pulled > _STRONGEST_TURN * wheels.gravity:
        what = f"lateral velocity {observation.lateral_velocity:g} m/s"
        turn = f"yaw rate {observation.yaw_rate:g} rad/s"
        return Outcome.OUT_OF_RANGE, f"{what} times {turn} is beyond {_STRONGEST_TURN:g} g"
    return _refuse_wheels(observation, wheels)


def _refuse_wheels(observation: Observation, wheels: SingleWheels) -> Refusal:
    steering, count = observation.steering, len(wheels.names)
    unknown = math.nan if wheels.steered else 0.0
    angles = [unknown] * count if steering is None else steering.tolist()
    each = zip(wheels.names, observation.wheel_rate.tolist(), angles, strict=True)
    return next(filter(None, (_refuse_wheel(*wheel) for wheel in each)), None)


def _refuse_wheel(wheel: str, rate: float, steering: float) -> Refusal:
    for what, value in (("wheel rate", rate), ("steering", steering)):
        if not math.isfinite(value):
            return Outcome.NOT_FINITE, f"wheel {wheel}: {what} is {value}"
    if rate == 0.0:
        return Outcome.OUT_OF_RANGE, f"wheel {wheel}: it stands, so that it has no slip"
    if abs(steering) >= STEEPEST_STEERING:
        limit = f"not within +-{STEEPEST_STEERING:g} rad"
        return Outcome.OUT_OF_RANGE, f"wheel {wheel}: steering {steering:.3g} rad is {limit}"
    return None
