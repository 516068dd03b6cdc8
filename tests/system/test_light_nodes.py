# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the processes onboard load."""

from pathlib import Path

import pytest

from tests.system.processes import Starter


def libraries(pid: int) -> set[str]:
    """Return which of the large packages a process has mapped."""
    maps = Path(f"/proc/{pid}/maps").read_text()
    return {name for name in ("torch", "scipy") if f"/site-packages/{name}/" in maps}


@pytest.mark.parametrize(
    ("node", "arguments", "expected"),
    [
        ("estimator", [], set()),
        ("estimator", ["-p", "runtime:=compiled"], set()),
        ("estimator", ["-p", "runtime:=torchscript"], {"torch"}),
        ("slip_source", [], set()),
        ("terrain_map", [], set()),
        ("planner", [], set()),
        ("recorder", [], set()),
    ],
)
def test_torch_and_scipy_are_loaded_where_torchscript_runs_alone(
    start: Starter, tmp_path: Path, node: str, arguments: list[str], expected: set[str]
) -> None:
    output = ["-p", f"output:={tmp_path / 'bag'}"] if node == "recorder" else []
    process = start("terrain_estimator", node, "--ros-args", *arguments, *output)
    process.wait_for_output("ready|waiting for", timeout=60.0)
    assert libraries(process.pid) == expected
    if node == "estimator":
        name = "torchscript" if expected else "compiled"
        assert f"({name}) for rover" in process.output
    process.interrupt()
