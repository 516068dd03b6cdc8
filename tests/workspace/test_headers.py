# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Every source file begins with its two lines of licence, also where no linter checks it."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SUFFIXES = {".py", ".msg", ".xml", ".yaml", ".toml", ".txt", ".sh", ".bash", ".md"}
NAMES = {"Makefile", "CMakeLists.txt", "setup.cfg", "prepare", "compile", "with", "run", "ros2"}
LINES = [
    "SPDX-FileCopyrightText: 2026 The terrain_estimator authors",
    "SPDX-License-Identifier: Apache-2.0",
]
NOT_OURS = {".git", ".venv", "build", "install", "log", "out", "__pycache__"}


def sources() -> Iterator[Path]:
    for folder, names, files in os.walk(ROOT):
        names[:] = [
            name
            for name in names
            if name not in NOT_OURS and not name.endswith(("_cache", ".egg-info"))
        ]
        if Path(folder) == ROOT and "bags" in names:
            names.remove("bags")  # recordings, where there are any
        for name in sorted(files):
            if Path(name).suffix in SUFFIXES or name in NAMES:
                yield Path(folder, name).relative_to(ROOT)


@pytest.mark.parametrize("path", list(sources()), ids=str)
def test_source_files_begin_with_the_licence(path: Path) -> None:
    head = [
        line.strip("# \t") for line in (ROOT / path).read_text(encoding="utf-8").splitlines()[:8]
    ]
    assert [line for line in head if line.startswith("SPDX")] == LINES
