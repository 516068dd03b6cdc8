# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a node needs to forecast traction: a model's rover and soils, and statics solved ahead."""

import math
from typing import NamedTuple

from rover_parameters.records import ConfigError
from terrain_estimator.messaging.pipeline import rover_of
from terrain_estimator.model.metadata import (
    Metadata,
    ModelFileError,
    checked_bytes,
    model_path,
    read_metadata,
)
from terrain_estimator.planning.finding import statics_of
from terrain_estimator.planning.table import TractionTable
from terramechanics.vehicle.rover import Rover


class TractionModel(NamedTuple):
    """A model as forecasts of traction take it."""

    metadata: Metadata
    rover: Rover  # the model's, or one that differs from it in names alone
    table: TractionTable
    solved: str  # why the statics were solved at the start; empty where they were found


def read_traction(model: str, rover: str) -> TractionModel:
    """Read a model by name or path ("" is the default one), for a rover ("" is the model's).

    Raises:
        ConfigError: the model file is missing, damaged or for another rover.
    """
    try:
        path = model_path(model)
        metadata = read_metadata(path.with_suffix(".json"))
        checked_bytes(path, metadata)
        driven = rover_of(metadata, rover)
        metadata.refuse_velocity_alone(
            "traction is forecast from the balances of load and moments, which its data do not"
            " keep: give the model of all rows, made without --rows"
        )
    except ModelFileError as error:
        raise ConfigError(str(error)) from error
    statics, why = statics_of(path, metadata)
    solved = f"the statics were solved at the start: {why}" if why else ""
    places = metadata.wheel_places
    half_track = math.nan if places is None else 0.5 * places.track_width
    return TractionModel(metadata, driven, TractionTable(driven, statics, half_track), solved)
