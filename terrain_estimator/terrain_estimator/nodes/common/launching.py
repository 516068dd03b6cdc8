# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declare the arguments of a launch file, and refuse those that it does not declare.

ROS's launch library passes over an argument that no file declares, so a misspelt one would leave
the default in force. Only launch files import this module: the library has no wheel.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from launch import LaunchContext
from launch.actions import DeclareLaunchArgument, OpaqueFunction

from rover_parameters.records import ConfigError, nearest

PACKAGE = "terrain_estimator"
Arguments: TypeAlias = Mapping[str, tuple[str | None, str]]
"""Default and description by name; a default of None makes an argument mandatory."""
SWITCH = ("true", "false")
LIBRARY = ("emulate_tty", "launch-prefix", "launch-prefix-filter", "sigterm_timeout")
LIBRARY_ARGUMENTS = frozenset((*LIBRARY, "sigkill_timeout"))
"""Names that the library itself reads."""
SHARED: Arguments = {
    "planner": ("false", "advise how fast to go and when to stop, on traction_advice"),
    "map": ("false", "publish the estimate along the track, on terrain_map"),
    "config": (
        "",
        (
            "folder of parameter files estimator.yaml, planner.yaml, ...; begin with a copy of"
            " share/terrain_estimator/config; empty: none"
        ),
    ),
    "respawn": ("false", "start a node of the rover anew when its process has ended"),
    "respawn_delay": ("2.0", "[s] before that"),
}
"""Arguments that every launch file has."""
ONE_ROVER: Arguments = {
    **SHARED,
    "model": ("", "name of an installed model or path of a model file; empty: mars_rover"),
    "dashboard": (
        "false",
        "show all of it live in a browser, at http://127.0.0.1:8090 (docs/dashboard.md)",
    ),
    "output": ("", "folder of the bag, must not exist; empty: bags/<UTC time>"),
}
"""Arguments of the launch files for one rover."""


def declared(arguments: Arguments) -> list[Any]:
    """Return the actions that declare the arguments, and refuse any other of the command line."""
    actions: list[Any] = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=text,
            choices=[*SWITCH] if default in SWITCH else None,
        )
        for name, (default, text) in arguments.items()
    ]
    return [OpaqueFunction(function=partial(_refuse_others, arguments)), *actions]


def seconds(value: Mapping[str, str], name: str) -> float:
    """Return a time [s] among the values of the arguments.

    Raises:
        ConfigError: it is not a finite number, or below zero.
    """
    try:
        number = float(value[name])
    except ValueError:
        number = math.nan
    if not 0.0 <= number < math.inf:
        raise ConfigError(f"{name}:={value[name]}: expected a number of seconds, at least 0")
    return number


def _refuse_others(arguments: Arguments, context: LaunchContext) -> list[Any]:
    """Refuse an unknown argument of the command line.

    A launch file of somebody else that includes ours may declare arguments of its own.

    Raises:
        ConfigError: the argument, and the nearest one that exists.
    """
    path = Path(context.locals.current_launch_file_path)
    if not _is_started(path, sys.argv):
        return []
    for each in context.argv:
        name = each.split(":=")[0]
        if name not in arguments and name not in LIBRARY_ARGUMENTS:
            raise ConfigError(
                f"{path.name} has no argument {name} (given: {each}): {nearest(name, arguments)}"
            )
    return []


def _is_started(path: Path, command_line: Sequence[str]) -> bool:
    """Return whether `ros2 launch` was called with this file, by package or by path."""
    words = [word for word in command_line if ":=" not in word]
    named = PACKAGE in words and path.name in words
    return named or any(Path(word).is_file() and path.samefile(word) for word in words)
