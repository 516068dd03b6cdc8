# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of 10 s, and on each the estimator's posterior beside that of the simulator's equations.

The soil constants are exact, the soil is told, there is no net and no accelerometer. Truth (c,
tan phi) is drawn from the prior. A drive that is stuck, or leaves the range of the contact law, is
left out: the next one takes its place.
"""

import dataclasses
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from studies.accuracy.scores import FROM_PRIOR
from studies.independent_reference.equations import Equations, Seen, seen_of
from studies.independent_reference.posterior import (
    READINGS,
    DriveDensity,
    Moments,
    moments,
    prior_moments,
    sample,
)
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.export import export
from terrain_estimator.learning.observing import observations_of
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.learning.tasks import random_ground
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Observation
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import TIME_STEP, Measurement
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

DURATION_S = 10.0
BATCH = 10
"""Drives that are simulated at once."""
SAMPLES, WORLDS = 32, 256
"""Samples of the inputs of an instant, and worlds of the last round."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where drives are judged, and by which rows."""

    rover: str
    soil: str
    torque: bool  # beside velocity, load and moments


@dataclass(frozen=True, slots=True)
class Compared:
    """One drive. Means and deviations [2, 2] are of c [Pa] and tan phi."""

    truth: NDArray[np.float64]  # [2]
    estimated: NDArray[np.float64]  # [2, 2] of the estimator
    reference: NDArray[np.float64]  # [3, 2, 2] of the reference, by each reading of the inputs
    again: NDArray[np.float64]  # [3, 2, 2] the same by others and twice as many samples, or NaN
    distance: NDArray[np.float64]  # [4] squared, of the truth from estimator and each reading,
    # in their covariances of c and tan phi
    effective: NDArray[
        np.float64
    ]  # [4] worlds by each reading; least share of an instant's samples
    refused: NDArray[np.float64]  # [] observations that the estimator did not use
    slip: NDArray[np.float64]  # [] mean of the measured slips


def compare(place: Place, drive: int, seed: int, *, twice: bool) -> Compared:
    """Return drive number ``drive`` of ``seed``, judged.

    ``twice``: once more with other draws, and with twice the samples and worlds.
    """
    torch.set_num_threads(1)
    rover, soil = load_rover(place.rover), load_soil(place.soil)
    measured, truths = drawn(rover, soil, drive + 1, seed)
    mean, covariance, refused = estimated(rover, soil, measured, drive, torque=place.torque)
    seen = seen_of(measured, rover, drive, TIME_STEP)
    own = Moments(mean, covariance, math.inf)
    density, found = reference(place, seen, own, seed + 100 * drive, 1)
    again = np.full((len(READINGS), 2, 2), math.nan)
    if twice:
        again = _summary(reference(place, seen, own, seed + 100 * drive + 50, 2)[1])
    distances = [_distance(truths[drive], each) for each in (own, *found)]
    effective = [*(each.effective for each in found), density.quality.effective]
    return Compared(
        truths[drive].numpy(), _summary([own])[0], _summary(found), again, np.array(distances),
        np.array(effective), np.array(float(refused)), seen.slip.mean().numpy(),
    )  # fmt: skip


def reference(
    place: Place, seen: Seen, near: Moments, seed: int, times: int
) -> tuple[DriveDensity, list[Moments]]:
    """Return the moments of worlds [4] by each reading of the inputs, and the density of a drive.

    Worlds are first looked for around ``near``, twice as wide. Instants have ``times`` SAMPLES, the
    last round ``times`` WORLDS.
    """
    equations = Equations.of(load_rover(place.rover), load_soil(place.soil))
    generator = torch.Generator().manual_seed(seed)
    draws = normal_draws(len(seen.velocity), times * SAMPLES, equations.inputs, generator)
    density = DriveDensity(equations, seen, TIME_STEP, draws, place.torque)
    centre, sd = prior_moments()
    wide = torch.diag(sd.square())
    wide[:2, :2] = 4.0 * near.covariance
    start = Moments(torch.cat([near.mean, centre[2:]]), wide, 0.0)
    worlds = sample(density, start, times * WORLDS, seed)
    return density, [moments(worlds, reading) for reading in READINGS]


