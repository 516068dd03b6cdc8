# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the studies of streamed drives keep of a batch."""

import dataclasses
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.records import write_record
from studies.stream.drives import Streamed

Record = dict[str, NDArray[Any]]
"""Fields of Streamed with each set of rows, named ROWS.FIELD."""
OF_EACH_OBSERVATION = ("innovation", "variance", "soil_probability", "soil_right")
"""Fields that a record may lack."""


def write_cell(found: Mapping[str, Streamed], path: Path, *, whole: Collection[str] = ()) -> None:
    """Write the results with each set of rows, of the ``whole`` ones each observation, too."""
    record = {
        f"{rows}.{field}": value
        for rows, streamed in found.items()
        for field, value in dataclasses.asdict(streamed).items()
        if rows in whole or field not in OF_EACH_OBSERVATION
    }
    write_record(record, path)


def streamed_of(record: Record, rows: str) -> Streamed:
    """Return the results with a set of rows; what a record lacks is of no observation."""
    nothing = np.empty((len(record[f"{rows}.truth"]), 0))
    names = (field.name for field in dataclasses.fields(Streamed))
    return Streamed(*(record.get(f"{rows}.{name}", nothing) for name in names))
