# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Start a simulated drive with the nodes of one rover.

For example: ros2 launch terrain_estimator drive.launch.py schedule:=S4 planner:=true

Ends when the simulator ends; where several drives are included, when all have ended.
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    EmitEvent,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir
from launch_ros.actions import Node

from rover_parameters.files import read_parameters
from terrain_estimator.nodes.common.launching import ONE_ROVER, TF, declared, seconds

SIMULATOR = {
    "rover": ("mars_rover", "preset or YAML file; another one needs its model, too"),
    "soil": ("loose_sand", "preset or YAML file"),
    "schedule": (
        "S1",
        "how the wheels are driven: S1, S2, S3, S4, or cmd_vel to follow velocity commands",
    ),
    "duration": ("60.0", "[s] of the drive; 0: until Ctrl-C"),
    "seed": ("0", "of drive and noise"),
}
ROVER = {
    "namespace": ("", "of all topics and nodes"),
    **ONE_ROVER,
    "record": ("true", "record inputs and outputs to a bag"),
    "state": (
        "",
        (
            "file in which the estimator keeps what it knows for the next drive; empty: it forgets"
            " at the end"
        ),
    ),
}
ARGUMENTS = SIMULATOR | ROVER


def generate_launch_description() -> LaunchDescription:
    """Start the simulator and the nodes of a rover; stop these when the simulator has ended."""
    # In a group, so that what it is given does not become ours; without a rover its nodes go by
    # that of the model.
    given = [("rover", ""), *((name, LaunchConfiguration(name)) for name in ROVER)]
    rover = GroupAction(
        [
            IncludeLaunchDescription(
                [ThisLaunchFileDir(), "/rover.launch.py"], launch_arguments=given
            )
        ]
    )
    return LaunchDescription([*declared(ARGUMENTS), rover, OpaqueFunction(function=_simulator)])


def _simulator(context: LaunchContext) -> list[Node | RegisterEventHandler]:
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    chosen = {
        "rover": value["rover"],
        "soil": value["soil"],
        "schedule": value["schedule"],
        "duration": seconds(value, "duration"),
        "seed": int(value["seed"]),
        # The drive waits until the nodes that read all of its topics have matched, so that none
        # misses its beginning.
        "wait_for_subscribers": (
            (value["record"] == "true") + sum(_takes_imu(name, value) for name in _readers(value))
        ),
    }
    simulator = Node(
        package="rover_sim_node",
        executable="simulator",
        namespace=value["namespace"],
        parameters=[chosen],
        remappings=TF,
        output="screen",
    )
    running: set[Node] = getattr(context.locals, "drives", set())
    running.add(simulator)
    context.extend_globals({"drives": running})

    def ended(*_: object) -> list[EmitEvent]:
        running.discard(simulator)
        return [] if running else [EmitEvent(event=Shutdown(reason="the drive has ended"))]

    return [simulator, RegisterEventHandler(OnProcessExit(target_action=simulator, on_exit=ended))]


def _readers(value: dict[str, str]) -> list[str]:
    return ["estimator", "planner"] if value["planner"] == "true" else ["estimator"]


def _takes_imu(node: str, value: dict[str, str]) -> bool:
    """Return whether a node subscribes to the imu; else the drive would wait in vain."""
    path, name = (
        Path(value["config"], f"{node}.yaml"),
        f"/{value['namespace'].strip('/')}/{node}".replace("//", "/"),
    )
    return not (value["config"] and path.is_file()) or bool(
        read_parameters(path, name).get("use_imu", True)
    )
