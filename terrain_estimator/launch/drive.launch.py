# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated drive with estimator and recorder:  ros2 launch terrain_estimator drive.launch.py schedule:=S4 namespace:=rover1.

Ends when the simulator ends. For an installed ROS 2; without one start the three executables by `ros2 run`.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {
    "namespace": ("", "of all topics and nodes"),
    "rover": ("mars_rover", "preset or YAML file"),
    "soil": ("loose_sand", "preset or YAML file"),
    "schedule": ("S1", "how the wheels are driven"),
    "duration": ("60.0", "[s] of the drive"),
    "seed": ("0", "of the sensor noise"),
    "model": ("", "name of an installed model or path of a file; empty: mars_rover"),
    "output": ("", "folder of the bag; empty: bags/<UTC time>"),
}


def generate_launch_description() -> LaunchDescription:
    """Starts simulator, estimator and recorder; stops the other two when the simulator has ended."""
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    chosen = {name: value[name] for name in ("rover", "soil", "schedule", "duration", "seed")}
    # The drive waits until the estimator and the recorder have matched, so that neither misses its beginning.
    simulator = _node("rover_sim_node", "simulator", chosen, {"wait_for_subscribers": 2})
    others = [
        _node("terrain_estimator", "estimator", {"model": value["model"]}),
        _node("terrain_estimator", "recorder", {"output": value["output"]}),
    ]
    end = RegisterEventHandler(OnProcessExit(target_action=simulator, on_exit=[EmitEvent(event=Shutdown(reason="the drive has ended"))]))
    declared = [DeclareLaunchArgument(name, default_value=default, description=text) for name, (default, text) in ARGUMENTS.items()]
    return LaunchDescription([*declared, *others, simulator, end])


def _node(package: str, executable: str, chosen: dict[str, LaunchConfiguration], fixed: dict[str, int] | None = None) -> Node:
    kinds = {"duration": float, "seed": int}
    typed = {name: ParameterValue(value, value_type=kinds.get(name, str)) for name, value in chosen.items()}
    parameters = [typed | (fixed or {})]
    return Node(package=package, executable=executable, namespace=LaunchConfiguration("namespace"), parameters=parameters, output="screen")
