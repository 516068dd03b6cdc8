# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The node's estimator, drive by drive: default parameters, every row, screening and gates.

Its published values are compared with the truth: the intervals of c and tan phi at the end, the
predicted velocity with the measured one, and the most probable soil with the one that is there.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from studies.accuracy.scores import FROM_PRIOR
from studies.observations import observations_of
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.tasks import random_ground
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terramechanics.presets import load_soil
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.soil import Soil

DURATION_S = 40.0


@dataclass(frozen=True, slots=True)
class Streamed:
    """Results of N drives of T observations; NaN without a prediction and after a drive's end."""

    truth: NDArray[np.float64]  # [N, 2] c [Pa], tan phi
    mean: NDArray[np.float64]  # [N, 2] last published
    deviation: NDArray[np.float64]  # [N, 2]
    inside_95: NDArray[np.float64]  # [N, 2] 1 where the last published interval holds the truth
    identified: NDArray[np.float64]  # [N, 2] 1 where the last status is identified
    innovation: NDArray[np.float64]  # [N, T] measured velocity less the predicted one [m/s]
    variance: NDArray[np.float64]  # [N, T] its predicted variance [m^2/s^2]
    soil_probability: NDArray[np.float64]  # [N, T] of the most probable soil
    soil_right: NDArray[np.float64]  # [N, T] 1 where it is the one that is there
    refused: NDArray[np.float64]  # [N] observations that were not used
    observations: NDArray[np.float64]  # [N]


def stream_cell(rover: str, soil: str, spread: float, drives: int, seed: int) -> Streamed:
    """Return :func:`stream` with the model of a rover that ships, on a soil by name."""
    return stream(load_model(rover), load_soil(soil), spread, drives, seed)


def stream(model: LoadedModel, soil: Soil, spread: float, drives: int, seed: int) -> Streamed:
    """Simulate drives over hills and run the estimator on each.

    Truth is from the prior, above zero; soil constants are wrong by up to ``spread`` [1]. A drive
    ends before its first stuck observation. The same seed gives the same drives.
    """
    generator = torch.Generator().manual_seed(seed)
    ground = random_ground(soil, drives, generator, spread, FROM_PRIOR)
    drive = simulate(model.rover, ground, "S1", DURATION_S, generator, drives)
    measured = measure_drive(model.rover, drive.sample, Noise(), generator)
    ends = (~drive.sample.stuck).sum(1).tolist()
    truth = ground.patches[0].strength.numpy()
    return joined(
        [
            _one(model, observations_of(measured, k)[: ends[k]], truth[k], soil.name)
            for k in range(drives)
        ]
    )


def joined(parts: Iterable[Streamed]) -> Streamed:
    """Return the drives of all parts."""
    every = list(parts)
    return Streamed(
        *(
            np.concatenate([getattr(part, name) for part in every])
            for name in Streamed.__dataclass_fields__
        )
    )


def _one(
    model: LoadedModel,
    observations: Sequence[Observation],
    truth: NDArray[np.float64],
    soil: str,
) -> Streamed:
    estimator, refused = Estimator(model, CoreConfig()), 0
    # a drive that is stuck at once keeps the prior
    estimate = estimator.reject(0, Outcome.DUPLICATE, "").estimate
    predicted = np.full((4, round(DURATION_S / TIME_STEP)), np.nan)
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
    inside = (estimate.lower_95 <= truth) & (truth <= estimate.upper_95)
    values = (
        truth,
        estimate.mean,
        np.sqrt(np.diag(estimate.covariance)),
        inside,
        estimate.identified,
        *predicted,
        refused,
        len(observations),
    )
    return Streamed(*(np.asarray(value, dtype=np.float64)[np.newaxis] for value in values))
