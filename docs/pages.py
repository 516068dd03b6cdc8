# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write the pages that follow from the code, and the marks of measured figures: ``make pages``.

A test compares the files with what this module writes.
"""

from functools import partial
from pathlib import Path

from docs.advice import WHEN
from docs.provenance import ROOT, refreshed
from rover_parameters.parameters import table, template
from rover_sim_node.config import SimulatorConfig
from terrain_estimator.config.dashboard import DashboardConfig
from terrain_estimator.config.estimator import EstimatorNodeConfig
from terrain_estimator.config.map import MapConfig
from terrain_estimator.config.planner import PlannerConfig
from terrain_estimator.config.recorder import RecorderConfig
from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.config.watch import WatchConfig
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

Nodes read their parameters at the start. Set them one by one,

    ros2 run terrain_estimator estimator --ros-args -p use_torque:=false -p prior.soil:=loose_sand

or from a file:

    # a template: all current values, with their meanings
    ros2 run terrain_estimator estimator --dump-config > estimator.yaml
    ros2 run terrain_estimator estimator --ros-args --params-file estimator.yaml

`terrain_estimator/config` has such a file for each node that runs on a rover (not for `simulator`
and `watch`). Its comments say when to change which parameter. The files are installed in
`share/terrain_estimator/config`.

## Changes at run time

`estimator` and `recorder` are managed nodes and read their parameters each time they are
configured. Set them while the node is unconfigured or inactive. The change takes effect at the
next `configure`:

    ros2 lifecycle set /estimator deactivate
    ros2 lifecycle set /estimator cleanup
    ros2 param set /estimator model paper_rover
    ros2 lifecycle set /estimator configure
    ros2 lifecycle set /estimator activate

- A value of another type or out of its range is refused at once. Whether the values fit together is
  checked by `configure`, so that you can set both parts of a prior one by one.
- While the node is active a change is refused, except that of `gate_probability`, which takes
  effect with the next observation. The fingerprint of the configuration in `estimator_health`
  follows.
- `auto_start` is read-only, since only the start of the process reads it.
- `planner`, `terrain_map`, `slip_source`, `dashboard`, `watch` and `simulator` are not managed
  nodes: their parameters are read-only. Start them anew with other values.

## Errors

These are errors:

- an unknown or misspelt name, at any level of a file; the message suggests the nearest known one,
- a value of another type or out of its range (an int is accepted where a float is expected),
- a file without a section for the node. In a namespace the section is `/rover1/estimator`, or
  `/**`.

`replay` and `find_missing_effect` take the estimator's parameters, by `-p NAME:=VALUE` and from the
same files. Every estimate, the health messages, and the metadata of recordings and replays contain
the sha256 of the values in force.

In addition there are ROS's own parameters, by their exact names: `use_sim_time`,
`start_type_description_service` and, for `estimator`, `planner`, `slip_source` and `terrain_map`,
`qos_overrides` ([messages.md](messages.md#topics-and-their-quality-of-service)).
"""
_FILE = """# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
#
# All parameters of {node} with their defaults, for nodes of that name in any namespace.
# Copy this file and keep the lines that you change:
#   ros2 run terrain_estimator {node} --ros-args --params-file {node}.yaml
#   ros2 launch terrain_estimator rover.launch.py config:=FOLDER        (a folder of such files)
# Written by `make pages`: change the code, not this file.
"""
_DIAGNOSTICS = """# Diagnostics

`estimator`, `recorder` and `slip_source` publish `/diagnostics`
(`diagnostic_msgs/msg/DiagnosticArray`) once a second by the steady clock, from their start and in
every lifecycle state. Each check has one status, named `NODE: CHECK [TOPIC]`, whose `values` have
the keys `value` and `unit`. To plot one in Foxglove:

    /diagnostics.status[:]{name=="/estimator: latency"}.values[0].value

The check `runtime` also has the keys `runtime` (`compiled` or `torchscript`), `runtime_reason` (why
it is not the compiled core; empty where it is) and `configuration_sha256`, to which it belongs. The
recorder writes them into the bag ([recording.md](recording.md#the-bag)).

`slip_source` has the check `refused` only, for its pairs of wheel rates and velocity.

`estimator_health` summarises the checks of the estimator's inputs and updates: `level` is the worst
level, `summary` describes the checks that have it.

A problem that lasts five seconds is logged once, and once more when it is over. Before any data
arrive, one line names all inputs that are silent for the same reason.

A level applies when the quantity is above the limit of that level. An unknown quantity (NaN) is no
fault.
"""


def parameters_page() -> str:
    """Return the page of all parameters, from their definitions."""
    sections = [f"## {name}\n\n{table(config)}\n" for name, config in NODES.items()]
    return "\n".join([_HEAD + _PARAMETERS, *sections])


def diagnostics_page() -> str:
    """Return the page of all thresholds, from the checks that apply them."""
    return f"{_HEAD}{_DIAGNOSTICS}\n{checks()}\n"


def parameter_file(node: str) -> str:
    """Return the parameter file of a node that a launch file starts."""
    return f"{_FILE.format(node=node)}{template(f'/**/{node}', NODES[node](), WHEN[node])}\n"


FILES = "../terrain_estimator/config"
PAGES = {"parameters.md": parameters_page, "diagnostics.md": diagnostics_page} | {
    f"{FILES}/{node}.yaml": partial(parameter_file, node) for node in WHEN
}

MEASURED = [ROOT / "README.md", *sorted(FOLDER.glob("*.md"))]
"""Pages that may hold measured figures."""

if __name__ == "__main__":
    for name, page in PAGES.items():
        (FOLDER / name).write_text(page(), encoding="utf-8")
    for path in MEASURED:
        path.write_text(refreshed(path.read_text(encoding="utf-8")), encoding="utf-8")
