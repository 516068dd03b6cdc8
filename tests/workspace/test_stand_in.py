# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""ros2_ws/bin/ros2, `ros2 run` without a ROS installation, on a small workspace."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def write_script(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """Make a workspace in a folder with a space, with one executable."""
    workspace = tmp_path / "a folder/ros2_ws"
    for name in ("bin/ros2", "setup.bash", "fastdds.xml"):
        (workspace / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / "ros2_ws" / name, workspace / name)
    write_script(
        workspace / "install/geology/lib/geology/dig",
        'echo "pid $$" "$@"; echo "$FASTRTPS_DEFAULT_PROFILES_FILE"; exit 3',
    )
    (workspace / "install/geology/lib/geology/notes.txt").write_text(
        "not executable", encoding="utf-8"
    )
    (workspace / "install/setup.bash").write_text("", encoding="utf-8")
    return workspace


def ros2(
    workspace: Path, *arguments: str, path: str = "/usr/bin:/bin", **environment: str
) -> subprocess.CompletedProcess[str]:
    command = [str(workspace / "bin/ros2"), *arguments]
    return subprocess.run(
        command,
        check=False,
        capture_output=True,
        text=True,
        env={"PATH": path, "HOME": os.environ["HOME"], **environment},
    )


def test_run_hands_on_arguments_and_exit_code(workspace: Path) -> None:
    result = ros2(workspace, "run", "geology", "dig", "--ros-args", "-p", "depth:=two feet")
    assert result.returncode == 3
    assert result.stdout.splitlines()[0].endswith(" --ros-args -p depth:=two feet")


def test_run_becomes_the_executable_so_that_signals_reach_it(workspace: Path) -> None:
    with subprocess.Popen(
        [workspace / "bin/ros2", "run", "geology", "dig"], stdout=subprocess.PIPE, text=True
    ) as process:
        output, _ = process.communicate(timeout=20)
    assert output.splitlines()[0].strip() == f"pid {process.pid}"


def test_the_stand_in_of_another_checkout_is_not_taken_for_an_installed_ros2(
    workspace: Path,
) -> None:
    assert (
        ros2(
            workspace, "run", "geology", "dig", path=f"{ROOT / 'ros2_ws/bin'}:/usr/bin:/bin"
        ).returncode
        == 3
    )


def test_run_sets_the_discovery_profile_unless_the_user_has(workspace: Path) -> None:
    assert ros2(workspace, "run", "geology", "dig").stdout.splitlines()[1] == str(
        workspace / "fastdds.xml"
    )
    assert (
        ros2(
            workspace, "run", "geology", "dig", FASTRTPS_DEFAULT_PROFILES_FILE="mine.xml"
        ).stdout.splitlines()[1]
        == "mine.xml"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "geography", "dig"), "Package 'geography' not found"),
        (("run", "geology/lib", "dig"), "Package 'geology/lib' not found"),
        (("run", "geology", "fly"), "No executable 'fly' in package 'geology'"),
        (("run", "geology", "notes.txt"), "No executable 'notes.txt' in package 'geology'"),
        (("run", "geology"), "needs a package and an executable"),
        (("run",), "needs a package and an executable"),
    ],
)
def test_a_wrong_name_lists_what_there_is(
    workspace: Path, arguments: tuple[str, ...], message: str
) -> None:
    result = ros2(workspace, *arguments)
    assert result.returncode == 2
    assert message in result.stderr
    assert "geology: dig\n" in result.stderr


def test_other_verbs_are_refused_with_a_reason(workspace: Path) -> None:
    result = ros2(workspace, "topic", "list")
    assert result.returncode == 2
    assert "knows `ros2 run` and `ros2 service call` alone, not `ros2 topic`" in result.stderr
    assert "knows of `ros2 service` `call` alone" in ros2(workspace, "service", "list").stderr


def test_a_service_is_called_with_the_words_of_an_installed_ros2(
    workspace: Path, tmp_path: Path
) -> None:
    words = ("service", "call", "/planner/resume", "std_srvs/srv/Trigger", "{}")
    (workspace / "call_service.py").write_text("import sys; print(sys.argv[1:])", encoding="utf-8")
    assert ros2(workspace, *words).stdout == f"{list(words[2:])}\n"
    write_script(tmp_path / "opt/ros2", 'echo "installed:" "$@"')
    assert (
        ros2(workspace, *words, path=f"{tmp_path / 'opt'}:/usr/bin:/bin").stdout
        == f"installed: {' '.join(words)}\n"
    )


@pytest.mark.parametrize("arguments", [("--help",), ("-h",), ("run", "--help")])
def test_help_lists_packages_and_executables(workspace: Path, arguments: tuple[str, ...]) -> None:
    result = ros2(workspace, *arguments)
    assert result.returncode == 0
    assert "usage: ros2 run PACKAGE EXECUTABLE" in result.stdout
    assert "geology: dig\n" in result.stdout


def test_an_unbuilt_workspace_names_the_command_that_builds_it(workspace: Path) -> None:
    shutil.rmtree(workspace / "install")
    result = ros2(workspace, "run", "geology", "dig")
    assert result.returncode == 2
    assert "run make workspace once" in result.stderr


def test_an_installed_ros2_is_preferred(workspace: Path, tmp_path: Path) -> None:
    write_script(tmp_path / "opt/ros2", 'echo "installed:" "$@"')
    path = f"{workspace / 'bin'}:{tmp_path / 'opt'}:/usr/bin:/bin"
    assert (
        ros2(workspace, "run", "geology", "dig", path=path).stdout == "installed: run geology dig\n"
    )
    assert ros2(workspace, "topic", "list", path=path).stdout == "installed: topic list\n"


def test_a_workspace_built_on_the_wheels_is_run_on_the_wheels(
    workspace: Path, tmp_path: Path
) -> None:
    write_script(tmp_path / "opt/ros2", 'echo "installed:" "$@"')
    write_script(workspace / "install/.built", "")
    venv = workspace.parent / ".venv"
    write_script(venv / "bin/python", "")
    (venv / "setup.bash").write_text(f"VIRTUAL_ENV='{venv}'", encoding="utf-8")
    path = f"{tmp_path / 'opt'}:/usr/bin:/bin"
    assert ros2(workspace, "run", "geology", "dig", path=path).returncode == 3
    assert ros2(workspace, "topic", "list", path=path).stdout == "installed: topic list\n"


def test_the_built_workspace_offers_every_executable() -> None:
    listing = ros2(ROOT / "ros2_ws", "--help").stdout
    for package in ("rover_sim_node", "terrain_estimator"):
        executables = re.findall(
            r'^ +"(\w+) = [\w.]+:main",$',
            (ROOT / package / "setup.py").read_text(encoding="utf-8"),
            re.MULTILINE,
        )
        assert executables
        assert f"  {package}: {' '.join(sorted(executables))}\n" in listing
