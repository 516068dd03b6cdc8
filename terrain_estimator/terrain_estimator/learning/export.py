# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Export of a trained model as TorchScript with its metadata, and the check of the file."""

import dataclasses
import io
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import torch
from torch import Tensor

from terrain_estimator.learning.by_wheel import BODY_PARAMETERS
from terrain_estimator.model.metadata import (
    FORMAT,
    Metadata,
    ModelFileError,
    Training,
    fingerprint,
    write_metadata,
)
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import (
    BLOCK,
    PACKED_WHEEL_FIELDS,
    scalar_fields,
)
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics import UNCERTAIN
from terrain_estimator.model.row_names import row_names, row_names_by_wheel
from terrain_estimator.model.torchscript import running
from terramechanics.simulation.sample import TIME_STEP
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

VERSION = "17"
"""Version of the model's structure and training, part of the model's id."""


def export(
    model: PAlpaca,
    rover: Rover,
    soils: Sequence[Soil],
    training: Training,
    path: Path,
    wheel_places: WheelPlaces | None = None,
) -> Metadata:
    """Write ``path`` (.pt) and the .json beside it, and return the metadata.

    The name of the file is that of the model. ``wheel_places`` are those of a model by wheel.
    """
    by_wheel = wheel_places is not None
    weights = tuple(f"net_{index}" for index in range(model.net.columns))
    if by_wheel:
        weights = BODY_PARAMETERS[: model.net.columns]
    constants = UNCERTAIN[: model.layout.constants]
    rows = (
        row_names_by_wheel(model.axles, len(rover.suspension))
        if by_wheel
        else row_names(model.axles)
    )
    used = tuple(row for row, use in zip(rows, model.every_row, strict=True) if use)
    metadata = Metadata(
        format=FORMAT,
        model_id=f"{path.stem}-{VERSION}",
        sha256="",
        size=0,
        observation_axle_fields=PACKED_WHEEL_FIELDS,
        observation_scalar_fields=scalar_fields(model.axles, rates=False, by_wheel=by_wheel),
        rows=rows,
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
        wheel_places=wheel_places,
        used_rows=() if used == rows else used,
    )
    return save(model, metadata, path)


def save(model: PAlpaca, metadata: Metadata, path: Path) -> Metadata:
    """Write ``path`` (.pt) and ``metadata`` beside it, and return that with size and sha256.

    The same model gives the same bytes. Raises OSError where the disk is full.
    """
    saved = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`torch.jit.\w+` is deprecated", DeprecationWarning)
        torch.jit.save(torch.jit.script(model.eval()), saved)
    path.write_bytes(without_places(saved))
    sha256, size = fingerprint(path)
    metadata = dataclasses.replace(metadata, sha256=sha256, size=size)
    write_metadata(path.with_suffix(".json"), metadata)
    return metadata


def without_places(saved: BinaryIO) -> bytes:
    """Return a saved module without what tells where its source lies: folders of this machine.

    The debug records hold these. The identity is a hash over all records.
    """
    kept = io.BytesIO()
    with zipfile.ZipFile(saved) as archive, zipfile.ZipFile(kept, "w") as copy:
        for record in archive.infolist():
            if not record.filename.endswith((".debug_pkl", ".data/serialization_id")):
                entry = zipfile.ZipInfo(record.filename)
                copy.writestr(entry, archive.read(record), record.compress_type)
    return kept.getvalue()


def check_export(model: PAlpaca, path: Path, observations: Tensor) -> None:
    """Check that the exported file gives the Python model's numbers for ``observations`` [n, P].

    Raises ModelFileError with the largest difference where it does not.
    """
    loaded = load_model(str(path))
    with running():
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
