# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A recording that several tests replay."""

from pathlib import Path

import pytest

from terrain_estimator.bags import Types
from tests.drives import drive_messages, write_bag
from tests.terrain_estimator.offline.replays import SECONDS


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    types = Types()
    return write_bag(
        tmp_path_factory.mktemp("bags") / "drive", drive_messages(types.make, SECONDS), types
    )
