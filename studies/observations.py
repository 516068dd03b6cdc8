# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Observations of simulated drives, for an estimator that takes them one by one."""

import dataclasses

import torch

from terrain_estimator.observation import Observation
from terramechanics.simulation.sample import Measurement

STEP_NS = 100_000_000


def observations_of(
    measurement: Measurement, index: int, step_ns: int = STEP_NS
) -> list[Observation]:
    """Return the observations of one drive of a measured batch, the first after one step [ns].

    What tells whether a rover is planar is not measured: a simulated one is.
    """
    batch, time = measurement.velocity.shape
    names = {field.name for field in dataclasses.fields(Observation)}
    shared = [each.name for each in dataclasses.fields(measurement) if each.name in names]
    columns = {name: getattr(measurement, name) for name in shared}
    series = {
        name: value[index] if value.ndim == 3 else value.expand(batch, time)[index]
        for name, value in columns.items()
    }
    fields = ({name: _plain(value[k]) for name, value in series.items()} for k in range(time))
    return [
        Observation(stamp * step_ns, **values)  # type: ignore[arg-type]
        for stamp, values in enumerate(fields, 1)
    ]


def _plain(value: torch.Tensor) -> object:
    return value.numpy() if value.ndim else float(value)
