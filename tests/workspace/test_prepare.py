# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""ros2_ws/prepare and ros2_ws/compile: their errors, and that they do nothing twice."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ("bash", "cat", "dirname", "flock", "head", "rm", "sed", "sha256sum", "uname")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Copy the inputs of prepare, beside a bin folder of tools from which tests remove some."""
    (tmp_path / "ros2_ws").mkdir()
    for name in ("prepare", "repair_wheels.py"):
        shutil.copy(ROOT / "ros2_ws" / name, tmp_path / "ros2_ws" / name)
    shutil.copytree(ROOT / "requirements", tmp_path / "requirements")
    (tmp_path / "bin").mkdir()
    for name in (*TOOLS, "gcc", "g++", "make"):
        (tmp_path / "bin" / name).symlink_to(str(shutil.which(name)))
    write_python(tmp_path, "python3", "")
    return tmp_path


def write_python(checkout: Path, name: str, preamble: str) -> None:
    """Write an interpreter of that name that runs the preamble before any -c code."""
    path = checkout / "bin" / name
    path.write_text(
        f'#!/bin/sh\n[ "$1" = -c ] || exec {sys.executable} "$@"\nexec {sys.executable} -c'
        f' "{preamble}\n$2"\n',
        encoding="utf-8",
    )
    path.chmod(0o755)


def prepare(checkout: Path, **environment: str) -> str:
    """Return the error of prepare, which leaves no environment behind."""
    command = [str(checkout / "ros2_ws/prepare")]
    result = subprocess.run(
        command,
        check=False,
        capture_output=True,
        text=True,
        env={"PATH": str(checkout / "bin"), "HOME": os.environ["HOME"], **environment},
    )
    assert result.returncode == 1, result.stdout + result.stderr
    assert not (checkout / ".venv").exists()
    return result.stderr


def test_missing_headers_name_the_package(checkout: Path) -> None:
    write_python(
        checkout, "python3", "import sysconfig; sysconfig.get_path = lambda name: '/nowhere'"
    )
    message = prepare(checkout)
    assert "the header Python.h of python3" in message
    assert message.rstrip().endswith("sudo apt-get install python3-dev")


def test_missing_venv_names_the_package(checkout: Path) -> None:
    write_python(checkout, "python3", "import sys; sys.modules['ensurepip'] = None")
    assert prepare(checkout).rstrip().endswith("sudo apt-get install python3-venv")


@pytest.mark.parametrize("tool", ["gcc", "g++", "make"])
def test_a_missing_compiler_names_the_package(checkout: Path, tool: str) -> None:
    (checkout / "bin" / tool).unlink()
    assert prepare(checkout).rstrip().endswith("sudo apt-get install build-essential")


def test_everything_that_is_missing_is_named_at_once(checkout: Path) -> None:
    write_python(
        checkout,
        "python3",
        "import sys, sysconfig; sys.modules['ensurepip'] = None; sysconfig.get_path = lambda name:"
        " '/nowhere'",
    )
    (checkout / "bin/make").unlink()
    assert (
        prepare(checkout)
        .rstrip()
        .endswith("sudo apt-get install python3-venv python3-dev build-essential")
    )


@pytest.mark.parametrize("version", [(3, 10), (3, 14)])
def test_a_python_outside_the_range_is_refused(checkout: Path, version: tuple[int, int]) -> None:
    write_python(checkout, "python3", f"import sys; sys.version_info = {version}")
    message = prepare(checkout)
    assert "needs Python 3.11, 3.12 or 3.13" in message
    assert "sudo apt-get install python3 python3-venv python3-dev" in message


def test_a_python_named_by_the_user_is_not_replaced_by_another(checkout: Path) -> None:
    assert "PYTHON=python2 is no Python of version 3.11 to 3.13" in prepare(
        checkout, PYTHON="python2"
    )


def test_the_environment_of_another_folder_is_not_emptied_through_a_link(checkout: Path) -> None:
    other = checkout / "other"
    other.mkdir()
    (other / "kept").touch()
    (checkout / ".venv").symlink_to(other)
    result = subprocess.run(
        [checkout / "ros2_ws/prepare"],
        check=False,
        capture_output=True,
        text=True,
        env={"PATH": str(checkout / "bin"), "HOME": os.environ["HOME"]},
    )
    assert result.returncode == 1
    assert ".venv is a link to the environment of another folder" in result.stderr
    assert (other / "kept").exists()


def test_another_architecture_is_told_about_the_way_with_ros_installed(checkout: Path) -> None:
    uname = checkout / "bin/uname"
    uname.unlink()
    uname.write_text("#!/bin/sh\n[ $1 = -s ] && echo Linux || echo aarch64\n", encoding="utf-8")
    uname.chmod(0o755)
    message = prepare(checkout)
    assert "x86_64 Linux only, this is Linux aarch64" in message
    assert "docs/installation.md" in message


def test_a_second_call_does_nothing_and_says_nothing() -> None:
    for step in ("prepare", "compile"):
        start = time.monotonic()
        result = subprocess.run(
            [ROOT / "ros2_ws" / step], check=True, capture_output=True, text=True
        )
        assert time.monotonic() - start < 5.0
        assert result.stdout + result.stderr == ""


def test_a_package_whose_link_is_lost_is_named(tmp_path: Path) -> None:
    (tmp_path / "ros2_ws/src").mkdir(parents=True)
    (tmp_path / "terrain_core").mkdir()
    shutil.copy(ROOT / "ros2_ws/compile", tmp_path / "ros2_ws/compile")
    (tmp_path / "ros2_ws/src/terrain_core").write_text("../../terrain_core", encoding="utf-8")
    result = subprocess.run(
        [tmp_path / "ros2_ws/compile"], check=False, capture_output=True, text=True
    )
    assert result.returncode == 1
    assert "src/terrain_core is no link to the folder ../../terrain_core" in result.stderr
    assert "git checkout -- ros2_ws/src" in result.stderr


def test_the_lists_pin_every_package_to_one_version() -> None:
    lines = [
        line
        for path in (ROOT / "requirements").glob("*.txt")
        for line in path.read_text(encoding="utf-8").splitlines()
    ]
    pins = [line.split(";")[0].strip() for line in lines if line and not line.startswith("#")]
    names = [pin.split("==")[0].lower() for pin in pins]
    assert all(pin.count("==") == 1 for pin in pins)
    assert len(set(names)) == len(names)
    assert not {"lark", "launch", "rclpy"} & set(names)


def test_make_hands_the_users_interpreter_on() -> None:
    result = subprocess.run(
        ["make", "--dry-run", "--print-data-base", "environment"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHON": "mine"},
    )
    assert "\nPYTHON = mine\n" in result.stdout
