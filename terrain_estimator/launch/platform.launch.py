# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Start the nodes of one rover on a platform such as the Husky, by its topics and joint names.

For example: ros2 launch terrain_estimator platform.launch.py model:=models/four_wheel_rover.pt
velocity:=/visual_odometry wheels:=front_left,front_right,rear_left,rear_right track_width:=0.55

slip_source makes wheel_slip of joint states and a velocity. Sinkage and contact angles come from
your adapter, for which the estimator waits; contact_angle_sd says that nothing measures them.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir

from terrain_estimator.nodes.common.launching import ONE_ROVER, declared
from terrain_estimator.topics import INPUT_TYPES, OUTPUT_TYPES

HANDED_ON = {
    **ONE_ROVER,
    "model": (None, "path of the model file of the rover (`train --rover ...`)"),
    "namespace": ("", "of all nodes and of topics that do not begin with /"),
    "velocity": (
        None,
        (
            "topic of a nav_msgs/Odometry along body x that slip is made of; not wheel odometry,"
            " whose slip is always zero"
        ),
    ),
    "odom": ("/odom", "topic of the odometry, nav_msgs/Odometry"),
    "imu": ("/imu/data", "topic of the imu, sensor_msgs/Imu"),
    "joint_states": ("/joint_states", "topic of the wheels' rates and torques"),
    "wheel_sinkage": ("wheel_sinkage", "topic of your adapter for sinkage and contact angles"),
    "contact_angle_sd": (
        "",
        (
            "[rad] where nothing measures sinkages and contact angles: deviation of the ground from"
            " the body's plane; empty: your adapter publishes wheel_sinkage"
        ),
    ),
    "track_width": ("", "[m] between left and right wheels, for slip in turns; empty: as straight"),
    "record": ("true", "record inputs, outputs and commands to a bag"),
    "state": ("", "file in which the estimator keeps what it knows over restarts; empty: none"),
    "use_sim_time": ("false", "take the time of /clock, as with a simulator"),
}
ARGUMENTS = {
    **HANDED_ON,
    "rover": ("four_wheel_rover", "name or YAML file of the rover"),
    "wheels": (
        "",
        (
            "names of the wheels' joints with commas, in the order of the rover file; empty: those"
            " of the rover file"
        ),
    ),
    "cmd_vel": ("/cmd_vel", "topic of the velocity commands, which is recorded too"),
}


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments, and start the nodes of the rover with them."""
    return LaunchDescription([*declared(ARGUMENTS), OpaqueFunction(function=_rover)])


def _rover(context: LaunchContext) -> list[IncludeLaunchDescription]:
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    recorded = [*INPUT_TYPES, *OUTPUT_TYPES, "estimator_health", "/diagnostics"]
    recorded += [value["velocity"], value["cmd_vel"]]
    recorded += ["traction_advice"] if value["planner"] == "true" else []
    recorded += ["terrain_map"] if value["map"] == "true" else []
    given = {
        **{name: value[name] for name in HANDED_ON},
        "rover": f"{value['rover']}[{value['wheels']}]" if value["wheels"] else value["rover"],
        "topics": " ".join(recorded),
    }
    return [
        IncludeLaunchDescription(
            [ThisLaunchFileDir(), "/rover.launch.py"], launch_arguments=given.items()
        )
    ]
