# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A sample of the sweep over system calls; `make faults` runs all of it."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.syscalls.filter import compiled, environment

RUNS = 3
"""Runs of each program and kind of fault, drawn by the sweep's seed."""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = compiled(tmp_path_factory.mktemp("filter"))
    if found is None:
        pytest.skip("no C compiler: the filter of system calls cannot be built")
    return found


def test_a_call_that_fails_costs_nothing_earlier_and_gives_one_clear_line(library: Path) -> None:
    command = [sys.executable, "-m", "tests.faults.syscalls.sweep", "--only", str(RUNS)]
    done = subprocess.run(
        command, env=environment(library), capture_output=True, text=True, check=False
    )
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row["complaints"] for row in rows] == [[]] * len(rows), done.stderr
    assert {row["scenario"] for row in rows} == {"recorder", "state file", "recover_bag", "replay"}
    assert sum(row["runs"] for row in rows) >= len(rows)
    assert done.returncode == 0, done.stderr
