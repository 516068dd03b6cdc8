# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""RViz's configuration shows topics that exist, with a quality of service that they offer."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from ament_index_python import get_package_share_directory

from rover_sim_node.config import SimulatorConfig
from terrain_estimator.messaging.map_track import POINT
from terramechanics.description.urdf import BODY_FRAME

ROOT = Path(__file__).parents[1]
FILE = ROOT / "terrain_estimator/rviz/rover.rviz"
CONTENT: dict[str, Any] = yaml.safe_load(FILE.read_text(encoding="utf-8"))["Visualization Manager"]
DISPLAYS: dict[str, dict[str, Any]] = {each["Class"]: each for each in CONTENT["Displays"]}
OFFERED = {
    topic: (kind, durability, int(depth))
    for topic, kind, durability, depth in re.findall(
        r"^\| `([\w/]+)` \| `([\w/]+)` \| \w+ \| [^|]+ \| reliable \| (\w+) \| (\d+) \|$",
        (ROOT / "docs/messages.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
}
SHOWN = {
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "Map": "nav_msgs/msg/OccupancyGrid",
    "Odometry": "nav_msgs/msg/Odometry",
}


@pytest.mark.parametrize("kind", SHOWN)
def test_a_display_shows_a_topic_of_its_type_with_the_quality_that_is_offered(kind: str) -> None:
    topic = DISPLAYS[f"rviz_default_plugins/{kind}"]["Topic"]
    assert OFFERED[topic["Value"]] == (
        SHOWN[kind],
        topic["Durability Policy"].lower().replace(" ", "_"),
        topic["Depth"],
    )
    assert topic["Reliability Policy"] == "Reliable"


def test_the_model_its_frames_and_what_colours_the_track_exist() -> None:
    model = DISPLAYS["rviz_default_plugins/RobotModel"]
    assert model["Description Topic"]["Value"] == "robot_description"
    assert CONTENT["Global Options"]["Fixed Frame"] == SimulatorConfig().odom_frame
    assert CONTENT["Views"]["Current"]["Target Frame"] == SimulatorConfig().body_frame == BODY_FRAME
    assert DISPLAYS["rviz_default_plugins/PointCloud2"]["Channel Name"] in (POINT.names or ())
    spaces = DISPLAYS["rviz_default_plugins/MarkerArray"]["Namespaces"]
    assert spaces == {"forces": True, "wheels": True}


def test_an_installed_workspace_has_it() -> None:
    installed = Path(get_package_share_directory("terrain_estimator"), "rviz")
    assert [path.name for path in installed.iterdir()] == [FILE.name]
    assert (installed / FILE.name).read_bytes() == FILE.read_bytes()
