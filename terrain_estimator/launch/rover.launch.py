# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Start the nodes of one rover.

For example: ros2 launch terrain_estimator rover.launch.py velocity:=visual_odometry planner:=true

The rover publishes what docs/messages.md says. The other launch files include this one. Without a
ROS installation start the executables by `ros2 run`.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from terrain_estimator.topics import RECORDED_TOPICS

SWITCH = ["true", "false"]
PATIENCE_S = "60"
"""[s] after Ctrl-C, in which the recorder compresses its bag."""
ARGUMENTS = {
    "namespace": ("", "of all topics and nodes"),
    "model": ("", "name of an installed model or path of a model file; empty: mars_rover"),
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
    "planner": ("false", "advise how fast to go and when to stop, on traction_advice"),
    "map": ("false", "publish the estimate along the track, on terrain_map"),
    "dashboard": (
        "false",
        "show all of it live in a browser, at http://127.0.0.1:8090 (docs/dashboard.md)",
    ),
    "record": (
        "true",
        "record inputs and outputs to a bag; of planner and map, too, whatever recorder.yaml says",
    ),
    "output": ("", "folder of the bag, must not exist; empty: bags/<UTC time>"),
    "state": (
        "",
        (
            "file in which the estimator keeps what it knows over restarts, one a rover; empty: as"
            " config says, else it forgets at the end"
        ),
    ),
    "config": (
        "",
        (
            "folder of parameter files estimator.yaml, planner.yaml, ...; begin with a copy of"
            " share/terrain_estimator/config; empty: none"
        ),
    ),
    "use_sim_time": (
        "false",
        "take the time of /clock, as with a simulator or a bag that is played",
    ),
}


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, and start the chosen nodes."""
    declared = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=text,
            choices=SWITCH if default in SWITCH else None,
        )
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])


def _nodes(context: LaunchContext) -> list[Node]:
    """Return the chosen nodes; an empty value leaves a parameter to the file or its default."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    if value["velocity"] and value["model"] and not value["rover"]:
        message = (
            f"model:={value['model']} with velocity:=: give rover:=, too, since slip_source needs"
            " its wheel radius and knows no model"
        )
        raise ValueError(message)
    wanted = {
        "estimator": {
            "model": value["model"],
            "rover": value["rover"],
            "state.file": value["state"],
        },
        "slip_source": {"rover": value["rover"]} if value["velocity"] else None,
        "planner": (
            {"model": value["model"], "rover": value["rover"]}
            if value["planner"] == "true"
            else None
        ),
        "terrain_map": {} if value["map"] == "true" else None,
        "dashboard": {} if value["dashboard"] == "true" else None,
        "recorder": (
            {"output": value["output"], "topics": _topics(value)}
            if value["record"] == "true"
            else None
        ),
    }
    return [_node(name, value, given) for name, given in wanted.items() if given is not None]


def _topics(value: dict[str, str]) -> str:
    """Return all topics to record where planner or map run, else "" for the default."""
    more = [
        topic
        for switch, topic in (("planner", "traction_advice"), ("map", "terrain_map"))
        if value[switch] == "true"
    ]
    return " ".join([*RECORDED_TOPICS, *more]) if more else ""


def _node(name: str, value: dict[str, str], given: dict[str, str]) -> Node:
    chosen = {key: text for key, text in given.items() if text} | {
        "use_sim_time": value["use_sim_time"] == "true"
    }
    return Node(
        package="terrain_estimator",
        executable=name,
        namespace=value["namespace"],
        parameters=[*_file(value["config"], name), chosen],
        remappings=[("velocity", value["velocity"])] if name == "slip_source" else [],
        output="screen",
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
