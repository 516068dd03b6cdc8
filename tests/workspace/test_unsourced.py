# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Without the workspace's environment every way to start a program says in one line what to do."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXECUTABLES = ROOT / "ros2_ws/install"
ADVICE = (
    "is not in this environment: source the workspace in this shell, then start again:  ."
    f" {ROOT}/ros2_ws/setup.bash"
)


def unsourced(command: list[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": "/usr/bin:/bin", "HOME": os.environ["HOME"]}
    return subprocess.run(
        command, cwd=cwd, check=False, capture_output=True, text=True, env=environment
    )


@pytest.mark.parametrize(
    ("command", "folder", "package"),
    [
        (
            [str(EXECUTABLES / "terrain_estimator/lib/terrain_estimator/estimator")],
            ".",
            "terrain_estimator",
        ),
        ([str(EXECUTABLES / "rover_sim_node/lib/rover_sim_node/simulator")], ".", "rover_sim_node"),
        (
            [sys.executable, "-m", "terrain_estimator.nodes.watch"],
            "terrain_estimator",
            "rover_parameters",
        ),
        ([sys.executable, "docs/examples/follow_advice.py"], ".", "msg_defs"),
        ([sys.executable, "docs/examples/read_estimate.py"], ".", "msg_defs"),
    ],
)
def test_one_line_says_what_to_do(command: list[str], folder: str, package: str) -> None:
    result = unsourced(command, ROOT / folder)
    assert result.stderr == f"{package} {ADVICE}\n"
    assert result.returncode == 1


@pytest.mark.parametrize("folder", [".", "docs"])
def test_a_module_that_python_itself_looks_for_in_vain_is_named_with_the_same_words(
    folder: str,
) -> None:
    result = unsourced([sys.executable, "-m", "terrain_estimator.nodes.watch"], ROOT / folder)
    assert len(result.stderr.splitlines()) == 1
    assert f"terrain_estimator {ADVICE}" in result.stderr


def test_another_error_keeps_its_traceback() -> None:
    result = unsourced([sys.executable, "-c", "import nowhere"], ROOT)
    assert "Traceback" in result.stderr
    assert "No module named 'nowhere'" in result.stderr
