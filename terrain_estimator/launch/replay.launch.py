# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Start the nodes of one rover on a recording, played by `ros2 bag play`.

For example: ros2 launch terrain_estimator replay.launch.py bag:=bags/first

They live in the recording's time. Ends when the player ends. For the estimates alone `ros2 run
terrain_estimator replay` is faster, and exact.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    EmitEvent,
    ExecuteProcess,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir

from terrain_estimator.nodes.common.launching import ONE_ROVER, TOPICS, declared
from terrain_estimator.offline.topic_mapping import absolute
from terrain_estimator.topics import INPUT_TYPES

ROVER = {
    "namespace": (
        "",
        "of all nodes, and of topics, also in the bag, whose names do not begin with /",
    ),
    **ONE_ROVER,
    "rover": (
        "",
        "name or YAML file of the rover, for other names of its wheels; empty: the model's",
    ),
    "record": ("false", "record inputs and the new outputs to another bag"),
    "output": ("", "folder of that bag, must not exist; empty: bags/<UTC time>"),
    **TOPICS,
}
ARGUMENTS = {
    "bag": (
        None,
        "folder of the recording; where topics in it have other names, give these as odom:=/name",
    ),
    "rate": ("1.0", "how many times faster than it was recorded"),
    "delay": ("5.0", "[s] in which the nodes start, before the player begins"),
    **ROVER,
}


def generate_launch_description() -> LaunchDescription:
    """Start the nodes of a rover and the player; stop the nodes when the player has ended."""
    given = [(name, LaunchConfiguration(name)) for name in ROVER]
    rover = IncludeLaunchDescription(
        [ThisLaunchFileDir(), "/rover.launch.py"],
        launch_arguments=[*given, ("use_sim_time", "true")],
    )
    return LaunchDescription([*declared(ARGUMENTS), rover, OpaqueFunction(function=_player)])


def _player(context: LaunchContext) -> list[ExecuteProcess | RegisterEventHandler]:
    """Play the inputs alone: the recorded estimates would mix with the new ones."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    topics = [absolute(value[name], value["namespace"]) for name in INPUT_TYPES]
    options = [
        "--clock",
        "100",
        "--rate",
        value["rate"],
        "--delay",
        value["delay"],
        "--disable-keyboard-controls",
    ]
    player = ExecuteProcess(
        cmd=["ros2", "bag", "play", value["bag"], *options, "--topics", *topics], output="screen"
    )
    end = OnProcessExit(
        target_action=player, on_exit=[EmitEvent(event=Shutdown(reason="the recording has ended"))]
    )
    return [player, RegisterEventHandler(end)]
