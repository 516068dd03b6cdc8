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

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from rover_parameters.records import ConfigError, nearest
from terrain_estimator.model.metadata import model_path, read_metadata
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES
from terramechanics.description.urdf import to_urdf
from terramechanics.presets import load_rover

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
    "composed": (
        "false",
        "run the nodes in one process, but for the dashboard: a third of the memory",
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
    "rviz": (
        "false",
        "show the rover in RViz, with robot_state_publisher (docs/rviz_and_nav2.md)",
    ),
}
"""Arguments of the launch files for one rover."""
REMAPPED = {
    **{name: name for name in (*INPUT_TYPES, *OUTPUT_TYPES)},
    "estimator_health": "estimator_health",
    "traction_advice": "traction_advice",
    "terrain_map": "terrain_map",
    "terrain_grid": "terrain_grid",
    "wheel_markers": "wheel_markers",
    "ground_truth": "ground_truth/terrain",
    "diagnostics": "/diagnostics",
}
"""Topics by the argument that gives each another name."""
TOPICS: Arguments = {
    argument: (topic, f"name of the topic {topic} for all nodes, as docs/messages.md describes it")
    for argument, topic in REMAPPED.items()
}
"""Arguments for the names of topics."""
TF = [("/tf", "tf"), ("/tf_static", "tf_static")]
"""With a namespace, tf is in it, as with Nav2: two rovers have two trees of the same frames."""


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


def remappings(value: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return the remappings of topics that have another name than their own.

    Raises:
        ConfigError: a name is empty, or two topics would have one.
    """
    names = {argument: value[argument] for argument in REMAPPED}
    for argument, name in names.items():
        if not name:
            raise ConfigError(f"{argument}:=: give the name of a topic, or leave the argument out")
        twin = next(each for each, other in names.items() if other == name)
        if twin != argument:
            raise ConfigError(f"{argument}:={name}: this is the name of {twin}, too")
    return [(topic, names[each]) for each, topic in REMAPPED.items() if names[each] != topic]


def viewers(value: Mapping[str, str], track_width: float) -> list[Node]:
    """Return RViz and the node that publishes the links of the rover, or of the model's rover.

    ``track_width`` [m]; 0: that of a model by wheel, or a usual one. Wheels have steering joints
    where such a model has them, by their places in the rover file.
    """
    model = read_metadata(model_path(value["model"]).with_suffix(".json"))
    rover, steered = load_rover(value["rover"]) if value["rover"] else model.rover, set()
    if model.wheel_places is not None:
        track_width = track_width or model.wheel_places.track_width
        both = zip(model.rover.wheel_names, rover.wheel_names, strict=False)
        steered = {name for own, name in both if own in model.wheel_places.steered}
    common = {
        "namespace": value["namespace"],
        "remappings": [*TF, *remappings(value)],
        "output": "screen",
    }
    clock = {"use_sim_time": value["use_sim_time"] == "true"}
    urdf = ParameterValue(to_urdf(rover, track_width=track_width, steered=steered), value_type=str)
    config = str(Path(get_package_share_directory(PACKAGE), "rviz", "rover.rviz"))
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[{"robot_description": urdf, **clock}],
            **common,
        ),
        Node(
            package="rviz2",
            executable="rviz2",
            arguments=["-d", config],
            parameters=[clock],
            **common,
        ),
    ]


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
