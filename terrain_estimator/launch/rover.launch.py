# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Start the nodes of one rover.

For example: ros2 launch terrain_estimator rover.launch.py velocity:=visual_odometry planner:=true

The rover publishes what docs/messages.md says. The other launch files include this one. Without a
ROS installation start the executables by `ros2 run`.
"""

import json
from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from terrain_estimator.nodes.common.launching import (
    ONE_ROVER,
    TOPICS,
    declared,
    remappings,
    seconds,
    viewers,
)

SEPARATE = ("dashboard",)
"""Nodes that keep a process of their own: they are not needed on the rover."""
PATIENCE_S = "60"
"""[s] after Ctrl-C, in which the recorder compresses its bag."""
ARGUMENTS = {
    "namespace": ("", "of all topics and nodes"),
    **ONE_ROVER,
    "rover": (
        "",
        (
            "name or YAML file of the rover, for other names of its wheels; empty: the model's."
            " With velocity and model needed"
        ),
    ),
    "velocity": (
        "",
        (
            "topic of a velocity that slip_source makes wheel_slip of (not odom); empty: the rover"
            " publishes wheel_slip itself"
        ),
    ),
    "track_width": (
        "",
        (
            "[m] between left and right wheels, for slip_source in turns and for RViz; empty:"
            " slip_source as config says, else as straight ahead, RViz as a model by wheel says"
        ),
    ),
    "contact_angle_sd": (
        "",
        (
            "[rad] for a rover that measures neither sinkages nor contact angles: deviation of the"
            " ground from body and bogie. slip_source then publishes an empty wheel_sinkage. Empty:"
            " the rover publishes wheel_sinkage itself"
        ),
    ),
    "record": ("true", "record inputs and outputs to a bag"),
    "topics": ("", "that are recorded, with spaces between; empty: all of the suite"),
    "state": (
        "",
        (
            "file in which the estimator keeps what it knows over restarts, one a rover; empty: as"
            " config says, else it forgets at the end"
        ),
    ),
    "use_sim_time": (
        "false",
        "take the time of /clock, as with a simulator or a bag that is played",
    ),
    **TOPICS,
}


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, and start the chosen nodes."""
    return LaunchDescription([*declared(ARGUMENTS), OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    """Return the chosen nodes; an empty value leaves a parameter to the file or its default."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    if value["velocity"] and value["model"] and not value["rover"]:
        message = (
            f"model:={value['model']} with velocity:=: give rover:=, too, since slip_source needs"
            " its wheel radius and knows no model"
        )
        raise ValueError(message)
    track_width = _number(value, "track_width", "metres")
    angle_sd = _number(value, "contact_angle_sd", "radians")
    if angle_sd and not value["velocity"]:
        message = (
            f"contact_angle_sd:={angle_sd:g}: give velocity:=, too, since slip_source publishes the"
            " empty wheel_sinkage"
        )
        raise ValueError(message)
    if angle_sd and value["wheel_sinkage"] != ARGUMENTS["wheel_sinkage"][0]:
        message = (
            f"contact_angle_sd:={angle_sd:g} with wheel_sinkage:={value['wheel_sinkage']}: give one"
            " of them. A rover that publishes wheel_sinkage sets contact_angle_sd of its estimator"
            " in a file (config:=FOLDER)"
        )
        raise ValueError(message)
    sensors: dict[str, Any] = {"use_sinkage": False} if angle_sd else {}
    wanted: dict[str, dict[str, Any] | None] = {
        "estimator": {
            "model": value["model"],
            "rover": value["rover"],
            "state.file": value["state"],
            "contact_angle_sd": angle_sd,
            **sensors,
        },
        "slip_source": (
            {
                "rover": value["rover"],
                "track_width": track_width,
                "empty_sinkage": True if angle_sd else "",
            }
            if value["velocity"]
            else None
        ),
        "planner": (
            {"model": value["model"], "rover": value["rover"], **sensors}
            if value["planner"] == "true"
            else None
        ),
        "terrain_map": (
            {"model": value["model"], "rover": value["rover"]} if value["map"] == "true" else None
        ),
        "dashboard": {} if value["dashboard"] == "true" else None,
        "recorder": (
            {"output": value["output"], "topics": value["topics"]}
            if value["record"] == "true"
            else None
        ),
    }
    given = {
        name: {key: given for key, given in entries.items() if given != ""}
        for name, entries in wanted.items()
        if entries is not None
    }
    seen = viewers(value, track_width or 0.0) if value["rviz"] == "true" else []
    if value["composed"] != "true":
        return [*(_node(name, value, entries) for name, entries in given.items()), *seen]
    alone = [_node(name, value, given.pop(name)) for name in SEPARATE if name in given]
    return [_together(value, given), *alone, *seen]


def _number(value: dict[str, str], name: str, unit: str) -> float | str:
    """Return an argument as a number; empty where it is not given."""
    text = value[name]
    try:
        return float(text) if text else ""
    except ValueError:
        message = f"{name}:={text}: expected a number of {unit}"
        raise ValueError(message) from None


def _node(name: str, value: dict[str, str], given: dict[str, Any]) -> Node:
    return _process(
        name,
        value,
        parameters=[*_file(value["config"], name), given | _clock(value)],
        remappings=[
            *([("velocity", value["velocity"])] if name == "slip_source" else []),
            *remappings(value),
        ],
    )


def _together(value: dict[str, str], given: dict[str, dict[str, Any]]) -> Node:
    """Return the process of all these nodes; what launch adds at the end is for all of them."""
    arguments = []
    for name, entries in given.items():
        arguments += [name, "--ros-args"]
        for path in _file(value["config"], name):
            arguments += ["--params-file", path]
        for key, text in entries.items():
            arguments += ["-p", f"{key}:={json.dumps(text)}"]  # quoted: ROS reads YAML
        if name == "slip_source":
            arguments += ["-r", f"velocity:={value['velocity']}"]
    return _process(
        "onboard",
        value,
        arguments=[*arguments, "all"],
        parameters=[_clock(value)],
        remappings=remappings(value),
    )


def _clock(value: dict[str, str]) -> dict[str, bool]:
    return {"use_sim_time": value["use_sim_time"] == "true"}


def _process(executable: str, value: dict[str, str], **what: Any) -> Node:
    return Node(
        package="terrain_estimator",
        executable=executable,
        namespace=value["namespace"],
        **what,
        output="screen",
        respawn=value["respawn"] == "true",
        respawn_delay=seconds(value, "respawn_delay"),
        sigterm_timeout=PATIENCE_S,
        sigkill_timeout=PATIENCE_S,
    )


def _file(folder: str, name: str) -> list[str]:
    """Return the node's parameter file, where the folder has one."""
    if folder and not Path(folder).is_dir():
        message = f"config:={folder}: no such folder"
        raise FileNotFoundError(message)
    path = Path(folder, f"{name}.yaml")
    return [str(path)] if folder and path.is_file() else []