def drawn(rover: Rover, soil: Soil, count: int, seed: int) -> tuple[Measurement, Tensor]:
    """Return at least ``count`` measured drives of ``seed``, and their truths [.., 2].

    Drive k is the same whatever the count.
    """
    found: list[Measurement] = []
    truths: list[Tensor] = []
    batch = 0
    while sum(map(len, truths)) < count:
        generator = torch.Generator().manual_seed(seed + batch)
        ground = random_ground(soil, BATCH, generator, 0.0, FROM_PRIOR)
        drive = simulate(rover, ground, "S1", DURATION_S, generator, BATCH)
        measured = measure_drive(rover, drive.sample, Noise(), generator)
        kept = drive.measurable().all(1)
        found.append(_some(measured, kept))
        truths.append(ground.patches[0].strength[kept])
        batch += 1
    return _joined(found), torch.cat(truths)


def _some(measured: Measurement, kept: Tensor) -> Measurement:
    """Return some of the drives of a batch [B, T, ...], every field with all its dimensions."""
    batch, time = measured.velocity.shape
    fields = {
        each.name: getattr(measured, each.name).expand(
            batch, time, *getattr(measured, each.name).shape[2:]
        )[kept]
        for each in dataclasses.fields(Measurement)
    }
    return Measurement(**fields)


def _joined(parts: list[Measurement]) -> Measurement:
    names = [each.name for each in dataclasses.fields(Measurement)]
    return Measurement(*(torch.cat([getattr(part, name) for part in parts]) for name in names))


def normal_draws(instants: int, samples: int, size: int, generator: torch.Generator) -> Tensor:
    """Return standard normal draws [instants, samples, size] whose mean and covariance are exact.

    Each comes with its opposite. The rest of their distribution is exact for many samples only.
    """
    half = torch.randn(instants, samples // 2, size, generator=generator, dtype=torch.float64)
    gram = half.mT @ half / (samples // 2)
    white = torch.linalg.solve_triangular(torch.linalg.cholesky(gram), half.mT, upper=False).mT
    return torch.cat([white, -white], 1)


def estimated(
    rover: Rover, soil: Soil, measured: Measurement, drive: int, *, torque: bool
) -> tuple[Tensor, Tensor, int]:
    """Return mean [2] and covariance [2, 2] that the estimator publishes, and what it refused."""
    config = CoreConfig(use_torque=torque)
    estimator = Estimator(exact_model(rover, soil), config)
    observations = observations_of(measured, drive)
    updates = [
        estimator.update(_without_acceleration(each, torque=torque)) for each in observations
    ]
    decisions = [update.decision for update in updates]
    refused = sum(0 if each.outcome.used else 1 + each.settled for each in decisions)
    estimate = updates[-1].estimate
    return torch.tensor(estimate.mean), torch.tensor(estimate.covariance), refused


def _without_acceleration(observation: Observation, *, torque: bool) -> Observation:
    unknown = np.full_like(observation.torque, math.nan)
    return dataclasses.replace(
        observation,
        acceleration=math.nan,
        acceleration_sd=math.nan,
        torque=observation.torque if torque else unknown,
    )


def exact_model(rover: Rover, soil: Soil) -> LoadedModel:
    """Export the physics alone with exact soil constants, and load the file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "physics.pt"
        training = Training(0, 0, 0.0, torch.__version__)
        export(physics_alone(rover, soil, exact=True), rover, [soil], training, path)
        return load_model(str(path))


def _summary(found: list[Moments]) -> NDArray[np.float64]:
    """Return mean and deviations of c and tan phi [F, 2, 2]."""
    rows = [torch.stack([each.mean[:2], each.covariance.diagonal()[:2].sqrt()]) for each in found]
    return torch.stack(rows).numpy()


def _distance(truth: Tensor, about: Moments) -> float:
    away = truth - about.mean[:2]
    return float(away @ torch.linalg.solve(about.covariance[:2, :2], away))
