# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Endless observations of drives with faulty sensors and clocks."""

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Observation
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from tests.terrain_estimator.drives import drive_observations

DRIVE_S = 10.0
STEP_NS = 100_000_000
LATEST_NS = (2**31 - 1) * 10**9  # what a stamp of ROS holds
MONSTERS = (math.nan, math.inf, 0.0, 5e-324, 2.2e-308, 1e-160, 1e-12, 1e12, 1e150, 1e300, 1.797e308)
"""Extreme values, each with either sign."""


@dataclass(frozen=True, slots=True)
class FaultRates:
    """Rates of the sensors' faults for a while."""

    monsters: float  # share of the observations with values out of every range
    random: (
        float  # share of the observations whose values are all random, within or near their range
    )
    scaled: float  # share of the observations with values that are wrong by orders of magnitude
    clock: float  # share of the stamps that jump

    @classmethod
    def drawn(cls, generator: np.random.Generator) -> "FaultRates":
        """Draw a mood from sound to very faulty."""
        monsters, random, scaled = generator.choice(
            [0.0, 0.01, 0.3, 1.0], p=[0.4, 0.2, 0.3, 0.1], size=3
        ).tolist()
        return cls(monsters, random, scaled, clock=float(generator.choice([0.0, 0.01, 0.3])))


class FaultyObservations:
    """Endless observations of one rover, the same for the same seed."""

    def __init__(self, rover: Rover, soil: Soil, seed: int, longest: int = 200) -> None:
        """Prepare the drive; ``longest`` is the most observations of a mood."""
        self._rover = rover
        self._drive = drive_observations(rover, soil, DRIVE_S, seed)
        self._longest = longest
        self._generator = np.random.default_rng(seed)

    def observations(self) -> Iterator[Observation]:
        """Yield observations in one mood after the other."""
        stamp = 10**9
        while True:
            mood = FaultRates.drawn(self._generator)
            for _ in range(self._generator.integers(self._longest // 10, self._longest)):
                stamp = self._next_stamp(stamp, mood)
                yield dataclasses.replace(self._observation(mood), stamp_ns=stamp)

    def _observation(self, mood: FaultRates) -> Observation:
        draw = self._generator.random(3)
        observation = self._drive[self._generator.integers(len(self._drive))]
        if draw[0] < mood.random:
            observation = self._random()
        if draw[1] < mood.scaled:
            observation = self._spoilt(
                observation, lambda value: value * 10.0 ** self._generator.uniform(-12.0, 12.0)
            )
        if draw[2] < mood.monsters:
            observation = self._spoilt(
                observation,
                lambda _: self._generator.choice(MONSTERS) * self._generator.choice([-1.0, 1.0]),
            )
        return observation

    def _random(self) -> Observation:
        """Replace every value by one within or near its range, inconsistent with the others."""
        uniform, axles, radius = (
            self._generator.uniform,
            self._rover.axles,
            self._rover.wheel_radius,
        )
        deviation = 10.0 ** uniform(-9.0, 2.0, (7, axles))
        return Observation(
            stamp_ns=0,
            slip=uniform(-1.1, 1.1, axles),
            slip_sd=deviation[0],
            sinkage=uniform(-0.1, 1.1, axles) * radius,
            sinkage_sd=deviation[1],
            contact_angle=uniform(-1.6, 1.6, axles),
            contact_angle_sd=deviation[2],
            wheel_rate=uniform(-20.0, 20.0, axles),
            torque=uniform(-1e3, 1e3, axles),
            torque_sd=deviation[3],
            velocity=uniform(-2.0, 2.0),
            velocity_sd=float(deviation[4, 0]),
            pitch=uniform(-1.6, 1.6),
            pitch_sd=float(deviation[5, 0]),
            acceleration=uniform(-50.0, 50.0),
            acceleration_sd=float(deviation[6, 0]),
            bogie_angle=uniform(-1.3, 1.3),
        )

    def _spoilt(self, observation: Observation, change: Any) -> Observation:
        """Change one to four values, of all wheels or of one."""
        changes: dict[str, Any] = {}
        for name in self._generator.choice(
            [*AXLE_FIELDS, *SCALAR_FIELDS], size=self._generator.integers(1, 5)
        ):
            value = getattr(observation, name)
            if name in SCALAR_FIELDS:
                changes[name] = float(change(value))
                continue
            axles = (
                slice(None)
                if self._generator.random() < 0.5
                else self._generator.integers(len(value))
            )
            changes[name] = value.copy()
            changes[name][axles] = change(value[axles])
        return dataclasses.replace(observation, **changes)

    def _next_stamp(self, stamp: int, mood: FaultRates) -> int:
        if self._generator.random() >= mood.clock:
            return min(stamp + STEP_NS, LATEST_NS)
        jumps = (
            0,
            1,
            -STEP_NS,
            3 * STEP_NS,
            60 * 10**9,
            -3600 * 10**9,
            10**16,
            int(self._generator.integers(LATEST_NS)) - stamp,
        )
        return int(np.clip(stamp + jumps[self._generator.integers(len(jumps))], 0, LATEST_NS))
