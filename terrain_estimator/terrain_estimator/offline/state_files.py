# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Reading of the files that hold a saved state of the estimator."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from rover_parameters.regular_file import open_regular
from terrain_estimator.estimator.saved_state import (
    BEGINNING_SIZE,
    LARGEST_FILE,
    StateFileError,
    never_was_state,
    unpack_state,
)


def is_foreign(path: Path) -> bool:
    """Return whether a file never was a state. Raises OSError."""
    with open_regular(path) as file:
        return never_was_state(file.read(BEGINNING_SIZE))


def read_state(path: Path, model_sha256: str) -> dict[str, NDArray[Any]]:
    """Read the arrays of a state file. Raises StateFileError."""
    try:
        with open_regular(path) as file:
            content = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise StateFileError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) > LARGEST_FILE:
        raise StateFileError(f"{path}: is larger than {LARGEST_FILE} bytes, so it is no state file")
    return unpack_state(content, model_sha256, str(path))
