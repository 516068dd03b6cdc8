# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The file of a rover's reference drives, by which a configuration's sensors are judged.

It lies beside a model or with the models that ship, and is called by the rover. It holds what a
simulated rover measures in one drive on each soil; docs/estimator.md says how it is used.
"""

import dataclasses
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from rover_parameters.regular_file import read_regular
from terrain_estimator.compiled.finding import core_folders
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.estimator.sensor_information import Drives, SensorBounds, bounds_of, doubt_of
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import MODELS, Metadata, ModelFileError, model_path
from terrain_estimator.observation import AXLE_FIELDS, OFF_PLANE, SCALAR_FIELDS, Observation
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

ENDING = ".drive.npz"
"""How the file's name ends; it begins with the rover's."""
_FIELDS = (*AXLE_FIELDS, *(name for name in SCALAR_FIELDS if name not in OFF_PLANE))
_LARGEST = 1 << 24  # bytes


def judge_sensors(model: LoadedModel, config: EstimatorConfig) -> tuple[SensorBounds, str]:
    """Return what a configuration's sensors tell, and a warning where that is too little.

    There are no bounds, and no warning, where the model's rover has no reference drive.

    Raises:
        ConfigError: it is too little on every soil.
        ModelFileError: the file of the drives is damaged.
    """
    drives = reference_drives(model_path(config.model), model.metadata)
    bounds = bounds_of(model, config, drives)
    return bounds, doubt_of(bounds, config)


def write_drives(path: Path, rover: Rover, soils: dict[str, Soil], drives: Drives) -> None:
    """Write the drives of a rover on some soils, in single precision. Raises OSError."""
    texts = {"rover": _as_text(rover)} | {
        f"{name}/soil": _as_text(soil) for name, soil in soils.items()
    }
    arrays: dict[str, Any] = {name: np.array(each) for name, each in texts.items()}
    for soil, drive in drives.items():
        arrays[f"{soil}/stamp_ns"] = np.array([each.stamp_ns for each in drive])
        for name in _FIELDS:
            values = [getattr(each, name) for each in drive]
            arrays[f"{soil}/{name}"] = np.array(values, dtype=np.float32)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def reference_drives(model: Path, metadata: Metadata) -> Drives:
    """Return the reference drives of a model's rover on those of its soils that have one.

    There are none for another rover, and for a model by wheel.

    Raises:
        ModelFileError: a file of its name is damaged.
    """
    if metadata.wheels:
        return {}
    for folder in (*core_folders(model), MODELS):
        path = folder / f"{metadata.rover.name}{ENDING}"
        if path.is_file():
            return _read(path, metadata)
    return {}


def _read(path: Path, metadata: Metadata) -> Drives:
    try:
        with np.load(io.BytesIO(read_regular(path, _LARGEST)), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if str(arrays["rover"]) != _as_text(metadata.rover):
            return {}
        return {
            soil.name: _drive(arrays, soil.name)
            for soil in metadata.soils
            if str(arrays.get(f"{soil.name}/soil", "")) == _as_text(soil)
        }
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ModelFileError(f"{path}: {error}: install the package anew") from error


def _drive(arrays: dict[str, Any], soil: str) -> list[Observation]:
    series = {name: arrays[f"{soil}/{name}"].astype(np.float64) for name in _FIELDS}
    drive = []
    for k, stamp in enumerate(arrays[f"{soil}/stamp_ns"].tolist()):
        values: dict[str, Any] = {
            name: each[k] if each.ndim > 1 else float(each[k]) for name, each in series.items()
        }
        drive.append(Observation(stamp, **values))
    return drive


def _as_text(record: Rover | Soil) -> str:
    """Return a rover or soil as text, by which a drive's is recognised."""
    return json.dumps(dataclasses.asdict(record), sort_keys=True)
