# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator as a node runs it, judged drive by drive: default parameters, every row, screening, gates and doubt.

What it publishes is compared with the truth: the intervals of c and tan phi at the end, and the
velocity that it foretold with the one that came.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from studies.observations import observations_of
from terrain_estimator.config import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.tasks import random_ground
from terrain_estimator.model.model_file import LoadedModel
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import TIME_STEP, simulate
from terramechanics.terrain.soil import Soil

DURATION_S = 40.0


@dataclass(frozen=True, slots=True)
class Streamed:
    """What N drives of T observations gave; NaN where nothing was predicted or the drive has ended."""

    truth: NDArray[np.float64]  # [N, 2] c [Pa], tan phi
    mean: NDArray[np.float64]  # [N, 2] last published
    deviation: NDArray[np.float64]  # [N, 2]
    inside_95: NDArray[np.float64]  # [N, 2] 1 where the last published interval holds the truth
    identified: NDArray[np.float64]  # [N, 2] 1 where the last status says so
    innovation: NDArray[np.float64]  # [N, T] measured velocity less the one foretold [m/s]
    variance: NDArray[np.float64]  # [N, T] foretold for it [m^2/s^2]
    refused: NDArray[np.float64]  # [N] observations that were not used
    observations: NDArray[np.float64]  # [N]


def stream(model: LoadedModel, soil: Soil, spread: float, drives: int, seed: int) -> Streamed:
    """Simulate drives over hills, truth from the prior's range, constants within +-``spread`` [1], and run the estimator on each.

    A drive ends before its first stuck observation. The same seed gives the same drives.
    """
    generator = torch.Generator().manual_seed(seed)
    ground = random_ground(soil, drives, generator, spread)
    drive = simulate(model.rover, ground, "S1", DURATION_S, generator, drives)
    measured = measure_drive(model.rover, drive.sample, Noise(), generator)
    ends = (~drive.sample.stuck).sum(1).tolist()
    truth = ground.patches[0].strength.numpy()
    return joined(
        [_one(model, observations_of(measured, k)[: ends[k]], truth[k]) for k in range(drives)]
    )


def joined(parts: Iterable[Streamed]) -> Streamed:
    """The drives of all parts."""
    every = list(parts)
    return Streamed(
        *(
            np.concatenate([getattr(part, name) for part in every])
            for name in Streamed.__dataclass_fields__
        )
    )


def _one(
    model: LoadedModel, observations: Sequence[Observation], truth: NDArray[np.float64]
) -> Streamed:
    estimator, refused = Estimator(model, CoreConfig()), 0
    estimate = estimator.reject(
        0, Outcome.DUPLICATE, ""
    ).estimate  # a drive that is stuck at once keeps the prior
    foretold = np.full((2, round(DURATION_S / TIME_STEP)), np.nan)
    for k, observation in enumerate(observations):
        update = estimator.update(observation)
        estimate = update.estimate
        refused += not update.decision.outcome.used
        foretold[:, k] = update.prediction.innovation, update.prediction.innovation_variance
    inside = (estimate.lower_95 <= truth) & (truth <= estimate.upper_95)
    values = (
        truth,
        estimate.mean,
        np.sqrt(np.diag(estimate.covariance)),
        inside,
        estimate.identified,
        *foretold,
        refused,
        len(observations),
    )
    return Streamed(*(np.asarray(value, dtype=np.float64)[np.newaxis] for value in values))
