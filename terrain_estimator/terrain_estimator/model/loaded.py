# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A model that may be run, whatever runs it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from terrain_estimator.model.metadata import AddedEffect, Metadata, ModelFileError
from terrain_estimator.model.packed_observation import (
    PACKED_WHEEL_FIELDS,
    packed_size,
    scalar_fields,
)
from terrain_estimator.model.row_names import row_names, row_names_by_wheel
from terrain_estimator.model.runtime import Runtime
from terramechanics.vehicle.rover import Rover


@dataclass(frozen=True, slots=True)
class LoadedModel:
    """A model that passed every check."""

    metadata: Metadata
    runtime: Runtime  # what runs it
    module: Any = None  # TorchScript's; None where it was not loaded

    @property
    def rover(self) -> Rover:
        """The rover that the model is for."""
        return self.metadata.rover

    @property
    def model_id(self) -> str:
        """Name and version."""
        return self.metadata.model_id

    @property
    def sha256(self) -> str:
        """Return the sha256 of the module file."""
        return self.metadata.sha256

    @property
    def effects(self) -> tuple[AddedEffect, ...]:
        """Named effects that the model estimates."""
        return self.metadata.effects

    @property
    def balances_sinkage(self) -> bool:
        """Whether the model can take sinkages that no sensor measures from the balances."""
        return self.metadata.balances_sinkage

    @property
    def rows(self) -> tuple[str, ...]:
        """All regression rows of the model, in their order."""
        return self.metadata.rows

    @property
    def used_rows(self) -> tuple[str, ...]:
        """Those of the rows that count."""
        return self.metadata.used_rows or self.metadata.rows


def check_layout(path: Path, model: LoadedModel) -> None:
    """Check that a model's shapes are those of this version and of its own description.

    ``path`` is its module's file.

    Raises:
        ModelFileError: they are not; the message names both.
    """
    metadata = model.metadata
    stations, rates = metadata.stations, bool(model.effects)
    by_wheel = metadata.wheel_places is not None
    scalars = scalar_fields(stations, rates=rates, by_wheel=by_wheel)
    size = packed_size(stations, rates=rates, by_wheel=by_wheel)
    fields = (metadata.observation_axle_fields, metadata.observation_scalar_fields)
    if fields != (PACKED_WHEEL_FIELDS, scalars):
        raise ModelFileError(
            f"{path}: was trained for other fields of an observation, train it again (make train)"
        )
    runtime = model.runtime
    start = runtime.initial()
    state = runtime.arrays(start)
    rows = row_names(stations)
    if by_wheel:
        rows = row_names_by_wheel(stations, len(model.rover.suspension))
    if model.rows != rows or state["single_misses"].shape[0] != len(rows):
        raise ModelFileError(
            f"{path}: has rows {', '.join(model.rows)}, this version needs {', '.join(rows)}: train"
            " it again (make train)"
        )
    effects = len(runtime.effects(start))
    if effects != len(model.effects):
        raise ModelFileError(
            f"{path}: estimates {effects} named effects, its .json names {len(model.effects)}"
        )
    length, parameters = state["block"].shape[-1], state["expected"].shape[0]
    if length != size:
        what = "wheels" if by_wheel else "axles"
        raise ModelFileError(
            f"{path}: takes observations of {length} numbers, {stations} {what} need {size}"
        )
    estimated = runtime.estimate(start).shape
    if estimated != (3, 2):
        raise ModelFileError(f"{path}: estimates numbers of shape {estimated}, expected (3, 2)")
    if parameters != len(model.metadata.parameters):
        raise ModelFileError(
            f"{path}: has {parameters} parameters, its .json names {len(model.metadata.parameters)}"
        )
