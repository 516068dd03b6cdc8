# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""colcon test runs tests of every package; `make colcon-test` runs all that they declare."""

import os
import subprocess
import xml.etree.ElementTree as ET
from configparser import ConfigParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WORKSPACE = ROOT / "ros2_ws"
PACKAGES = [path.parent.name for path in sorted((WORKSPACE / "src").glob("*/setup.py"))]
SAMPLE = "loading or ground or pacing or track"
"""Selects a file of each package, to keep this short."""


def declared(package: str) -> list[Path]:
    """Return the folders and files of tests that a package's setup.cfg names."""
    config = ConfigParser()
    config.read(ROOT / package / "setup.cfg")
    return [ROOT / package / name for name in config["tool:pytest"]["testpaths"].split()]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_declares_tests_of_its_own(package: str) -> None:
    for path in declared(package):
        assert path.exists()
        assert (ROOT / "tests" / package) in (path.resolve(), *path.resolve().parents)


@pytest.mark.skipif(
    not (WORKSPACE / "install/.built").exists(), reason="make workspace builds what colcon tests"
)
def test_colcon_test_runs_tests_of_every_package(tmp_path: Path) -> None:
    command = [
        *("colcon", "--log-base", str(tmp_path / "log")),
        *("test", "--test-result-base", str(tmp_path / "results"), "--return-code-on-test-failure"),
        *("--event-handlers", "console_cohesion+", "--pytest-args", "-k", SAMPLE),
    ]
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")
    }
    result = subprocess.run(
        [WORKSPACE / "with", *command],
        cwd=WORKSPACE,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300.0,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    for package in PACKAGES:
        [suite] = ET.parse(tmp_path / f"results/{package}/pytest.xml").getroot()
        assert int(suite.attrib["tests"]) > 0, package
        assert suite.attrib["failures"] == suite.attrib["errors"] == "0"
    [messages] = (tmp_path / "results/msg_defs/Testing").glob("*/Test.xml")
    statuses = [
        test.attrib["Status"] for test in ET.parse(messages).getroot().iter("Test") if test.attrib
    ]
    assert statuses == ["passed"]
