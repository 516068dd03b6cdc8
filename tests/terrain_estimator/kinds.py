# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Models of rovers that no model ships for, without a training."""

from pathlib import Path

import torch

from terrain_estimator.learning.export import export
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.palpaca import PAlpaca
from terramechanics.presets import load_soil
from terramechanics.vehicle.rover import Rover

LOOSE = load_soil("loose_sand")


def untrained(rover: Rover) -> PAlpaca:
    """Return the physics of a rover on loose sand, whose constants are known to 5 %.

    The weights of its net are always the same.
    """
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return physics_alone(rover, LOOSE, exact=False)


def exported(rover: Rover, folder: Path) -> Path:
    """Write that model to a folder; return the path of its TorchScript file."""
    path = folder / f"{rover.name}.pt"
    training = Training(seed=0, iterations=0, loss=0.0, torch_version="")
    export(untrained(rover), rover, [LOOSE], training, path)
    return path
