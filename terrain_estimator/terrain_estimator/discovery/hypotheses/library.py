# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The named effects of terramechanics as hypotheses about recorded runs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.hypotheses.rover_doubt import (
    CERTAIN,
    STEP,
    WITHIN,
    RoverDoubt,
    doubts_radius,
    held,
    radius_error,
    rover_with,
)
from terramechanics.effects import EFFECTS, describe
from terramechanics.effects.law import Law
from terramechanics.effects.simulated import SimulatedEffect
from terramechanics.simulation.plant import Plant
from terramechanics.vehicle.rover import Rover

AXLES = 3
"""Number of axles of the rovers that models ship for."""
TYPICAL = {
    "slope_bias": 0.02,
    "bulldozing": 6000.0,
    "drive_drag": 0.2,
    "coulomb_drag": 0.27,
    "payload": 15.0,
    "grousers": 4.0,
    "slip_sinkage": 0.1,
    "multipass": 0.12,
    "odometry_scale": 0.012,
    "failed_wheel": 0.7,
    "sinkage_bias": 0.0025,
    "latency": 0.25,
    "rate_dependence": 0.15,
    "exit_angle": 0.02,
    "contact_law_scm": 1.0,
    "lateral_bulldozing": 1e5,
}
"""Sizes at which the named effects spoil the estimate of the ground on the Mars-like rover.

That of lateral_bulldozing, which no planar rover shows, is a quarter of its range.
"""
NOT_BY_WHEEL = {
    "multipass": "which wheels rolled over the same ground before is not known in a turn",
    "failed_wheel": "it is a law of both wheels of an axle of a planar rover",
    "latency": "its correction keeps slips in the range of a planar rover",
    "contact_law_scm": "this contact law has no forces across the heading of a wheel",
}
"""Effects without a column by wheel, and why."""
ON_REQUEST = frozenset({"contact_law_scm"})
"""Effects that are no candidates beside the others: they are named, or tried where all else fails.

They make a search slow; see ``proof.on_request``.
"""
SOIL_LAWS = (
    "bulldozing", "grousers", "slip_sinkage", "multipass", "rate_dependence", "exit_angle",
    "lateral_bulldozing",
)  # fmt: skip
"""Effects whose law of slip, sinkage or speed is an author's: others have other sizes."""
OTHER_SOIL_LAW, OTHER_LAW = 0.2, 0.05
"""[1] Relative deviation of the size of SOIL_LAWS and of other effects, beside that of the fit.

Where the hidden law was another one, the size at which the named one is closest to it lay 0 to 39 %
and 0 to 6 % from the one that fits best (26 cases of seven effects, drawn for this), but that of
grousers 50 to 170 %: the slip that mobilises them stands in for it.
"""
_START = 0.02
"""[1] Share of its range at which the search for the size of a one-sided effect begins."""
_STEP = 0.001
"""[1] Share of its range by which a size is varied for differences.

A hundredth of the range of sinkage_bias is as much as a wheel sinks into firm sand.
"""


@dataclass(frozen=True, slots=True)
class Shared:
    """The shared unknowns of a hypothesis and their priors; K = sizes and weights together."""

    low: Tensor  # [sizes] physical range
    high: Tensor
    sd: Tensor  # [K] prior deviations, mean zero
    step: tuple[float, ...]  # of differences by each size
    longest: Tensor | None = None  # [K] largest change in one step of a fit; None: any


