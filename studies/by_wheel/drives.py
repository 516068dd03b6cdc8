# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Drives of rovers that turn, through the node's estimator with a model by wheel."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from studies.off_plane import SOIL
from terrain_estimator.compiled.finding import ends_here, load
from terrain_estimator.compiled.folder import build_core, flags_by_end, write_core
from terrain_estimator.config.estimator import COMPILED, CoreConfig
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


def compiled(path: Path) -> LoadedModel:
    """Compile the core of a model in its folder, which takes a minute, and load it."""
    end, core = ends_here()[0], path.with_name(f"{path.stem}_core")
    write_core(path, core)
    build_core(core, path.with_suffix(end), *flags_by_end()[end])
    return load(str(path), COMPILED).model


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
