# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The library of named effects as hypotheses; what each one is comes from the registry of terramechanics, one definition."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.hypotheses.parts import Part
from terrain_estimator.discovery.hypotheses.point import Shared
from terramechanics.effects import EFFECTS, describe

AXLES = 3
TYPICAL = {
    "slope_bias": 0.02, "bulldozing": 6000.0, "drive_drag": 0.2, "coulomb_drag": 0.27, "payload": 15.0, "grousers": 4.0,
    "slip_sinkage": 0.1, "multipass": 0.12, "odometry_scale": 0.012, "failed_wheel": 0.7, "sinkage_bias": 0.0025, "latency": 0.25,
    "rate_dependence": 0.15, "exit_angle": 0.02,
}  # fmt: skip
"""Sizes at which the named effects spoil the estimate of the ground on the Mars-like rover."""
SOIL_LAWS = ("bulldozing", "grousers", "slip_sinkage", "multipass", "rate_dependence", "exit_angle")
"""Effects whose law of slip, sinkage or speed is an author's: another one fits the same ground with another size."""
OTHER_SOIL_LAW, OTHER_LAW = 0.2, 0.05
"""[1] Relative deviation of the size of SOIL_LAWS and of other effects, beside what the fit leaves open. Where the hidden law was
another one, the size at which the named one is closest to it lay 0 to 39 % and 0 to 6 % from the
one that fits best (26 cases of seven effects, drawn for this), but that of grousers 50 to 170 %:
the slip that mobilises them stands in for it."""
_START = 0.02
"""[1] Share of its range at which the search for the size of a one-sided effect begins."""
_STEP = 0.01
"""[1] Share of its range by which a size is varied for differences."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """Nothing, one effect or several that act together."""

    parts: tuple[Part, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(part.name for part in self.parts)

    @property
    def label(self) -> str:
        """Such as ``payload + failed_wheel (axle 2)``."""
        words = [
            part.name if part.axle is None else f"{part.name} (axle {part.axle})"
            for part in self.parts
        ]
        return " + ".join(words) or "none"

    def sizes(
        self, values: Sequence[float], deviations: Sequence[float]
    ) -> list[tuple[str, float, float]]:
        """Name, size and standard deviation of each effect, in the units of the registry; that its law is another one is counted.

        ``values`` and ``deviations`` are those of the shared unknowns, in the order of
        :meth:`shared`.
        """
        found, at = [], 0
        for part in self.parts:
            size, spread = part.size(values[at]), abs(part.slope(values[at])) * deviations[at]
            law = OTHER_SOIL_LAW if part.name in SOIL_LAWS else OTHER_LAW
            found.append((part.name, size, math.hypot(spread, law * size)))
            at += 1 + len(part.beside)
        return found

    def shared(self) -> Shared:
        """Ranges, priors and differences of the sizes, in the values that the fit moves (see ``Part.size``)."""
        bounds: list[tuple[float, float, float, float]] = []  # low, high, deviation, step
        for part in self.parts:
            low, high = (
                part.value(end) if end else 0.0
                for end in (describe(part.name).low, describe(part.name).high)
            )
            # Half of a one-sided range is two deviations from its end, as is half of a two-sided
            # one from its middle.
            bounds.append((low, high, 0.5 * max(abs(low), abs(high)), _STEP * (high - low)))
            bounds += [
                (-4.0 * each.sd, 4.0 * each.sd, each.sd, _STEP * each.sd) for each in part.beside
            ]
        table = torch.tensor(bounds, dtype=torch.float64).view(-1, 4)
        return Shared(table[:, 0], table[:, 1], table[:, 2], tuple(table[:, 3].tolist()))

    def typical(self) -> tuple[float, ...]:
        """Values of effects of typical size, in those that the fit moves."""
        return tuple(
            value
            for part in self.parts
            for value in (part.value(TYPICAL[part.name]), *(0.0 for _ in part.beside))
        )

    def start(self) -> list[float]:
        """Values at which the search begins: 0, or a little inside of a one-sided range."""
        values = []
        for part in self.parts:
            described = describe(part.name)
            values += [part.value(_START * described.high) if described.low >= 0.0 else 0.0] + [
                0.0
            ] * len(part.beside)
        return values


NOTHING = Hypothesis(())


def testable() -> tuple[str, ...]:
    """Names of the effects that a planar rover can show."""
    return tuple(name for name, description in EFFECTS.items() if description.make is not None)


def singles(names: tuple[str, ...] = ()) -> list[Hypothesis]:
    """One hypothesis for each named effect, one for each axle where it acts on one; all effects where none is named.

    Raises:
        ConfigError: a name is unknown, or not testable with a planar rover.
    """
    found = []
    for name in names or testable():
        description = describe(name)
        if description.make is None:
            raise ConfigError(
                f"effect {name} is not testable here: it acts sideways, which a planar rover does"
                " not show"
            )
        axles: tuple[int | None, ...] = tuple(range(AXLES)) if description.by_axle else (None,)
        found += [Hypothesis((Part(name, axle),)) for axle in axles]
    return found


def together(first: Hypothesis, second: Hypothesis) -> Hypothesis:
    """Both at once."""
    return Hypothesis(first.parts + second.parts)
