# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A foreign drive through the node's estimator: screening, gates, restarts, published interval."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from studies.foreign.logs import Log, wheel_noise
from studies.foreign.residuals import BlockResiduals, block_residuals, kinds
from studies.foreign.watch import watched
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.restore import restore
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Update
from terramechanics.simulation.sensors import Noise
from terramechanics.vehicle.rover import Rover

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Driven:
    """What the estimator published in a drive of T observations and B closed blocks of Q rows.

    Numbers without a prediction are NaN.
    """

    truth: Floats  # [2] c [Pa], tan phi
    mean: Floats  # [2] last published
    deviation: Floats  # [2]
    inside_95: Floats  # [2] 1 where the last published interval holds the truth
    identified: Floats  # [] 1 where the last status is IDENTIFIED
    disagrees: Floats  # [] 1 where the last status is DISAGREES
    identified_at: Floats  # [T] 1 where the status is IDENTIFIED
    z_at: Floats  # [T, 2] error of the published mean over its deviation
    accepted: Floats  # [T] 1 where the decision says that the observation was used
    velocity: Floats  # [T] measured [m/s]
    true_velocity: Floats  # [T] of the log
    innovation: Floats  # [T] measured velocity less the predicted one
    variance: Floats  # [T] of the innovation, as predicted
    taken: Floats  # [B] 1 where the block entered the posterior
    length: Floats  # [B] its observations
    residual: Floats  # [B, Q] as in BlockResiduals
    noise: Floats  # [B, Q, Q]
    leading: Floats  # [B, Q] innovation
    spread: Floats  # [B, Q, Q]


def observations_of(columns: Mapping[str, Floats], rover: Rover) -> list[Observation]:
    """Return the observations of measured columns, as the node makes them of a bag's messages.

    One value stands for the wheels of an axle: their mean, and the deviation of that mean.
    """
    noise, parts = Noise(), wheel_noise(rover)
    axles: dict[str, Floats] = {"wheel_rate": _axle_means(columns, "rate", rover)}
    for name, (column, relative, absolute) in parts.items():
        axles[name] = _axle_means(columns, column, rover)
        squares = {
            f"{wheel}_square": (relative * columns[f"{wheel}_{column}"]) ** 2 + absolute**2
            for wheel in rover.wheel_names
        }
        count = rover.wheels_per_axle
        axles[f"{name}_sd"] = np.sqrt(_axle_means(squares, "square", rover) / count)
    stamps = np.round(columns["time"] * 1e9).astype(np.int64).tolist()
    return [
        Observation(
            stamp,
            **{name: values[k] for name, values in axles.items()},
            velocity=float(columns["velocity"][k]),
            velocity_sd=noise.velocity,
            pitch=float(columns["pitch"][k]),
            pitch_sd=noise.pitch,
            acceleration=float(columns["acceleration"][k]),
            acceleration_sd=math.sqrt(2.0) * noise.acceleration,
            bogie_angle=float(columns["bogie"][k]),
        )
        for k, stamp in enumerate(stamps)
    ]


def _axle_means(columns: Mapping[str, Floats], name: str, rover: Rover) -> Floats:
    """Return the means over the wheels of each axle [T, axles]."""
    by_axle = [
        [columns[f"{wheel.name}_{name}"] for wheel in rover.wheels if wheel.axle == axle]
        for axle in range(rover.axles)
    ]
    return np.stack([np.mean(wheels, axis=0) for wheels in by_axle], 1)


class _Block:
    """A closed block and what became of it."""

    def __init__(self, residuals: BlockResiduals, length: int, *, taken: bool) -> None:
        self.residuals, self.length, self.taken = residuals, length, taken


def drive(
    log: Log, observations: list[Observation], model: LoadedModel, config: CoreConfig | None = None
) -> Driven:
    """Run the estimator over the observations of a log, and its model's rows beside it."""
    core = config or CoreConfig()
    seen, watch = watched(model)
    twin = restore(model)
    estimator = Estimator(seen, core)
    updates: list[Update] = []
    blocks: list[_Block] = []
    for observation in observations:
        updates.append(estimator.update(observation))
        decision, closed = updates[-1].decision, watch.take()
        own_gate = decision.outcome is Outcome.GATED and decision.degrees_of_freedom == 1
        # the velocity's own gate refuses one observation, not the block that it would have closed
        if closed is not None and not own_gate:
            taken = decision.outcome.used
            found = block_residuals(twin, closed, kept=taken)
            blocks.append(_Block(found, closed.packed.shape[0], taken=taken))
    return _driven(log, observations, updates, blocks, usable_rows(model.rows, core))


def _driven(
    log: Log,
    observations: list[Observation],
    updates: list[Update],
    blocks: list[_Block],
    rows: tuple[str, ...],
) -> Driven:
    last = updates[-1].estimate
    statuses = [status_of(update, rows) for update in updates]
    identified = _column(status is Status.IDENTIFIED for status in statuses)
    every = [update.estimate for update in updates]
    z_at = [(each.mean - log.truth) / np.sqrt(np.diag(each.covariance)) for each in every]
    found = [block.residuals for block in blocks]
    return Driven(
        log.truth,
        last.mean,
        np.sqrt(np.diag(last.covariance)),
        _column((last.lower_95 <= log.truth) & (log.truth <= last.upper_95)),
        identified[-1],
        np.array(float(statuses[-1] is Status.DISAGREES)),
        identified,
        np.stack(z_at),
        _column(update.decision.outcome.used for update in updates),
        _column(observation.velocity for observation in observations),
        log.columns["velocity"],
        _column(update.prediction.innovation for update in updates),
        _column(update.prediction.innovation_variance for update in updates),
        _column(block.taken for block in blocks),
        _column(block.length for block in blocks),
        *(_stacked([each[place] for each in found]) for place in range(4)),
    )


def _column(values: Iterable[float]) -> Floats:
    return np.array([float(value) for value in values], dtype=np.float64)


def _stacked(tensors: list[torch.Tensor]) -> Floats:
    return torch.stack(tensors).numpy() if tensors else np.zeros((0, len(kinds(3))))
