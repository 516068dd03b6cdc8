# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated tables of HIT's smooth rim: do the intervals of c and tan phi hold the truth?"""

import math
from dataclasses import dataclass

import numpy as np
import torch

from studies.measured.cases import HIT
from terrain_estimator.discovery.hypotheses.library import NOTHING, LibraryEffect
from terrain_estimator.discovery.single_wheel.cells import ROWS, Rig, Row, cells_of
from terrain_estimator.discovery.single_wheel.free_law import FreeLaw
from terrain_estimator.discovery.single_wheel.law_fits import Interval, constants_measured

SLIPS, LOAD_N, RATE_RAD_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.6), 80.0, 0.1
COHESION_PA, TAN_PHI = (0.0, 3000.0), (0.35, 0.85)
"""Ranges of the truth."""


@dataclass(frozen=True, slots=True)
class Kind:
    """How the world differs from the law that is fitted to it."""

    name: str
    effect: str = ""
    size: float = 0.0
    factor: float = 1.0  # [1] K over the one that is stated


WORLDS = (
    Kind("the law, its constants off as stated"),
    Kind("slip_sinkage of 0.5, not modelled", "slip_sinkage", 0.5),
    Kind("grousers of 10 N, not modelled", "grousers", 10.0),
    Kind("K an eighth of the measured one", factor=0.125),
)


@dataclass(frozen=True, slots=True)
class World:
    """Intervals of some tables of one kind."""

    name: str
    tables: int
    cohesion_covered: int
    tan_phi_covered: int
    cohesion_width_pa: float  # median
    tan_phi_width: float


def world(kind: Kind, tables: int, seed: int) -> World:
    """Return how often the intervals hold the truth in one kind of world."""
    bed, generator = HIT.bed(), np.random.default_rng(seed)
    found: list[tuple[bool, bool, float, float]] = []
    with torch.inference_mode():
        for each in range(tables):
            truth, rows = _table(bed, kind, generator)
            law = FreeLaw(bed, NOTHING, NOTHING)
            soil = constants_measured(law, cells_of(rows), seed + each)
            found.append(
                (
                    _holds(soil.cohesion_pa, truth[0]),
                    _holds(soil.tan_phi, truth[1]),
                    soil.cohesion_pa[2] - soil.cohesion_pa[0],
                    soil.tan_phi[2] - soil.tan_phi[0],
                )
            )
    covered = np.array([each[:2] for each in found]).sum(0).tolist()
    widths = np.median([each[2:] for each in found], 0).tolist()
    return World(kind.name, tables, *covered, *widths)


def _table(
    bed: Rig, kind: Kind, generator: np.random.Generator
) -> tuple[tuple[float, float], list[Row]]:
    """Return c [Pa] and tan phi, and a table with errors as stated."""
    truth = generator.uniform(*COHESION_PA), generator.uniform(*TAN_PHI)
    soil, draws = bed.soil, generator.standard_normal(5) * np.array(bed.constants_sd)
    constants = torch.tensor(
        [
            soil.n * math.exp(draws[0]),
            soil.k_c * math.exp(draws[1]),
            soil.k_phi * math.exp(draws[1]),
            soil.shear_modulus * kind.factor * math.exp(draws[2]),
            min(max(soil.c1 * (1.0 + draws[3]), 0.01), 0.8),
            min(max(soil.c2 * (1.0 + draws[4]), -0.5), 0.3),
        ],
        dtype=torch.float64,
    )
    read = [Row("t", "1", slip, LOAD_N, RATE_RAD_S, 0.01, 0.0, torque=0.0) for slip in SLIPS]
    true = [
        Row("t", "1", slip, LOAD_N, RATE_RAD_S, 0.01, 0.0, torque=0.0)
        for slip in np.array(SLIPS) + bed.slip_sd * generator.standard_normal(len(SLIPS))
    ]
    # the law of tables: that of drives grows with the load of a rover
    acting = LibraryEffect(kind.effect, one_wheel=True) if kind.effect else None
    effects = [acting.acting([kind.size, *[0.0] * (acting.count - 1)])] if acting else []
    strength = torch.tensor([truth], dtype=torch.float64)
    states = bed.states(cells_of(true), strength, constants.unsqueeze(0), effects)[0].numpy()
    states = states + np.array(bed.deviations) * generator.standard_normal(states.shape)
    states = states + np.array(bed.offset_sd) * generator.standard_normal(len(ROWS))
    return truth, [
        Row(
            *("t", "1", row.slip, LOAD_N, RATE_RAD_S),
            sinkage=float(state[0]),
            drawbar_pull=float(state[1]),
            torque=float(state[3]),
        )
        for row, state in zip(read, states, strict=True)
    ]


def _holds(interval: Interval, value: float) -> bool:
    return interval[0] <= value <= interval[2]
