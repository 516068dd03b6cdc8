# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the studies of streamed drives keep of a batch."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.stream.drives import Streamed, stream_cell

Record = dict[str, NDArray[Any]]
"""Fields of Streamed with each set of rows, named ROWS.FIELD."""
OF_EACH_OBSERVATION = ("innovation", "variance", "soil_probability", "soil_right")
"""Fields that a record may lack."""


def record_of(found: Mapping[str, Streamed], *, whole: Collection[str] = ()) -> Record:
    """Return what is kept of these results; fields of each observation of the ``whole`` ones."""
    return {
        f"{rows}.{field}": value
        for rows, streamed in found.items()
        for field, value in dataclasses.asdict(streamed).items()
        if rows in whole or field not in OF_EACH_OBSERVATION
    }


def kept_cell(
    rover: str,
    soil: str,
    spread: float,
    drives: int,
    seed: int,
    times_s: Sequence[float],
    rows: Sequence[str],
    *,
    bound: bool = True,
    whole: Collection[str] = (),
) -> Record:
    """Return what is kept of :func:`stream_cell`; a process that was started can import this."""
    found = stream_cell(rover, soil, spread, drives, seed, times_s, rows, bound=bound)
    return record_of(found, whole=whole)


def streamed_of(record: Record, rows: str) -> Streamed:
    """Return the results with a set of rows; what a record lacks is of no observation."""
    nothing = np.empty((len(record[f"{rows}.truth"]), 0))
    names = (field.name for field in dataclasses.fields(Streamed))
    return Streamed(*(record.get(f"{rows}.{name}", nothing) for name in names))
