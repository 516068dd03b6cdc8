# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The planner: measurements and estimates in, advice out.

It has no clock, logs nothing and opens no files.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import TURN_LIMIT
from terrain_estimator.config.planner import AdviceConfig
from terrain_estimator.estimator.moving import backwards
from terrain_estimator.estimator.off_plane import FASTEST, Sideways, sideways_of
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.planning.belief import Belief, Samples, draw
from terrain_estimator.planning.front import FrontReading, front_samples
from terrain_estimator.planning.margins import (
    NOTHING,
    CredibleRange,
    Margins,
    margins,
    stall_probability,
    turn_limit,
    unknown_margins,
)
from terrain_estimator.planning.table import TractionTable

NEW_GROUND = 0.02
"""[1] Least probability of new ground under the front wheels, before their torque is considered."""


LOADS = "load of the front wheels from balances"
"""What is missing where balances do not determine the loads."""


class Reason(IntEnum):
    """Reason to stop; the values are those of msg_defs/TractionAdvice."""

    NONE = 0
    TRACTION = 1
    FRONT = 2
    SLIP = 3
    SINKAGE = 4


@dataclass(frozen=True, slots=True)
class Advice:
    """Advice for one instant."""

    known: bool  # whether the margins are known: c and tan phi are identified
    disagrees: bool  # whether the estimate's model does not fit, which judges nothing then
    moving: bool  # whether wheels turned within the window; else only the slope is measured
    margins: Margins  # of the ground under the rover
    turn_limit: CredibleRange  # [1] share up to which that ground holds every turn
    # [1] of being stuck with all wheels on the front wheels' ground; NaN: not measured
    front_stall_probability: float
    front_lacks: str  # missing measurements of the front wheels' ground; empty: none
    turning: bool  # whether the rover turned within the window, so that its slip says little
    # [1] share of the outer wheels' speed that turns it, which the margins are for; NaN in a turn
    # of a rover whose turns are not known: its margins are for driving straight on
    turn: float
    slope: float  # [rad] nose up, measured
    rim_speed: float  # [m/s] commanded speed: what the wheels would do without slip
    slip: float  # [1] measured, mean over the axles; NaN where nothing was
    sinkage: float  # [m] measured, mean over the axles
    speed_limit: float  # [m/s]
    reason: Reason

    @property
    def stop(self) -> bool:
        """Return whether to stop."""
        return self.reason is not Reason.NONE


