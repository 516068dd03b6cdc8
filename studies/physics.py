# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model of a rover and soils without a training: its physics alone."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import torch

from terrain_estimator.learning.export import export
from terrain_estimator.learning.training import build_model
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover


def physics_model(
    rover: Rover, soils: Sequence[Soil], path: Path, ground_variation: float = 0.0
) -> LoadedModel:
    """Write the physics, with soil constants known within 5 %, to a model file, and load it.

    ``ground_variation`` [1] is the relative deviation of the ground along the way.
    """
    prior = dataclasses.replace(DEFAULT_PRIOR, ground_variation=ground_variation)
    model = build_model(rover, soils, prior=prior)
    export(model, rover, list(soils), Training(0, 0, 0.0, torch.__version__), path)
    return load_model(str(path))
