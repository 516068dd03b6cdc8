# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The node's estimator, drive by drive: default parameters, screening and gates, compiled.

Its published values are compared with the truth: mean and intervals of c and tan phi, the predicted
velocity with the measured one, and the most probable soil with the one that is there.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from studies.accuracy.scores import FROM_PRIOR, observation_times, row_mask
from studies.bound import Known, cramer_rao_at
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.learning.tasks import Tasks, measure_tasks, random_ground
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.outcome import Outcome
from terramechanics.presets import load_soil
from terramechanics.simulation.sample import Measurement
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.soil import Soil

EVERY_ROW = "all"
CONFIGS = {
    "v+L": CoreConfig(use_torque=False, use_moments=False, use_imu=False),
    "v+L+M": CoreConfig(use_moments=False, use_imu=False),
    EVERY_ROW: CoreConfig(),
}
"""The estimator's parameters by the rows that it gets; the last has the accelerometer's, too."""


class Driven(NamedTuple):
    """Simulated drives of N rovers, what was measured, and what is true."""

    measured: Measurement
    tasks: Tasks  # another draw of the noise; for the bound, which takes what is true
    ends: Tensor  # [N] observations before the first stuck one
    truth: NDArray[np.float64]  # [N, 2] c [Pa], tan phi
    constants: Tensor  # [N, 6] of the soil


@dataclass(frozen=True, slots=True)
class Streamed:
    """Results of N drives of T observations at K times; NaN after a drive's end."""

    truth: NDArray[np.float64]  # [N, 2] c [Pa], tan phi
    mean: NDArray[np.float64]  # [N, K, 2] last published
    deviation: NDArray[np.float64]  # [N, K, 2]
    inside_95: NDArray[np.float64]  # [N, K, 2] 1 where the last published interval holds the truth
    identified: NDArray[np.float64]  # [N, K, 2] 1 where the last status is identified
    published: NDArray[np.float64]  # [N] 1 where a second was taken before the end
    least: NDArray[np.float64]  # [N, K, 2] deviation of the Cramer-Rao bound
    innovation: NDArray[np.float64]  # [N, T] measured velocity less the predicted one [m/s]
    variance: NDArray[np.float64]  # [N, T] its predicted variance [m^2/s^2]
    soil_probability: NDArray[np.float64]  # [N, T] of the most probable soil
    soil_right: NDArray[np.float64]  # [N, T] 1 where it is the one that is there
    refused: NDArray[np.float64]  # [N] observations that were not used
    observations: NDArray[np.float64]  # [N]


def stream_cell(
    rover: str,
    soil: str,
    spread: float,
    drives: int,
    seed: int,
    times_s: Sequence[float],
    rows: Sequence[str] = (EVERY_ROW,),
    *,
    bound: bool = True,
) -> dict[str, Streamed]:
    """Return what the model of a rover that ships makes of drives with each set of ``rows``.

    The drives are over hills and last until the last of ``times_s`` [s]. Truth is from the prior,
    above zero; soil constants are wrong by up to ``spread`` [1]. A drive ends before its first
    stuck observation. The same seed gives the same drives. Without ``bound`` that is NaN.
    """
    model, ground = load(rover, AUTO).model, load_soil(soil)
    driven = _drive(model, ground, spread, drives, seed, times_s[-1])
    least: Mapping[str, NDArray[np.float64]] = dict.fromkeys(
        rows, np.full((drives, len(times_s), 2), np.nan)
    )
    if bound:
        least = _least(model, ground, spread, driven, times_s, rows)
    return {
        name: joined(
            _one(model, CONFIGS[name], driven, k, soil, times_s, least[name][k])
            for k in range(drives)
        )
        for name in rows
    }


def joined(parts: Iterable[Streamed]) -> Streamed:
    """Return the drives of all parts."""
    every = list(parts)
    return Streamed(
        *(
            np.concatenate([getattr(part, name) for part in every])
            for name in Streamed.__dataclass_fields__
        )
    )


def _drive(
    model: LoadedModel, soil: Soil, spread: float, drives: int, seed: int, duration_s: float
) -> Driven:
    generator, again = (torch.Generator().manual_seed(each) for each in (seed, seed))
    ground = random_ground(soil, drives, generator, spread, FROM_PRIOR)
    drive = simulate(model.rover, ground, "S1", duration_s, generator, drives)
    [patch] = ground.patches
    return Driven(
        measure_drive(model.rover, drive.sample, Noise(), generator),
        measure_tasks(drive, Noise(), again),
        (~drive.sample.stuck).sum(1),
        patch.strength.numpy(),
        patch.constants.expand(drives, 6),
    )


def _least(
    model: LoadedModel,
    soil: Soil,
    spread: float,
    driven: Driven,
    times_s: Sequence[float],
    rows: Sequence[str],
) -> Mapping[str, NDArray[np.float64]]:
    """Return the deviations of the bound [N, K, 2] with each set of rows."""
    physics = physics_alone(model.rover, soil, exact=not spread)
    every = torch.ones_like(row_mask("v", physics.axles))
    masks = [every if name == EVERY_ROW else row_mask(name, physics.axles) for name in rows]
    known = Known(torch.stack(masks), driven.ends, driven.constants, spread / math.sqrt(3.0))
    bounds = cramer_rao_at(physics, driven.tasks, observation_times(times_s), known)
    deviations = bounds.diagonal(dim1=-2, dim2=-1).sqrt().numpy()
    return dict(zip(rows, deviations, strict=True))


def _one(
    model: LoadedModel,
    config: CoreConfig,
    driven: Driven,
    number: int,
    soil: str,
    times_s: Sequence[float],
    least: NDArray[np.float64],
) -> Streamed:
    truth, end = driven.truth[number], int(driven.ends[number])
    observations = observations_of(driven.measured, number)[:end]
    estimator, refused = Estimator(model, config), 0
    # a drive that is stuck at once keeps the prior
    estimate = estimator.reject(0, Outcome.DUPLICATE, "").estimate
    times, found = observation_times(times_s).tolist(), {}
    predicted = np.full((4, times[-1] + 1), np.nan)
    for k, observation in enumerate(observations):
        update = estimator.update(observation)
        estimate = update.estimate
        refused += 0 if update.decision.outcome.used else 1 + update.decision.settled
        likely = int(np.argmax(estimate.soil_probability))
        predicted[:, k] = (
            update.prediction.innovation,
            update.prediction.innovation_variance,
            estimate.soil_probability[likely],
            estimate.soils[likely] == soil,
        )
        if k in times:
            found[k] = estimate
    at = [found.get(k, estimate) for k in times]  # after a drive's end the last one holds
    values = (
        truth,
        [each.mean for each in at],
        [np.sqrt(np.diag(each.covariance)) for each in at],
        [(each.lower_95 <= truth) & (truth <= each.upper_95) for each in at],
        [each.identified for each in at],
        estimate.observations_used > 0,
        least,
        *predicted,
        refused,
        len(observations),
    )
    return Streamed(*(np.asarray(value, dtype=np.float64)[np.newaxis] for value in values))
