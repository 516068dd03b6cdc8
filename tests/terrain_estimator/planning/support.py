# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One table for all tests of the planner, and measurements whose truth is known."""

from functools import cache

import numpy as np
import torch

from terrain_estimator.learning.observing import observations_of
from terrain_estimator.model.metadata import MODELS, read_metadata
from terrain_estimator.observation import Observation
from terrain_estimator.planning.belief import Belief
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.table import TractionTable
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Drive
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

ROVER = load_rover("mars_rover")
SOIL = load_soil("loose_sand")
METADATA = read_metadata(MODELS / "mars_rover.json")
FIRM, SOFT = (3000.0, 0.75), (500.0, 0.3)
"""c [Pa] and tan phi of ground that holds the rover, and of ground that does not."""
BORDER_M = 1.5


@cache
def table() -> TractionTable:
    """Return the statics of the rover on loose sand alone: a third of the work."""
    return TractionTable(ROVER, solve_statics(ROVER, (SOIL,)))


def belief(
    strength: tuple[float, float],
    sd: tuple[float, float] = (200.0, 0.03),
    *,
    identified: bool = True,
    changed: float = 0.0,
    disagrees: bool = False,
) -> Belief:
    """Return a belief in a ground."""
    covariance = np.diag(np.array(sd) ** 2)
    return Belief(np.array(strength), covariance, (1.0,), identified, changed, disagrees)


@cache
def simulated() -> Drive:
    """Return a level drive from firm onto soft ground."""
    constants = SOIL.constants()
    firm, soft = (torch.tensor(strength, dtype=torch.float64) for strength in (FIRM, SOFT))
    ground = Ground(
        [Patch(constants, firm, name="firm"), Patch(constants, soft, BORDER_M, name="soft")]
    )
    return simulate(ROVER, ground, "S1", 35.0, torch.Generator().manual_seed(1), 1, "flat")


@cache
def drive() -> tuple[list[Observation], list[int]]:
    """Return its measurements, and the number of axles on the soft ground."""
    sample = simulated().sample
    measured = measure_drive(ROVER, sample, Noise(), torch.Generator().manual_seed(2))
    return observations_of(measured, 0), (sample.contact[0] >= BORDER_M).sum(-1).tolist()


def drive_gets_stuck() -> bool:
    """Return whether the drive ends stuck."""
    return bool(simulated().sample.stuck[0, -1])
