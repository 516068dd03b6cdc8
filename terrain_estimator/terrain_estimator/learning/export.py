# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Exports a trained model as TorchScript with its metadata, and checks that the file gives the same numbers."""

import dataclasses
import warnings
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from terrain_estimator.model.model_file import (
    FORMAT,
    Metadata,
    ModelFileError,
    Training,
    fingerprint,
    load_model,
    write_metadata,
)
from terrain_estimator.model.packing import PACKED_SCALAR_FIELDS, PACKED_WHEEL_FIELDS
from terrain_estimator.model.palpaca import BLOCK, PAlpaca
from terrain_estimator.model.prior import UNCERTAIN
from terrain_estimator.model.rows import row_names
from terramechanics.simulation.simulation import TIME_STEP
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

VERSION = "10"
"""Of the model's structure and training, part of the model's id."""


def export(
    model: PAlpaca, rover: Rover, soils: Sequence[Soil], training: Training, path: Path
) -> Metadata:
    """Write ``path`` (.pt) and the .json beside it; returns the metadata. The name of the file is that of the model."""
    weights = tuple(f"net_{index}" for index in range(model.net.columns))
    constants = UNCERTAIN[: model.layout.constants]
    metadata = Metadata(
        format=FORMAT,
        model_id=f"{path.stem}-{VERSION}",
        sha256="",
        size=0,
        observation_axle_fields=PACKED_WHEEL_FIELDS,
        observation_scalar_fields=PACKED_SCALAR_FIELDS,
        rows=row_names(model.axles),
        parameters=(
            "cohesion_kpa",
            "tan_phi",
            *weights,
            *constants,
            "mass",
            "centre_of_mass",
            "acceleration_bias",
            "velocity",
        ),
        block=BLOCK,
        step_s=TIME_STEP,
        prior=model.prior,
        rover=rover,
        soils=tuple(soils),
        training=training,
    )
    return save(model, metadata, path)


def save(model: PAlpaca, metadata: Metadata, path: Path) -> Metadata:
    """Write ``path`` (.pt) and ``metadata`` beside it; returns that with the size and sha256 of the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`torch.jit.\w+` is deprecated", DeprecationWarning)
        torch.jit.save(torch.jit.script(model.eval()), str(path))
    sha256, size = fingerprint(path)
    metadata = dataclasses.replace(metadata, sha256=sha256, size=size)
    write_metadata(path.with_suffix(".json"), metadata)
    return metadata


def check_export(model: PAlpaca, path: Path, observations: Tensor) -> None:
    """The exported file gives the Python model's numbers for packed ``observations`` [n, P].

    Raises ModelFileError with the largest difference where it does not.
    """
    loaded = load_model(str(path))
    with torch.no_grad():
        here, there = model.initial(), loaded.module.initial()
        for observation in observations:
            here, there = model.update(here, observation), loaded.module.update(there, observation)
        for name, mine, files in (
            ("estimate", model.estimate(here), loaded.module.estimate(there)),
            (
                "prediction",
                model.predict(here, observation),
                loaded.module.predict(there, observation),
            ),
        ):
            difference = float(
                torch.where(torch.eq(mine, files), 0.0, (mine - files).abs() / mine.abs()).max()
            )
            if not difference < 1e-9:
                raise ModelFileError(
                    f"{path}: differs from the trained model by {difference:g} of its {name}"
                )
