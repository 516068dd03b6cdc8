# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Writes the pages that follow from the code:  make pages. A test compares them."""

from functools import partial
from pathlib import Path

from docs.advice import WHEN
from rover_parameters.parameters import table, template
from rover_sim_node.config import SimulatorConfig
from terrain_estimator.config import (
    DashboardConfig,
    EstimatorNodeConfig,
    MapConfig,
    PlannerConfig,
    RecorderConfig,
    SlipSourceConfig,
    WatchConfig,
)
from terrain_estimator.messaging.diagnostics import table as checks

FOLDER = Path(__file__).parent
_HEAD = """<!--
SPDX-FileCopyrightText: 2026 The terrain_estimator authors
SPDX-License-Identifier: Apache-2.0

Written by `make pages`: change the code, not this page.
-->
"""
NODES = {
    "dashboard": DashboardConfig,
    "estimator": EstimatorNodeConfig,
    "planner": PlannerConfig,
    "recorder": RecorderConfig,
    "simulator": SimulatorConfig,
    "slip_source": SlipSourceConfig,
    "terrain_map": MapConfig,
    "watch": WatchConfig,
}
_PARAMETERS = """# Parameters

All are read when a node starts, and stay as they are. They are given one by one, `--ros-args -p NAME:=VALUE`, or by a file:

    ros2 run terrain_estimator estimator --dump-config > estimator.yaml      # a template: all values in force, with their meanings
    ros2 run terrain_estimator estimator --ros-args --params-file estimator.yaml

`terrain_estimator/config` has such a file of each node that runs on a rover (not of `simulator` and `watch`), with when to change what;
it is installed in `share/terrain_estimator/config`.

An unknown or misspelt name is an error that says which is the nearest known one, at every level of a file; so are a value of another type
or out of its range, and a file that has no section for the node (in a namespace the section is `/rover1/estimator`, or `/**`). An int is
taken where a float is meant. `replay` and `find_missing_effect` take the estimator's by `-p NAME:=VALUE` and from the same files. The
sha256 of the values in force is in every estimate, in the health, and in the metadata of recordings and replays.

Beside those below there are ROS's own, by their exact names: `use_sim_time`, `start_type_description_service`, and of some nodes
`qos_overrides` ([messages.md](messages.md#topics-and-their-quality-of-service)).
"""
_FILE = """# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
#
# All parameters of {node} at their defaults, for nodes of that name in any namespace. Copy it and keep the lines that you change:
#   ros2 run terrain_estimator {node} --ros-args --params-file {node}.yaml
#   ros2 launch terrain_estimator rover.launch.py config:=FOLDER        (of such files)
# Written by `make pages`: change the code, not this file.
"""
_DIAGNOSTICS = """# Diagnostics

Estimator, recorder and slip source publish `/diagnostics` (`diagnostic_msgs/msg/DiagnosticArray`) once a second by the steady clock,
from their start and in every state of their life cycle: one status for each check, its name `NODE: CHECK [TOPIC]`, its value among
the `values`. The slip source has `refused` alone, of its pairs of wheel rates and velocity. The estimator's `estimator_health` has
the worst of the checks of its inputs and updates as `level`, and those of that level in words as `summary`. What is wrong for five
seconds is in the log, once, and once more when it is over.

A level holds where the quantity is above the level's limit. A quantity that is not known (NaN) is no fault.
"""


def parameters_page() -> str:
    """The page of all parameters, from their definitions."""
    sections = [f"## {name}\n\n{table(config)}\n" for name, config in NODES.items()]
    return "\n".join([_HEAD + _PARAMETERS, *sections])


def diagnostics_page() -> str:
    """The page of all thresholds, from the checks that apply them."""
    return f"{_HEAD}{_DIAGNOSTICS}\n{checks()}\n"


def parameter_file(node: str) -> str:
    """The parameter file of a node that a launch file starts."""
    return f"{_FILE.format(node=node)}{template(f'/**/{node}', NODES[node](), WHEN[node])}\n"


FILES = "../terrain_estimator/config"
PAGES = {"parameters.md": parameters_page, "diagnostics.md": diagnostics_page} | {
    f"{FILES}/{node}.yaml": partial(parameter_file, node) for node in WHEN
}

if __name__ == "__main__":
    for name, page in PAGES.items():
        (FOLDER / name).write_text(page(), encoding="utf-8")
