# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden cases to draw: families of plans and their numbers, in an order that can end anywhere."""

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tests.hidden.cases import ROVERS, TERRAINS, Plan
from tests.hidden.constants import NAMES, draw_constants
from tests.hidden.generators import GENERATORS

KNOWN = tuple(name for name, effect in GENERATORS.items() if effect.known)
OUTSIDE = tuple(name for name, effect in GENERATORS.items() if not effect.known)
PAIRS = (
    ("payload", "drive_drag"),
    ("slope_bias", "slip_sinkage"),
    ("multipass", "odometry_scale"),
    ("bulldozing", "coulomb_drag"),
    ("latency", "exit_angle"),
    ("sinkage_bias", "failed_wheel"),
)
"""Two effects at once that act in different places."""
WITHOUT_TORQUE = ("slope_bias", "payload", "multipass", "odometry_scale", "latency", "exit_angle")
NOISE_TIME = 0.3
"""[s] Time constant of correlated noise: three samples."""
TOGETHER = 4
"""Cases that are simulated together: each soil on two terrains, one of them hills.

The next four are on the other two terrains.
"""
SEED = 65_000
"""Seed of the hidden cases; calibration has other seeds. Cases of 64_000 were inspected."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Cases that are drawn from ``plan`` and ``seed``."""

    family: str
    plan: Plan
    seed: int
    first: int  # place of the first of them among soils and terrains
    count: int = TOGETHER
    untold: bool = False  # whether the deviations of the rover's constants are kept back

    @property
    def keys(self) -> list[str]:
        """Keys of the records."""
        name = "+".join(name for name, _ in self.plan.parts) or self.plan.beyond or "none"
        return [f"{self.family}/{name}/{self.seed}/{number}" for number in range(self.count)]


def families() -> dict[str, tuple[list[Plan], int, int]]:
    """Return for each family its plans, and the cases of each in the sample and in the whole."""
    return {
        "none": ([Plan()], 200, 600),
        "matters": ([Plan(((name, 1.0),)) for name in KNOWN], 8, 40),
        "third": ([Plan(((name, 1.0 / 3.0),)) for name in KNOWN], 4, 16),
        "tenth": ([Plan(((name, 0.1),)) for name in KNOWN], 4, 16),
        "outside": ([Plan(((name, 1.0),)) for name in OUTSIDE], 8, 40),
        "two": ([Plan(((first, 1.0), (second, 1.0))) for first, second in PAIRS], 4, 16),
        "none, no torque": ([Plan(torque=False)], 12, 100),
        "matters, no torque": (
            [Plan(((name, 1.0),), torque=False) for name in WITHOUT_TORQUE],
            4,
            16,
        ),
        "none, correlated noise": ([Plan(noise_time=NOISE_TIME)], 12, 100),
        "matters, correlated noise": (
            [Plan(((name, 1.0),), noise_time=NOISE_TIME) for name in KNOWN],
            4,
            16,
        ),
    }


FIELD_SOILS = ("loose_sand", "regolith", "compact_sand")
NEIGHBOUR = {"loose_sand": "regolith", "regolith": "loose_sand", "compact_sand": "loose_sand"}
"""The soil that is told in a third of the cases of the field, instead of the true one."""
BETWEEN = (0.3, 0.7)
"""[1] Share of the way to the soil that is told, in cases whose ground has no file."""
LEAST_NOISE, MOST_NOISE = 0.5, 2.0
"""[1] Deviation of the noise over the stated one, in another third."""


NO_FILE = "no file, one effect or nothing"


def field_families() -> dict[str, tuple[list[Plan], int]]:
    """Return the families of cases whose conditions are drawn, and the cases of each plan.

    The ground of NO_FILE is that of no soil file: they stand beside the bars of the others.
    """
    return {
        "field, nothing": ([Plan()], 120),
        "field, one effect": ([Plan(((name, None),)) for name in KNOWN], 20),
        "field, outside": ([Plan(((name, None),)) for name in OUTSIDE], 12),
        "field, two effects": (
            [Plan(((first, None), (second, None))) for first, second in PAIRS],
            8,
        ),
        NO_FILE: ([Plan(), *(Plan(((name, None),)) for name in KNOWN)], 4),
    }


