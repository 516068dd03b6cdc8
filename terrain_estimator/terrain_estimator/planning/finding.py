# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Where the statics of a model lie."""

from pathlib import Path

from terrain_estimator.compiled.finding import core_folders
from terrain_estimator.model.metadata import Metadata
from terrain_estimator.planning.statics import ENDING, Statics, StaticsError, read_statics


def find_statics(model: Path, sha256: str) -> Statics:
    """Return the statics of the TorchScript file ``model`` with this hash.

    Raises:
        StaticsError: there are none, or they are of another model or damaged.
    """
    for folder in core_folders(model):
        path = folder / (model.stem + ENDING)
        if path.is_file():
            return read_statics(path, sha256)
    raise StaticsError(
        f"{model.name} has no statics: ros2 run terrain_estimator export_core {model} FOLDER"
        " --build makes them"
    )


def statics_of(model: Path, metadata: Metadata) -> tuple[Statics, str]:
    """Return the statics of a model, and why they were solved here; empty where they were found.

    Only where they are solved, torch is imported, and it takes some seconds.
    """
    try:
        return find_statics(model, metadata.sha256), ""
    except StaticsError as error:
        from terrain_estimator.planning.solving import solve_statics  # noqa: PLC0415

        return solve_statics(metadata.rover, metadata.soils, metadata.wheel_places), str(error)
