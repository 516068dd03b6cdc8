# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled cores of the workspace."""

import os
from pathlib import Path

import pytest

_FOLDERS = [
    Path(prefix) / "lib/terrain_core"
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
]
BUILT = next((folder for folder in _FOLDERS if folder.is_dir()), Path())
"""Where they are, if the workspace has any."""
needs_core = pytest.mark.skipif(
    not (BUILT / "mars_rover.so").is_file(), reason="the workspace has no terrain_core"
)
