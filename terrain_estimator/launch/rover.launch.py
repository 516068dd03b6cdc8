# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Start the nodes of one rover.

For example: ros2 launch terrain_estimator rover.launch.py velocity:=visual_odometry planner:=true

The rover publishes what docs/messages.md says. The other launch files include this one. Without a
ROS installation start the executables by `ros2 run`.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from terrain_estimator.nodes.common.launching import ONE_ROVER, declared, seconds

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
    "record": ("true", "record inputs and outputs to a bag"),
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
        "recorder": ({"output": value["output"]} if value["record"] == "true" else None),
    }
    return [_node(name, value, given) for name, given in wanted.items() if given is not None]


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
