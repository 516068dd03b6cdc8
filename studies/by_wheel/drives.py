# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of rovers that turn, through the node's estimator with a model by wheel."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from studies.off_plane import SOIL
from studies.turning_observations import turning_observations_of
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.by_wheel import build_model_by_wheel
from terrain_estimator.learning.export import export
from terrain_estimator.messaging.messages import Status, status_of
from terrain_estimator.messaging.pipeline import usable_rows
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.prior import Prior
from terrain_estimator.observation import Floats, Observation
from terrain_estimator.update import Update
from terramechanics.simulation.body_plant import BodyPlant
from terramechanics.simulation.sample import TIME_STEP, Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.spatial import BodySample
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

SEED = 82_000_000
Flags = NDArray[np.bool_]
CORE = CoreConfig()


def model_by_wheel(
    rover: Rover, places: WheelPlaces, prior: Prior, path: Path, torque_sd: tuple[float, ...] = ()
) -> LoadedModel:
    """Write the model of SOIL to a file, and load it; as :func:`model_of_soils`."""
    return model_of_soils(rover, places, [SOIL], prior, path, torque_sd)


def model_of_soils(
    rover: Rover,
    places: WheelPlaces,
    soils: Sequence[Soil],
    prior: Prior,
    path: Path,
    torque_sd: tuple[float, ...] = (),
) -> LoadedModel:
    """Write the model to a file, and load it; arguments as of ``build_model_by_wheel``."""
    model = build_model_by_wheel(rover, places, soils, prior, torque_sd)
    export(model, rover, soils, Training(0, 0, 0.0, torch.__version__), path, places)
    return load_model(str(path))


def observed(
    rover: Rover,
    driven: Sequence[BodySample],
    strength: Tensor,
    order: Sequence[int],
    generator: torch.Generator,
    effects: BodyPlant | None = None,
    shift: float = 0.0,
) -> list[list[Observation]]:
    """Return the observations by wheel of each drive; ``order`` is that of the samples' wheels.

    ``effects`` are those of sensors; the centre of mass is ``shift`` [m] ahead of the rover file's.
    """

    def stacked(name: str) -> Tensor:
        return torch.stack([getattr(sample, name) for sample in driven], 1)

    def wheels(name: str) -> Tensor:
        return stacked(name)[:, :, order]

    velocity, slip, forces = stacked("velocity"), wheels("slip"), wheels("forces")
    before = torch.cat([torch.zeros_like(velocity[:, :1]), velocity[:, :-1]], 1)
    turned = velocity[..., 2] * TIME_STEP
    ahead = torch.cos(turned) * before[..., 0] + torch.sin(turned) * before[..., 1]
    level, never = torch.zeros_like(turned), torch.zeros_like(turned, dtype=torch.bool)
    bogies = 2 * len(rover.suspension)  # left and right, before the differential
    bogie = stacked("joints")[..., :bogies].mean(-1) if bogies else level
    sample = Sample(
        time=stacked("time"),
        position=stacked("position")[..., 0],
        height=level,
        velocity=velocity[..., 0],
        acceleration=(velocity[..., 0] - ahead) / TIME_STEP,
        pitch=stacked("pitch"),
        bogie_angle=bogie,
        stuck=never,
        standing=never,
        slip=slip,
        sinkage=wheels("sinkage"),
        contact=torch.zeros_like(slip),
        contact_angle=wheels("contact_angle"),
        wheel_rate=wheels("rim") / rover.wheel_radius,
        torque=wheels("torque"),
        normal=forces[..., 0],
        traction=forces[..., 1],
        ground_torque=forces[..., 2],
        valid=torch.isfinite(slip),
        constants=SOIL.constants().expand(*slip.shape, 6),
        strength=strength[:, None, None, :].expand(*slip.shape, 2),
    )
    sample = sample if effects is None else effects.sensed(sample)
    measured = measure_drive(rover, sample, Noise(), generator)
    aside = velocity[..., 1] - (rover.centre_of_mass_x + shift) * velocity[..., 2]
    observations = turning_observations_of(
        measured, stacked("roll"), aside, velocity[..., 2], generator
    )
    steering = wheels("steering").numpy()
    return [
        [dataclasses.replace(one, steering=steering[drive, step]) for step, one in enumerate(each)]
        for drive, each in enumerate(observations)
    ]


@dataclasses.dataclass(frozen=True, slots=True)
class Ended:
    """What was published at the end of the drives, and the share of observations that was used."""

    updates: list[Update]
    rows: tuple[str, ...]
    used: float  # [1]
    truth: Floats  # [drives, 2]

    @property
    def mean(self) -> Floats:
        """Means of c [Pa] and tan phi [drives, 2]."""
        return np.array([each.estimate.mean for each in self.updates])

    @property
    def deviation(self) -> Floats:
        """Their deviations [drives, 2]."""
        return np.array([np.sqrt(np.diag(each.estimate.covariance)) for each in self.updates])

    @property
    def holds(self) -> Flags:
        """Whether the 95 % interval of each holds the truth [drives, 2]."""
        low = np.array([each.estimate.lower_95 for each in self.updates])
        high = np.array([each.estimate.upper_95 for each in self.updates])
        return (low <= self.truth) & (self.truth <= high)

    @property
    def identified(self) -> Flags:
        """Whether the status is IDENTIFIED [drives]."""
        return np.array([status_of(each, self.rows) is Status.IDENTIFIED for each in self.updates])


def ended(
    model: LoadedModel,
    found: list[list[Observation]],
    truth: Floats,
    core: CoreConfig = CORE,
) -> Ended:
    """Run the node's estimator over each drive."""
    updates, used, count = [], 0, 0
    for observations in found:
        estimator = Estimator(model, core)
        every = [estimator.update(observation) for observation in observations]
        used += sum(each.decision.outcome.used for each in every)
        count += len(every)
        updates.append(every[-1])
    return Ended(updates, usable_rows(model.rows, core), used / count, truth)
