# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The model of a rover and a soil without a training: its physics alone."""

from pathlib import Path

import torch

from terrain_estimator.learning.export import export
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.model_file import load_model
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover


def physics_model(rover: Rover, soil: Soil, path: Path) -> LoadedModel:
    """Write the physics, with soil constants known within 5 %, to a model file, and load it."""
    training = Training(0, 0, 0.0, torch.__version__)
    export(physics_alone(rover, soil, exact=False), rover, [soil], training, path)
    return load_model(str(path))