class Planner:
    """Advise from the last seconds of measurements and the last estimate.

    A recommended stop holds until :meth:`resume`.
    """

    def __init__(
        self,
        table: TractionTable,
        prior_mean: tuple[float, float],
        prior_sd: tuple[float, float],
        config: AdviceConfig,
    ) -> None:
        """Set the prior of (c [Pa], tan phi) for ground that the rover has not seen yet."""
        self._table, self._config = table, config
        even = (1.0,) * table.soils
        self._elsewhere = draw(np.asarray(prior_mean), np.diag(np.asarray(prior_sd) ** 2), even)
        self._recent: deque[Observation] = deque()
        self._standing: Observation | None = None  # the last observation, where the rover stands
        self._belief: Belief | None = None
        self._reason = Reason.NONE
        self._window_ns = round(config.window_s * 1e9)
        if self._speed_limit(known=False) < self._slowest:
            limit = (
                f"{self._speed_limit(known=False):.2g} m/s on unknown ground, too slow to be"
                f" distinguished from standing ({self._slowest:g} m/s)"
            )
            words = "lower one or raise the other, or lower standstill_speed"
            raise ConfigError(f"parameters reaction_time and deceleration allow {limit}: {words}")

    def observe(self, observation: Observation) -> None:
        """Take the measurements of one instant, on the move or standing.

        Without a pitch and a possible velocity they are ignored. So are those in reverse, where the
        rear wheels lead and the slope is the other way.
        """
        rims = np.abs(observation.wheel_rate * self._table.rover.wheel_radius)
        slow = bool(np.isfinite(rims).any() and np.nanmax(rims) <= self._config.standstill_speed)
        slips = bool(np.isfinite(observation.slip).any())
        # on the spot the rates of left and right are averaged to nothing
        idle = abs(observation.yaw_rate) * self._table.half_track <= self._config.standstill_speed
        spot = slow and slips and not idle and self._motion(observation).turns(TURN_LIMIT)
        stands = slow and not spot
        complete = abs(observation.pitch) < math.pi / 2.0 and abs(observation.velocity) <= FASTEST
        self._standing = observation if stands and complete else None
        reverses = not slow and backwards(
            observation, self._table.rover.wheel_radius, self._config.standstill_speed
        )
        if stands or reverses or not complete or not slips:
            return
        self._recent.append(observation)
        oldest = observation.stamp_ns - self._window_ns
        while not oldest < self._recent[0].stamp_ns <= observation.stamp_ns:
            self._recent.popleft()

    def believe(self, belief: Belief) -> None:
        """Take an estimate."""
        self._belief = belief

    def resume(self) -> None:
        """Forget a stop and the measurements that led to it.

        A rover that stands may then creep, and is judged by what it measures.
        """
        self._reason = Reason.NONE
        self._recent.clear()

    def advise(self, stamp_ns: int) -> Advice | None:
        """Return advice at the stamp of the last estimate.

        None before the first estimate, and where nothing was measured within the window of that
        stamp.

        A rover that stands can be judged by its slope alone: it may creep, unless a stop holds.
        """
        reading = self._reading(stamp_ns)
        if self._belief is None or reading is None:
            return None
        here = draw(self._belief.mean, self._belief.covariance, self._belief.soil_probability)
        known = self._belief.identified and not self._belief.disagrees
        doubts = (self._config.slip_limit, self._config.pull_deviation)
        needed = self._table.rover.weight * math.sin(reading.pitch)
        turn = math.nan if reading.turning and not self._table.knows_turns else reading.turn
        under = (
            margins(self._table, here, reading.pitch, *doubts, 0.0 if math.isnan(turn) else turn)
            if known
            else unknown_margins(needed)
        )
        front = self._front(here, reading)
        slip, sinkage = _mean(reading.slip), _mean(reading.sinkage)
        if self._reason is Reason.NONE and reading.moving:
            # Wheels that turn a rover slip as they have to: the inner ones of a skid-steer nearly
            # stand. One that is stuck does not turn.
            slips = not reading.turning and slip > self._config.slip_limit
            self._reason = self._judge(under.stall_probability, front, sinkage, slips=slips)
        return Advice(
            known=known,
            disagrees=self._belief.disagrees,
            moving=reading.moving,
            margins=under,
            turn_limit=(
                turn_limit(self._table, here, reading.pitch, *doubts) if known else NOTHING
            ),
            front_stall_probability=front,
            front_lacks=self._front_lacks(reading),
            turning=reading.turning,
            turn=turn,
            slope=reading.pitch,
            rim_speed=reading.rim_speed,
            slip=slip,
            sinkage=sinkage,
            speed_limit=(
                0.0
                if self._reason
                else self._speed_limit(known=known)
                if reading.moving
                else self._creeping
            ),
            reason=self._reason,
        )

    def _front(self, here: Samples, reading: FrontReading) -> float:
        """Return the probability of being stuck if all wheels were where the front ones are."""
        if self._belief is None or self._front_lacks(reading):
            return math.nan
        changed = max(self._belief.change_probability, NEW_GROUND)
        prior = here.or_else(self._elsewhere, min(changed, 1.0 - NEW_GROUND))
        table = self._table
        samples = front_samples(table, prior, reading)
        return stall_probability(
            table, samples, reading.pitch, self._config.slip_limit, self._config.pull_deviation
        )

    def _front_lacks(self, reading: FrontReading) -> str:
        """Return what is missing to judge the front wheels' ground; empty where nothing is."""
        if not self._table.knows_loads:
            return LOADS
        if self._belief is not None and self._belief.disagrees:
            return "model that fits"
        return reading.front_lacks

    def _judge(self, under: float, front: float, sinkage: float, *, slips: bool) -> Reason:
        config = self._config
        if sinkage > config.sinkage_limit * self._table.rover.wheel_radius:
            return Reason.SINKAGE
        if slips:
            return Reason.SLIP
        if under > config.stop_probability:
            return Reason.TRACTION
        return Reason.FRONT if front > config.stop_probability else Reason.NONE

    def _speed_limit(self, *, known: bool) -> float:
        """Return the speed [m/s] from which the rover can stop on new ground.

        It stops before its second axle reaches the place, or within half of that distance where the
        ground is not known.
        """
        config, axle_x = self._config, self._table.rover.axle_x
        way = (axle_x[0] - axle_x[1]) * (1.0 if known else 0.5)
        return config.deceleration * (
            math.sqrt(config.reaction_s**2 + 2.0 * way / config.deceleration) - config.reaction_s
        )

    @property
    def _slowest(self) -> float:
        """Least speed [m/s] that is distinguished from standing."""
        return 2.0 * self._config.standstill_speed

    @property
    def _creeping(self) -> float:
        """Speed [m/s] for a rover that stands on unknown ground; fast enough to count as moving."""
        return max(0.5 * self._speed_limit(known=False), self._slowest)

    def _reading(self, stamp_ns: int) -> FrontReading | None:
        """Return the measurements within the window of a stamp; None where there are none."""
        recent = [
            entry for entry in self._recent if abs(stamp_ns - entry.stamp_ns) <= self._window_ns
        ]
        if recent:
            moved = [(entry, self._motion(entry)) for entry in recent]
            turning = _most(motion.turns(TURN_LIMIT) for _, motion in moved)
            alike = [each for each in moved if each[1].turns(TURN_LIMIT) == turning]
            sideways = turning or _most(motion.beyond(TURN_LIMIT) for _, motion in alike)
            return self._typical([entry for entry, _ in alike], turning=turning, sideways=sideways)
        if self._standing is None or abs(stamp_ns - self._standing.stamp_ns) > self._window_ns:
            return None
        unknown = np.full(self._table.rover.axles, math.nan)
        return FrontReading(unknown, unknown, unknown, unknown, self._standing.pitch, 0.0)

    def _motion(self, observation: Observation) -> Sideways:
        rims = np.abs(observation.wheel_rate * self._table.rover.wheel_radius).tolist()
        return sideways_of(observation, rims, self._table.rover)

    def _typical(self, recent: list[Observation], *, turning: bool, sideways: bool) -> FrontReading:
        """Return means over time without outliers.

        A stop holds until the operator resumes, so a few absurd readings must not cause one.
        """
        names = ("slip", "sinkage", "torque", "contact_angle", "wheel_rate")
        slip, sinkage, torque, angle, rate = (
            _means(np.array([getattr(entry, name) for entry in recent])) for name in names
        )
        turns = [self._table.turn_of(entry.velocity, entry.yaw_rate) for entry in recent]
        pitch, velocity, turn = _means(
            np.array(
                [
                    (entry.pitch, entry.velocity, share)
                    for entry, share in zip(recent, turns, strict=True)
                ]
            )
        ).tolist()
        rim = self._table.rover.wheel_radius * _mean(rate)
        if math.isnan(rim):
            rim = velocity / max(1.0 - _mean(slip), _LEAST_ROLLING)
        return FrontReading(
            slip, sinkage, torque, angle, pitch, rim, turning, turn if turning else 0.0, sideways
        )


def _most(values: Iterable[bool]) -> bool:
    """Return whether more than half are true."""
    given = list(values)
    return 2 * sum(given) > len(given)


_LEAST_ROLLING = 0.01
"""[1] Least velocity over rim speed, so that the rim speed stays finite at a slip of 1."""


_LARGEST = 1e6
"""[SI] Bound of all measurements of a wheel."""
_FAR = 5.0
"""[robust standard deviations] Distance of an outlier from the median."""


def _means(values: Floats) -> Floats:
    """Return means [n] over time of [time, n] without outliers; NaN where nothing is measured.

    Outliers are found by Hampel's identifier.
    """
    return np.array([_robust_mean(each[np.abs(each) <= _LARGEST]) for each in values.T])


def _robust_mean(values: Floats) -> float:
    if not values.size:
        return math.nan
    away = np.abs(values - np.median(values))
    return float(values[away <= _FAR * 1.4826 * np.median(away)].mean())


def _mean(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else math.nan
