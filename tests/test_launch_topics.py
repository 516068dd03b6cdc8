# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files of a rover and of a recording take the name of every topic; RViz."""

import dataclasses
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from rover_parameters.records import ConfigError
from terrain_estimator.model.metadata import model_path, read_metadata, write_metadata
from terrain_estimator.nodes.onboard import divided
from terramechanics.description.urdf import to_urdf
from terramechanics.presets import load_rover
from terramechanics.vehicle.wheel_places import WheelPlaces
from tests.launch_stand_in import Kept, declared, started

ROOT = Path(__file__).parents[1]
ROVER = ROOT / "terrain_estimator/launch/rover.launch.py"
REPLAY = ROVER.with_name("replay.launch.py")
NEEDED: dict[Path, dict[str, str]] = {ROVER: {}, REPLAY: {"bag": "bags/first", "record": "true"}}
"""Launch files that take topics, and what starts the same nodes with each."""
ALL = {"planner": "true", "map": "true", "dashboard": "true"}
DOCUMENTED = set(
    re.findall(
        r"^\| `(/?[\w/]+)` \| `[\w/]+` \| \w+ \|",
        (ROOT / "docs/messages.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
)
ARGUMENT = {"ground_truth/terrain": "ground_truth", "/diagnostics": "diagnostics"}
"""Arguments with another name than their topic."""
both_files = pytest.mark.parametrize("path", NEEDED, ids=lambda path: path.name)


def nodes(path: Path = ROVER, /, **arguments: str) -> dict[str, Kept]:
    found = started(path, **NEEDED.get(path, {}), **arguments)
    return {node.named["executable"]: node for node in found if "executable" in node.named}


@both_files
def test_every_topic_of_the_table_is_an_argument_but_tf_which_follows_the_namespace(
    path: Path,
) -> None:
    arguments = declared(path)
    topics = DOCUMENTED - {"/tf"}
    assert len(topics) > 12
    assert {ARGUMENT.get(topic, topic) for topic in topics} <= set(arguments)


@both_files
@pytest.mark.parametrize("topic", sorted(DOCUMENTED - {"/tf"}))
def test_a_topic_that_is_named_has_that_name_in_every_node(topic: str, path: Path) -> None:
    found = nodes(path, **ALL, **{ARGUMENT.get(topic, topic): "/other/name"})
    assert len(found) == 5
    for node in found.values():
        assert node.named["remappings"] == [(topic, "/other/name")]


@both_files
def test_without_names_nothing_is_remapped(path: Path) -> None:
    found = nodes(path, **ALL)
    assert len(found) == 5
    assert all(node.named["remappings"] == [] for node in found.values())


def test_the_inputs_of_a_recording_are_played_by_the_names_that_the_nodes_read() -> None:
    """A relative name is in the namespace; outputs are not played, whatever they are called."""
    names = {"odom": "/odometry/filtered", "imu": "imu/data", "terrain_estimate": "/ground"}
    found = started(REPLAY, **NEEDED[REPLAY], namespace="/rover1/", **names)
    (command,) = (each.named["cmd"] for each in found if "cmd" in each.named)
    assert command[command.index("--topics") + 1 :] == [
        "/rover1/wheel_slip",
        "/rover1/wheel_sinkage",
        "/odometry/filtered",
        "/rover1/joint_states",
        "/rover1/imu/data",
    ]


def test_names_hold_for_nodes_in_one_process_beside_the_velocity_of_slip_source() -> None:
    given = {"odom": "/odometry/filtered", "velocity": "v", "rover": "mars_rover"}
    alone, together = nodes(**given), nodes(**given, composed="true")
    name = ("odom", "/odometry/filtered")
    assert alone["slip_source"].named["remappings"] == [("velocity", "v"), name]
    assert together["onboard"].named["remappings"] == [name]
    assert list(divided(together["onboard"].named["arguments"]))[-1] == "all"


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"imu": ""}, "imu:=: give the name of a topic"),
        ({"terrain_map": "odom"}, "terrain_map:=odom: this is the name of odom, too"),
    ],
)
@both_files
def test_names_that_cannot_be_are_refused(path: Path, given: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        nodes(path, **given)


def test_rviz_comes_with_the_model_of_the_rover_and_our_configuration() -> None:
    found = nodes(rviz="true", namespace="rover1", joint_states="/platform/joints", model="")
    assert {"robot_state_publisher", "rviz2"} <= set(found)
    publisher, viewer = found["robot_state_publisher"], found["rviz2"]
    expected = [
        ("/tf", "tf"),
        ("/tf_static", "tf_static"),
        ("joint_states", "/platform/joints"),
    ]
    for node in (publisher, viewer):
        assert node.named["remappings"] == expected
        assert (node.named["namespace"], node.named["package"]) == (
            "rover1",
            node.named["executable"],
        )
    (parameters,) = publisher.named["parameters"]
    text = parameters["robot_description"].positional[0]
    assert ET.fromstring(text).get("name") == "mars_rover"
    assert Path(viewer.named["arguments"][1]).is_file()


def test_the_rover_in_rviz_is_the_one_that_is_named() -> None:
    found = nodes(rviz="true", rover="paper_rover", model="paper_rover")
    (parameters,) = found["robot_state_publisher"].named["parameters"]
    assert parameters["robot_description"].positional[0] == to_urdf(load_rover("paper_rover"))


def test_the_rover_in_rviz_is_as_wide_and_steered_as_the_model_by_wheel_says(
    tmp_path: Path,
) -> None:
    mars = read_metadata(model_path("mars_rover").with_suffix(".json"))
    steered = ("front_left", "front_right")
    places = WheelPlaces.of(mars.rover, 0.9, steered)
    write_metadata(tmp_path / "m.json", dataclasses.replace(mars, wheel_places=places))
    model = tmp_path / "m.pt"
    model.touch()
    renamed = load_rover("mars_rover[a,b,c,d,e,f]")
    for given, expected in (
        ({}, to_urdf(mars.rover, track_width=0.9, steered=steered)),
        ({"track_width": "1.1"}, to_urdf(mars.rover, track_width=1.1, steered=steered)),
        (
            {"rover": "mars_rover[a,b,c,d,e,f]"},
            to_urdf(renamed, track_width=0.9, steered=("a", "b")),
        ),
    ):
        found = nodes(rviz="true", model=str(model), **given)
        (parameters,) = found["robot_state_publisher"].named["parameters"]
        assert parameters["robot_description"].positional[0] == expected
        names = [joint.get("name") for joint in ET.fromstring(expected).iter("joint")]
        assert sum(f"{name}".endswith("_steering") for name in names) == 2


def test_a_drive_has_its_tf_in_its_namespace_and_hands_rviz_on() -> None:
    found = nodes(ROVER.with_name("drive.launch.py"), namespace="rover1", rviz="true")
    assert found["simulator"].named["remappings"] == [("/tf", "tf"), ("/tf_static", "tf_static")]
    assert "rviz2" in found
    assert "rviz2" not in nodes(ROVER.with_name("drive.launch.py"))
