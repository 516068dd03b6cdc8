# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives in a world, through the node's estimator with default parameters."""

import dataclasses
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from studies.physics import physics_model
from studies.robustness.worlds import (
    SECONDS,
    World,
    measured,
    rover_near,
    unknown_ground,
    varying_ground,
)
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.learning.tasks import SOILS, random_ground
from terrain_estimator.messaging.averaging import Averager, averaged
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.report import Report
from terrain_estimator.model.runtime import Runtime, RuntimeState
from terrain_estimator.observation import Observation
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import Plant
from terramechanics.simulation.simulation import simulate
from terramechanics.vehicle.rover import Rover
from tests.hidden.cases import drive_ends
from tests.hidden.generators import GENERATORS, Draw, sizes_of
from tests.hidden.ground import uniform

Record = dict[str, NDArray[Any]]
"""What was published in N drives:

``truth``, ``mean``, ``deviation`` [N, 2] of c [Pa] and tan phi at the end; ``inside`` [N, 2] 1
where the last 95 % interval holds the truth; ``status`` [N] the last one; ``wrong`` [N] the share
of answers that were IDENTIFIED with a parameter outside its interval; ``excess`` [N] see
:func:`excess_of`; ``seconds`` [N] that were closed.
"""
ROVER = "mars_rover"
WINDOW_S = 10.0
"""[s] Of driving, over which the design asks for an excess of 20 where an effect can be seen."""


def drive_batch(world: World, drives: int, seed: int) -> Record:
    """Return the record of a batch of drives over hills; the same seed draws the same ground."""
    drawing, hiding = (torch.Generator().manual_seed(2 * seed + k) for k in range(2))
    ground = random_ground(load_soil(world.soil or SOILS[0]), drives, drawing)
    if not world.soil:
        ground = unknown_ground(ground.patches[0].strength, hiding)
    mean = ground.patches[0]
    model = _model(world, hiding)
    rover = rover_near(model.rover, hiding) if world.rover else model.rover
    if world.variation:
        length = SECONDS * max(rover.cruise_speed) + rover.axle_x[0] - rover.axle_x[-1]
        ground = varying_ground(mean, world.variation, length, hiding)
    plant, step_s = _plant(world, rover, drives, hiding), 1.0 / world.rate_hz
    drive = simulate(rover, ground, "S1", SECONDS, drawing, drives, plant=plant, time_step=step_s)
    readings = measured(world, rover, drive.seen, hiding)
    ends = drive_ends(drive, step_s).tolist()
    truth = mean.strength.numpy()
    every = (observations_of(readings, k, round(1e9 * step_s))[: ends[k]] for k in range(drives))
    return joined(_published(model, seen, truth[k]) for k, seen in enumerate(every))


def _model(world: World, generator: torch.Generator) -> LoadedModel:
    """Return the model that ships, or one for a rover near a preset or for varying ground."""
    if not (world.near or world.told_variation):
        return load(ROVER, AUTO).model
    rover, soils = load_rover(world.near or ROVER), [load_soil(world.soil)]
    if world.near:
        rover = rover_near(rover, generator)
    else:
        soils = [load_soil(soil) for soil in SOILS]  # as the model that ships
    with tempfile.TemporaryDirectory() as folder:
        return physics_model(rover, soils, Path(folder) / "own.pt", world.told_variation)


def _plant(world: World, rover: Rover, drives: int, generator: torch.Generator) -> Plant | None:
    if not world.parts:
        return None
    axle = torch.randint(rover.axles, (drives,), generator=generator)
    place = uniform((2.0, 5.0), (drives,), generator)
    effects = []
    for name, share in world.parts:
        sizes = sizes_of(GENERATORS[name], share, drives, generator)
        effects.append(GENERATORS[name].make(Draw(sizes, axle, place)))
    return Plant(effects)


def joined(parts: Any) -> Record:  # noqa: ANN401 - any iterable of records
    """Return the drives of all parts."""
    every = list(parts)
    return {name: np.concatenate([part[name] for part in every]) for name in every[0]}


def _published(
    model: LoadedModel, observations: Sequence[Observation], truth: NDArray[np.float64]
) -> Record:
    core = CoreConfig()
    noted = Noted(model.runtime)
    estimator = Estimator(dataclasses.replace(model, runtime=noted), core)
    rows, averager = usable_rows(model.rows, core), Averager(model.rover, core)
    wrong, answers, status, estimate = 0, 0, Status.PRIOR_ONLY, None
    readings = (Conversion(each.stamp_ns, each) for each in observations)
    for taken in averaged(readings, averager):
        assert taken.observation is not None  # what is simulated can be used
        update = estimator.update(taken.observation)
        estimate, status = update.estimate, status_of(update, rows)
        inside = (estimate.lower_95 <= truth) & (truth <= estimate.upper_95)
        wrong += status is Status.IDENTIFIED and not inside.all()
        answers += 1
    assert estimate is not None
    values = {
        "truth": truth,
        "mean": estimate.mean,
        "deviation": np.sqrt(np.diag(estimate.covariance)),
        "inside": (estimate.lower_95 <= truth) & (truth <= estimate.upper_95),
        "status": int(status),
        "wrong": wrong / answers,
        "excess": excess_of(noted.misfits, noted.degrees),
        "seconds": len(noted.misfits),
    }
    return {name: np.asarray(value, np.float64)[np.newaxis] for name, value in values.items()}


class Noted:
    """A runtime that notes by how much each closed second misses the model."""

    def __init__(self, runtime: Runtime) -> None:
        """Run ``runtime``."""
        self._runtime = runtime
        self.misfits: list[float] = []
        self.degrees: list[float] = []

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any method of a runtime
        return getattr(self._runtime, name)

    def report(self, state: RuntimeState) -> Report:
        """Return the report of the last update."""
        report = self._runtime.report(state)
        if report.closed:
            self.misfits.append(report.misfit)
            self.degrees.append(report.degrees)
        return report


def excess_of(misfits: Sequence[float], degrees: Sequence[float]) -> float:
    """Return by how much the squared distances of 10 s exceed their degrees of freedom [1].

    The mean over a drive's closed seconds estimates the non-centrality that what is hidden leaves
    in the rows beside c and tan phi; NaN without a closed second.
    """
    if not misfits:
        return math.nan
    return WINDOW_S * float(np.mean(np.subtract(misfits, degrees)))