def field_batches(frozen: str) -> list[Batch]:
    """Return the cases of the field: rover, soil, what is told of it and noise are drawn.

    Each case has conditions of its own, so that any first part is a sample of all conditions.
    ``frozen`` is the commit that froze the rule of the verdict: its first eight digits are the
    seed, so that nobody could look at the cases before.
    """
    seed = int(frozen[:8], 16)
    drawn = random.Random(seed)
    families = {}
    for family, (plans, cases) in field_families().items():
        families[family] = [
            Batch(
                family,
                _condition(plan, drawn, has_file=family != NO_FILE),
                seed % 1_000_000_000 + turn,
                drawn.randrange(len(FIELD_SOILS) * len(TERRAINS)),
                count=1,
            )
            for turn in range(cases)
            for plan in plans
        ]
    return _in_step(list(families.values()))


NOTHING = "nothing hidden, all told rightly"
_NOTHING_CASES = 400


def nothing_batches(frozen: str) -> list[Batch]:
    """Return cases in which nothing is hidden: rover and soil are drawn, and told rightly.

    They stand beside the cases of the field; ``frozen`` as there.
    """
    seed = int(frozen[:8], 16)
    drawn = random.Random(f"nothing {seed}")  # a stream of its own
    return [
        Batch(
            NOTHING,
            Plan(soil=drawn.choice(FIELD_SOILS), rover=drawn.choice(sorted(ROVERS))),
            seed % 1_000_000_000 + turn,
            drawn.randrange(len(FIELD_SOILS) * len(TERRAINS)),
            count=1,
        )
        for turn in range(_NOTHING_CASES)
    ]


ROVER_NOTHING, ROVER_BEYOND = "rover, nothing", "rover, beyond its deviation"
ROVER_ONE, ROVER_OUTSIDE = "rover, one effect", "rover, outside"
UNTOLD = " (untold)"
"""End of a family's name where the deviations of the rover's constants are kept back."""


def rover_families() -> dict[str, tuple[list[tuple[Plan, str]], int]]:
    """Return the families of cases whose rover is not that of its file, and the cases of each plan.

    A plan stands with the constant that is beyond its stated deviation, empty for none.
    """
    return {
        ROVER_NOTHING: ([(Plan(), "")], 60),
        ROVER_BEYOND: ([(Plan(), name) for name in NAMES], 20),
        ROVER_ONE: ([(Plan(((name, None),)), "") for name in KNOWN], 6),
        ROVER_OUTSIDE: ([(Plan(((name, None),)), "") for name in OUTSIDE], 3),
    }


def rover_batches(frozen: str, *, untold: bool = False) -> list[Batch]:
    """Return the cases whose rover is not that of its file, under the conditions of the field.

    ``frozen`` is the commit that froze their rule; its first eight digits are the seed. ``untold``
    keeps the deviations back, of the same cases.
    """
    seed = int(frozen[:8], 16)
    drawn = random.Random(seed)
    families = []
    for family, (plans, cases) in rover_families().items():
        found = []
        for turn in range(cases):
            for plan, off in plans:
                there = _condition(plan, drawn, has_file=True)
                assert there.file is not None
                stated, errors = draw_constants(there.file, drawn, off)
                first = drawn.randrange(len(FIELD_SOILS) * len(TERRAINS))
                drive = replace(there, stated=stated, off=errors)
                name = f"{family}{UNTOLD}" if untold else family
                found.append(
                    Batch(name, drive, seed % 1_000_000_000 + turn, first, 1, untold=untold)
                )
        families.append(found)
    return _in_step(families)


def _condition(plan: Plan, drawn: random.Random, *, has_file: bool) -> Plan:
    soil = drawn.choice(FIELD_SOILS)
    wrong, noisy = drawn.random() < 1.0 / 3.0, drawn.random() < 1.0 / 3.0
    power = drawn.uniform(math.log(LEAST_NOISE), math.log(MOST_NOISE))
    return replace(
        plan,
        soil=soil,
        told=NEIGHBOUR[soil] if wrong or not has_file else "",
        noise=math.exp(power) if noisy else 1.0,
        rover=drawn.choice(sorted(ROVERS)),
        between=0.0 if has_file else drawn.uniform(*BETWEEN),
    )


def _in_step(families: Sequence[Sequence[Batch]]) -> list[Batch]:
    """Return all batches; families advance in step, so any first part samples every family."""
    placed = [
        ((place + 0.5) / len(turns), each) for turns in families for place, each in enumerate(turns)
    ]
    return [each for _, each in sorted(placed, key=lambda each: each[0])]


def batches(*, whole: bool) -> list[Batch]:
    """Return the batches of the families whose conditions are set."""
    found = []
    for family, (plans, few, many) in families().items():
        count = (many if whole else few) // TOGETHER
        found.append(
            [
                Batch(family, plan, SEED + batch, TOGETHER * (batch + turn))
                for batch in range(count)
                for turn, plan in enumerate(plans)
            ]
        )
    return _in_step(found)
