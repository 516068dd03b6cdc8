# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Start two simulated rovers, each in its namespace and on its ground.

For example: ros2 launch terrain_estimator two_rovers.launch.py duration:=30.0

For real rovers start rover.launch.py once in each namespace. Ends when both drives have ended.
"""

from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir

from terrain_estimator.nodes.common.launching import SHARED, declared

ROVERS = ("first", "second")
BOTH = {
    "schedule": (
        "S1",
        "how the wheels are driven: S1, S2, S3, S4, or cmd_vel to follow velocity commands",
    ),
    "duration": ("60.0", "[s] of the drives; 0: until Ctrl-C"),
    **SHARED,
    "record": ("true", "record inputs and outputs of each to a bag of its own, bags/<namespace>"),
}
ARGUMENTS = {
    "first": ("rover1", "namespace of the first rover"),
    "second": ("rover2", "namespace of the second rover"),
    "first_soil": ("loose_sand", "preset or YAML file of the first rover's ground"),
    "second_soil": ("regolith", "preset or YAML file of the second rover's ground"),
    "first_state": (
        "",
        (
            "file in which the first rover's estimator keeps what it knows for the next drive;"
            " empty: it forgets at the end"
        ),
    ),
    "second_state": ("", "the same of the second rover's, another file"),
    "output": ("bags", "folder that holds the two bags"),
    **BOTH,
}


def generate_launch_description() -> LaunchDescription:
    """Include the drive of one rover twice, each with a seed of its own."""
    return LaunchDescription(
        [*declared(ARGUMENTS), *(_drive(which, seed) for seed, which in enumerate(ROVERS))]
    )


def _drive(which: str, seed: int) -> GroupAction:
    """Include a drive in a group, which keeps its arguments from the other rover."""
    namespace = LaunchConfiguration(which)
    given = {
        "namespace": namespace,
        "soil": LaunchConfiguration(f"{which}_soil"),
        "seed": str(seed),
        "state": LaunchConfiguration(f"{which}_state"),
        "output": [LaunchConfiguration("output"), "/", namespace],
        **{name: LaunchConfiguration(name) for name in BOTH},
    }
    return GroupAction(
        [
            IncludeLaunchDescription(
                [ThisLaunchFileDir(), "/drive.launch.py"], launch_arguments=given.items()
            )
        ]
    )