@dataclass(frozen=True, slots=True)
class LibraryEffect:
    """One effect of the registry, on one axle where it acts on one."""

    name: str
    axle: int | None = None
    competing: int | None = None  # number of a competing law; None: the registry's own
    one_wheel: bool = False  # it is weighed on tables of one wheel

    @property
    def law(self) -> type[Law]:
        """Its law, which has the value of its size and the extra values."""
        described = describe(self.name)
        if self.competing is not None:
            return described.competing[self.competing].law
        return (self.one_wheel and described.of_one_wheel) or described.law

    @property
    def law_name(self) -> str:
        """Name of the law that tells it from those that compete with it."""
        described = describe(self.name)
        if self.competing is not None:
            return described.competing[self.competing].name
        return described.coefficient

    @property
    def unit(self) -> str:
        """Unit of its size."""
        described = describe(self.name)
        if self.competing is not None:
            return described.competing[self.competing].unit
        return described.unit

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest size."""
        described = describe(self.name)
        if self.competing is not None:
            return 0.0, described.competing[self.competing].high
        return described.low, described.high

    @property
    def label(self) -> str:
        """Its name and axle, such as ``failed_wheel (axle 2)``."""
        return self.name if self.axle is None else f"{self.name} (axle {self.axle})"

    @property
    def count(self) -> int:
        """Number of its values."""
        return 1 + len(self.law.extra)

    def on(self, rover: Rover) -> Law:
        """Return its law on a rover."""
        return self.law(rover, self.axle)

    def acting(self, values: Sequence[float]) -> SimulatedEffect:
        """Return the effect with these values for a simulation."""
        return self.with_values(torch.tensor([list(values)], dtype=torch.float64))

    def with_values(self, values: Tensor) -> SimulatedEffect:
        """Return the effect with ``values`` [batch or 1, V] for a simulation."""
        return SimulatedEffect(partial(self.law, axle=self.axle), values)


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """Nothing, one effect or several that act together.

    Its values, which a fit moves, are those of the rover's constants in ``doubt``, then those of
    its effects, one behind the other: of each the value of its size, then the extra ones.
    """

    effects: tuple[LibraryEffect, ...]
    doubt: RoverDoubt = CERTAIN

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)

    @property
    def label(self) -> str:
        """Label such as ``payload + failed_wheel (axle 2)``."""
        return " + ".join(effect.label for effect in self.effects) or "none"

    def laws(self, rover: Rover) -> list[Law]:
        """Return the laws of the effects on a rover."""
        return [effect.on(rover) for effect in self.effects]

    def doubting(self, doubt: RoverDoubt) -> "Hypothesis":
        """Return the same with these constants of the rover in doubt.

        Those that an effect of the hypothesis stands for are held as told.
        """
        return replace(self, doubt=held(doubt, self.names))

    def rover(self, told: Rover, values: Sequence[float]) -> Rover:
        """Return the rover of these values, where ``told`` is the one of the file."""
        return rover_with(told, self.doubt, values[: len(self.doubt)])

    def acting(self, values: Sequence[float]) -> list[SimulatedEffect]:
        """Return the effects with these values for a simulation."""
        rest = iter(values[len(self.doubt) :])
        return [effect.acting([next(rest) for _ in range(effect.count)]) for effect in self.effects]

    def plant(self, values: Sequence[float], told: Rover) -> Plant:
        """Return a plant for the rover of these values, with the effects.

        Its slip is computed by the radius of ``told``, as that of recorded runs.
        """
        effects = self.acting(values)
        if doubts_radius(self.doubt):
            scale = LibraryEffect("odometry_scale")
            wrong = radius_error(told, self.rover(told, values))
            effects.append(scale.acting([wrong, *(0.0 for _ in scale.law.extra)]))
        return Plant(effects)

    def sizes(
        self, values: Sequence[float], deviations: Sequence[float]
    ) -> list[tuple[str, float, float]]:
        """Return name, size and standard deviation of each effect, in the registry's units.

        The deviation counts that the true law may be another one. ``values`` and ``deviations`` are
        those of the shared unknowns, in the order of :meth:`shared`.
        """
        found, at = [], len(self.doubt)
        for effect in self.effects:
            size = effect.law.size_of(values[at])
            spread = abs(effect.law.slope(values[at])) * deviations[at]
            law = OTHER_SOIL_LAW if effect.name in SOIL_LAWS else OTHER_LAW
            found.append((effect.name, size, math.hypot(spread, law * size)))
            at += effect.count
        return found

    def shared(self) -> Shared:
        """Return ranges, priors and steps of differences of the values."""
        # low, high, deviation, step
        bounds: list[tuple[float, float, float, float]] = [(-WITHIN, WITHIN, 1.0, STEP)] * len(
            self.doubt
        )
        for effect in self.effects:
            low, high = (effect.law.value_of(end) if end else 0.0 for end in effect.range)
            # Half of a one-sided range is two deviations from its end, as is half of a two-sided
            # one from its middle.
            bounds.append((low, high, 0.5 * max(abs(low), abs(high)), _STEP * (high - low)))
            bounds += [
                (-4.0 * each.sd, 4.0 * each.sd, each.sd, _STEP * each.sd)
                for each in effect.law.extra
            ]
        table = torch.tensor(bounds, dtype=torch.float64).view(-1, 4)
        return Shared(table[:, 0], table[:, 1], table[:, 2], tuple(table[:, 3].tolist()))

    def typical(self) -> tuple[float, ...]:
        """Return the values of effects of typical size."""
        return (
            *(0.0 for _ in self.doubt),
            *(
                value
                for effect in self.effects
                for value in (
                    effect.law.value_of(TYPICAL[effect.name]),
                    *(0.0 for _ in effect.law.extra),
                )
            ),
        )

    def start(self) -> list[float]:
        """Return the values at which a search begins: 0, or a little inside a one-sided range."""
        values = [0.0 for _ in self.doubt]
        for effect in self.effects:
            low, high = effect.range
            first = effect.law.value_of(_START * high) if low >= 0.0 else 0.0
            values += [first, *(0.0 for _ in effect.law.extra)]
        return values


NOTHING = Hypothesis(())


def testable() -> tuple[str, ...]:
    """Return the names of the effects that a planar rover can show."""
    return tuple(name for name, description in EFFECTS.items() if description.planar)


def singles(names: tuple[str, ...] = (), axles: int = AXLES) -> list[Hypothesis]:
    """Return one hypothesis for each named effect, for each of ``axles`` where it acts on one.

    All effects but those ON_REQUEST where none is named.

    Raises:
        ConfigError: a name is unknown, or not testable with a planar rover.
    """
    found = []
    for name in names or [each for each in testable() if each not in ON_REQUEST]:
        description = describe(name)
        if not description.planar:
            raise ConfigError(
                f"effect {name} is not testable here: it acts sideways, which a planar rover does"
                " not show"
            )
        places: tuple[int | None, ...] = tuple(range(axles)) if description.by_axle else (None,)
        found += [Hypothesis((LibraryEffect(name, place),)) for place in places]
    return found


def singles_by_wheel(names: tuple[str, ...] = ()) -> list[Hypothesis]:
    """Return one hypothesis for each named effect that has a column by wheel, by default all.

    Raises:
        ConfigError: a name is unknown, or has none.
    """
    for name in names:
        if describe(name).name in NOT_BY_WHEEL:
            raise ConfigError(
                f"effect {name} is not testable by wheel: {NOT_BY_WHEEL[name]}: leave it out of"
                " --library, or give a model by axle"
            )
    known = [each for each in EFFECTS if each not in NOT_BY_WHEEL]
    return [Hypothesis((LibraryEffect(name),)) for name in names or known]


def together(first: Hypothesis, second: Hypothesis) -> Hypothesis:
    """Return the hypothesis of both at once; both have the same constants in doubt."""
    pairs = zip(first.doubt, second.doubt, strict=True)
    doubt = tuple(max(pair, key=lambda each: each.sd) for pair in pairs)  # held by neither
    return Hypothesis(first.effects + second.effects).doubting(doubt)
