# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The file of a rover's reference drives, by which a configuration's sensors are judged.

It lies beside a model or with the models that ship, and is called by the model or by its rover. It
holds what a simulated rover measures in one drive on each soil; docs/estimator.md says how it is
used.
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
from terrain_estimator.model.metadata import (
    MODELS,
    Metadata,
    ModelFileError,
    model_path,
    read_metadata,
)
from terrain_estimator.observation import AXLE_FIELDS, OFF_PLANE, SCALAR_FIELDS, Observation
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

ENDING = ".drive.npz"
"""How the file's name ends; it begins with that of the model's file or with the rover's."""
_FIELDS = (*AXLE_FIELDS, *(name for name in SCALAR_FIELDS if name not in OFF_PLANE))
"""What the drives of a model by axle have; those of one by wheel have OFF_PLANE, too."""
_PLACES = "wheel_places"
_LARGEST, _LARGEST_UNPACKED = 1 << 24, 1 << 26  # bytes


def judge_sensors(model: LoadedModel, config: EstimatorConfig) -> tuple[SensorBounds, str]:
    """Return what a configuration's sensors tell, and a warning where that is too little.

    There are no bounds, and no warning, where the model's rover has no reference drive.

    Raises:
        ConfigError: it is too little on every soil.
        ModelFileError: the file of the drives is damaged.
    """
    drives = reference_drives(model_path(config.model), model.metadata)
    bounds = bounds_of(model, config, drives)
    return bounds, doubt_of(bounds, config, velocity_alone=model.metadata.velocity_alone)


def write_drives(path: Path, metadata: Metadata, drives: Drives) -> None:
    """Write drives of a model's rover, in single precision. Raises OSError."""
    texts = _identity(metadata) | {
        f"{soil.name}/soil": as_text(soil) for soil in metadata.soils if soil.name in drives
    }
    arrays: dict[str, Any] = {name: np.array(each) for name, each in texts.items()}
    for soil, drive in drives.items():
        arrays[f"{soil}/stamp_ns"] = np.array([each.stamp_ns for each in drive])
        for name in _fields(metadata):
            values = [getattr(each, name) for each in drive]
            arrays[f"{soil}/{name}"] = np.array(values, dtype=np.float32)
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def copy_drives(model: str, metadata: Metadata, path: Path) -> None:
    """Write the drives of a ``model``, where it has some, for one with other features or names.

    ``metadata`` is that of the new model.

    Raises:
        ModelFileError: the file of the drives is damaged.
        OSError: the new one cannot be written.
    """
    source = model_path(model)
    drives = reference_drives(source, read_metadata(source.with_suffix(".json")))
    if drives:
        write_drives(path, metadata, drives)


def reference_drives(model: Path, metadata: Metadata) -> Drives:
    """Return the reference drives of a model's rover on those of its soils that have one.

    There are none where no file of their name is of this rover, with wheels in these places.

    Raises:
        ModelFileError: a file of their name is damaged.
    """
    for folder in (*core_folders(model), MODELS):
        for name in dict.fromkeys((model.stem, metadata.rover.name)):
            path = folder / f"{name}{ENDING}"
            if path.is_file() and (drives := _read(path, metadata)):
                return drives
    return {}


def _read(path: Path, metadata: Metadata) -> Drives:
    """Return the drives in a file on the model's soils; none where it is of another rover."""
    try:
        arrays = _arrays(read_regular(path, _LARGEST))
        own = _identity(metadata)
        if {name: str(arrays[name]) for name in ("rover", _PLACES) if name in arrays} != own:
            return {}
        return {
            soil.name: _drive(arrays, soil.name, metadata)
            for soil in metadata.soils
            if str(arrays.get(f"{soil.name}/soil", "")) == as_text(soil)
        }
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ModelFileError(
            f"{path}: {error}: make the model anew, or install the package anew"
        ) from error


def _arrays(content: bytes) -> dict[str, Any]:
    """Return the arrays of a file. Raises ValueError, EOFError or BadZipFile where it has none."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(each.file_size for each in archive.infolist()) > _LARGEST_UNPACKED:
            raise ValueError(f"holds more than {_LARGEST_UNPACKED >> 20} MiB")
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _fields(metadata: Metadata) -> tuple[str, ...]:
    return (*_FIELDS, *OFF_PLANE) if metadata.wheels else _FIELDS


def _identity(metadata: Metadata) -> dict[str, str]:
    """Return what the drives are of, as texts by the name in the file."""
    rover = {"rover": as_text(metadata.rover)}
    places = metadata.wheel_places
    return rover if places is None else rover | {_PLACES: as_text(places)}


def _drive(arrays: dict[str, Any], soil: str, metadata: Metadata) -> list[Observation]:
    """Return one drive of a file. Raises ValueError where an array has the wrong shape."""
    stamps = arrays[f"{soil}/stamp_ns"].reshape(-1).tolist()
    series = {name: arrays[f"{soil}/{name}"].astype(np.float64) for name in _fields(metadata)}
    for name, whole in series.items():
        each = () if name in SCALAR_FIELDS else (metadata.stations,)
        if whole.shape != (shape := (len(stamps), *each)):
            raise ValueError(f"{soil}/{name} has the shape {whole.shape}, not {shape}")
    drive = []
    for k, stamp in enumerate(stamps):
        values: dict[str, Any] = {
            name: each[k] if each.ndim > 1 else float(each[k]) for name, each in series.items()
        }
        drive.append(Observation(stamp, **values))
    return drive


def as_text(record: Rover | Soil | WheelPlaces) -> str:
    """Return the values of a record as text, by which files recognise it."""
    content = record.record() if isinstance(record, Rover) else dataclasses.asdict(record)
    return json.dumps(content, sort_keys=True)
