# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The launch files start existing programs with existing parameters, topics and arguments."""

import importlib.util
import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from docs.advice import WHEN
from docs.pages import NODES
from rover_parameters.files import parameter_files, parse_assignment, read_parameters
from rover_parameters.parameters import configure, parameters
from rover_parameters.records import ConfigError
from terrain_estimator.nodes.onboard import divided
from terrain_estimator.topics import INPUT_TYPES
from tests.launch_stand_in import Kept, declared, started

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "terrain_estimator/launch"
CONFIG = ROOT / "terrain_estimator/config"
FILES = sorted(FOLDER.glob("*.launch.py"))
PLATFORM = {"model": "four.pt", "velocity": "/visual_odometry"}
NEEDED = {"replay.launch.py": {"bag": "bags/first"}, "platform.launch.py": PLATFORM}
RESPAWN = {"respawn": "true", "respawn_delay": "0.5"}
EVERYTHING = {
    "planner": "true",
    "map": "true",
    "dashboard": "true",
    "record": "true",
    "config": str(CONFIG),
}
every_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)


def nodes(name: str, **arguments: str) -> dict[str, Kept]:
    """Return the nodes of a launch file by namespace and executable."""
    found = started(FOLDER / name, **arguments)
    return {
        f"{node.named['namespace']}/{node.named['executable']}": node
        for node in found
        if "executable" in node.named
    }


def values(node: Kept) -> dict[str, Any]:
    """Return the parameters of a node, checked by their definition; those of a file come first."""
    given: dict[str, Any] = {}
    name = node.named["executable"]
    for source in node.named["parameters"]:
        given |= (
            read_parameters(Path(source), f"/{node.named['namespace']}/{name}".replace("//", "/"))
            if isinstance(source, str)
            else source
        )
    configure(NODES[name], {key: value for key, value in given.items() if key != "use_sim_time"})
    return given


@every_file
def test_every_argument_is_described_and_every_node_exists_with_its_parameters(path: Path) -> None:
    described = declared(path)
    assert all(len(text) > 10 for text in described.values()), described
    asked = NEEDED.get(path.name, {}) | {
        name: value for name, value in EVERYTHING.items() if name in described
    }
    found = nodes(path.name, **asked)
    assert len(found) >= 4
    for node in found.values():
        text = (ROOT / node.named["package"] / "setup.py").read_text(encoding="utf-8")
        assert f'"{node.named["executable"]} = ' in text
        values(node)


@every_file
def test_the_real_library_loads_it(path: Path) -> None:
    if importlib.util.find_spec("launch") is None or importlib.util.find_spec("launch_ros") is None:
        pytest.skip(
            "ROS's launch library is not installed: it has no wheel; tests above take a stand-in"
        )
    sources = importlib.import_module("launch.launch_description_sources")
    description = sources.get_launch_description_from_python_launch_file(str(path))
    assert {
        each.name: each.description for each in description.get_launch_arguments()
    }.keys() >= declared(path).keys()


def test_a_rover_alone_has_an_estimator_and_a_recorder_that_are_left_at_their_defaults() -> None:
    assert {name: values(node) for name, node in nodes("rover.launch.py").items()} == {
        "/estimator": {"use_sim_time": False},
        "/recorder": {"use_sim_time": False},
    }


@pytest.mark.parametrize("name", ["rover.launch.py", "drive.launch.py"])
def test_a_state_that_is_named_outlives_a_restart(name: str) -> None:
    assert values(nodes(name, state="ground.state")["/estimator"])["state.file"] == "ground.state"


@every_file
def test_a_misspelt_argument_is_refused_and_the_right_one_named(path: Path) -> None:
    needed = NEEDED.get(path.name, {})
    with pytest.raises(
        ConfigError, match=rf"{path.name} has no argument plannr .*did you mean planner\?"
    ):
        started(path, **needed, plannr="true")
    assert started(path, **needed, **{"launch-prefix": "nice"})


def test_arguments_of_a_foreign_file_that_includes_ours_are_left_alone(tmp_path: Path) -> None:
    foreign = tmp_path / "rover.launch.py"
    foreign.write_text(
        "from launch import LaunchDescription\n"
        "from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription\n"
        "def generate_launch_description():\n"
        "    return LaunchDescription([\n"
        "        DeclareLaunchArgument('wheels', default_value='6', description=''),\n"
        f"        IncludeLaunchDescription('{FOLDER}/rover.launch.py', launch_arguments=[]),\n"
        "    ])\n"
    )
    assert len(started(foreign, wheels="4")) == 2


@every_file
def test_respawn_starts_the_nodes_of_the_rover_anew(path: Path) -> None:
    needed = NEEDED.get(path.name, {})
    for given, expected in (({}, (False, 2.0)), (RESPAWN, (True, 0.5))):
        found = nodes(path.name, **needed, **given)
        assert {
            (node.named["respawn"], node.named["respawn_delay"])
            for node in found.values()
            if node.named["executable"] != "simulator"
        } == {expected}
        assert not any(
            node.named.get("respawn") for name, node in found.items() if name.endswith("simulator")
        )
    with pytest.raises(ConfigError, match="respawn_delay:=soon: expected a number of seconds"):
        nodes(path.name, **needed, respawn_delay="soon")


@every_file
def test_composed_nodes_get_the_arguments_that_they_get_alone(path: Path) -> None:
    needed = NEEDED.get(path.name, {})
    asked = {name: each for name, each in EVERYTHING.items() if name in declared(path)} | needed
    alone = nodes(path.name, **asked)
    together = nodes(path.name, **asked, composed="true")
    ours = {name for name in alone if not name.endswith(("simulator", "dashboard"))}
    for name, node in together.items():
        if not name.endswith("onboard"):
            assert values(node) == values(alone[name])
            continue
        namespace = name.removesuffix("onboard")
        for part, arguments in divided(node.named["arguments"]).items():
            if part == "all":
                continue
            single = alone[f"{namespace}{part}"]
            ours.remove(f"{namespace}{part}")
            files = parameter_files(arguments)
            assert [str(file) for file in files] == [
                source for source in single.named["parameters"] if isinstance(source, str)
            ]
            given = dict(
                parse_assignment(value)
                for flag, value in itertools.pairwise(arguments)
                if flag == "-p"
            )
            assert given | node.named["parameters"][0] == single.named["parameters"][-1]
    assert not ours


def test_composed_names_are_quoted_and_the_velocity_is_remapped() -> None:
    found = nodes("rover.launch.py", composed="true", velocity="v", rover="7", namespace="rover1")
    arguments = found["rover1/onboard"].named["arguments"]
    assert found["rover1/onboard"].named["namespace"] == "rover1"
    own = divided(arguments)
    assert own["slip_source"] == ["--ros-args", "-p", 'rover:="7"', "-r", "velocity:=v"]
    assert arguments[-1] == "all"


def test_a_velocity_brings_the_source_of_slip() -> None:
    found = nodes("rover.launch.py", velocity="visual_odometry", planner="true", rover="mars_rover")
    assert found["/slip_source"].named["remappings"] == [("velocity", "visual_odometry")]
    assert values(found["/slip_source"])["rover"] == "mars_rover"
    assert all(
        not node.named["remappings"] for name, node in found.items() if name != "/slip_source"
    )


def test_a_platform_is_read_by_its_topics_and_joint_names() -> None:
    asked = PLATFORM | {"wheels": "fl,fr,rl,rr", "track_width": "0.55", "planner": "true"}
    found = nodes("platform.launch.py", **asked, wheel_sinkage="/adapter", cmd_vel="/cmd")
    topics = {
        ("wheel_sinkage", "/adapter"),
        ("odom", "/odom"),
        ("imu", "/imu/data"),
        ("joint_states", "/joint_states"),
    }
    for name in ("/estimator", "/planner", "/slip_source", "/recorder"):
        own = {("velocity", "/visual_odometry")} if name == "/slip_source" else set()
        assert set(found[name].named["remappings"]) == topics | own
        if name != "/recorder":
            assert values(found[name])["rover"] == "four_wheel_rover[fl,fr,rl,rr]"
    assert values(found["/slip_source"])["track_width"] == 0.55
    recorded = values(found["/recorder"])["topics"].split()
    assert {*INPUT_TYPES, "/cmd", "/visual_odometry", "traction_advice"} <= set(recorded)
    assert "terrain_map" not in recorded
    together = nodes("platform.launch.py", **asked, composed="true")["/onboard"]
    assert set(together.named["remappings"]) == topics - {("wheel_sinkage", "/adapter")}
    assert "velocity:=/visual_odometry" in divided(together.named["arguments"])["slip_source"]


@pytest.mark.parametrize("composed", ["false", "true"])
def test_a_platform_without_sinkage_and_contact_angle_sensors_needs_no_adapter(
    composed: str,
) -> None:
    asked = PLATFORM | {"contact_angle_sd": "0.05", "planner": "true", "composed": composed}
    found = nodes("platform.launch.py", **asked)
    expected: dict[str, dict[str, Any]] = {
        "slip_source": {"empty_sinkage": True},
        "estimator": {"contact_angle_sd": 0.05, "use_sinkage": False},
        "planner": {"use_sinkage": False},
    }
    if composed == "true":
        arguments = divided(found["/onboard"].named["arguments"])
        for name, entries in expected.items():
            for key, value in entries.items():
                assert f"{key}:={json.dumps(value)}" in arguments[name]
        return
    for name, entries in expected.items():
        assert entries.items() <= values(found[f"/{name}"]).items()


def test_an_empty_sinkage_needs_the_node_that_publishes_it() -> None:
    with pytest.raises(ValueError, match=r"contact_angle_sd:=0\.05: give velocity:=, too"):
        nodes("rover.launch.py", contact_angle_sd="0.05")
    with pytest.raises(ValueError, match="wheel_sinkage:=/adapter: give one of them"):
        nodes("platform.launch.py", **PLATFORM, contact_angle_sd="0.05", wheel_sinkage="/adapter")
    with pytest.raises(ValueError, match="contact_angle_sd:=flat: expected a number of radians"):
        nodes("platform.launch.py", **PLATFORM, contact_angle_sd="flat")


def test_a_track_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="track_width:=wide: expected a number of metres"):
        nodes("platform.launch.py", **PLATFORM, track_width="wide")


@pytest.mark.parametrize(
    ("given", "readers"),
    [({}, 2), ({"record": "false"}, 1), ({"planner": "true", "map": "true"}, 3)],
)
def test_a_drive_waits_for_every_node_that_reads_all_of_its_topics(
    given: dict[str, str], readers: int
) -> None:
    found = nodes("drive.launch.py", **given)
    assert values(found["/simulator"])["wait_for_subscribers"] == readers
    assert len({"/estimator", "/recorder", "/planner"} & set(found)) == readers


@pytest.mark.parametrize("namespace", ["", "rover1"])
def test_a_drive_does_not_wait_for_nodes_that_leave_the_imu_out(
    namespace: str, tmp_path: Path
) -> None:
    """The recorder alone subscribed to it, and after 30 s the simulator gave up."""
    for name in ("estimator", "planner"):
        (tmp_path / f"{name}.yaml").write_text(
            f"/**/{name}: {{ros__parameters: {{use_imu: false}}}}\n"
        )
    found = nodes("drive.launch.py", planner="true", config=str(tmp_path), namespace=namespace)
    assert values(found[f"{namespace}/simulator"])["wait_for_subscribers"] == 1


def test_the_simulated_rover_is_not_handed_on_as_that_of_the_estimates() -> None:
    found = nodes("drive.launch.py", rover="paper_rover", model="paper_rover")
    assert values(found["/simulator"])["rover"] == "paper_rover"
    assert values(found["/estimator"]) == {"model": "paper_rover", "use_sim_time": False}


def test_two_rovers_have_their_own_names_grounds_seeds_and_bags() -> None:
    found = nodes(
        "two_rovers.launch.py",
        second="b",
        output="out",
        first_state="a.state",
        second_state="~/b.state",
    )
    for key, expected in {"soil": ["loose_sand", "regolith"], "seed": [0, 1]}.items():
        assert [values(found[f"{name}/simulator"])[key] for name in ("rover1", "b")] == expected
    assert [values(found[f"{name}/recorder"])["output"] for name in ("rover1", "b")] == [
        "out/rover1",
        "out/b",
    ]
    assert [values(found[f"{name}/estimator"])["state.file"] for name in ("rover1", "b")] == [
        "a.state",
        "~/b.state",
    ]


def test_a_recording_is_played_to_nodes_that_live_in_its_time() -> None:
    found = nodes("replay.launch.py", bag="bags/first", namespace="rover1", planner="true")
    assert all(values(node)["use_sim_time"] for node in found.values())
    (player,) = (
        each
        for each in started(FOLDER / "replay.launch.py", bag="bags/first", namespace="rover1")
        if "cmd" in each.named
    )
    command = player.named["cmd"]
    assert command[:4] == ["ros2", "bag", "play", "bags/first"]
    assert command[command.index("--topics") + 1 :] == [f"/rover1/{name}" for name in INPUT_TYPES]


def test_the_check_finds_an_argument_that_an_included_file_does_not_have(tmp_path: Path) -> None:
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        (tmp_path / path.name).write_text(
            text.replace('    "state": (', '    "stat": (')
            if path.name == "drive.launch.py"
            else text
        )
    with pytest.raises(AssertionError, match=r"rover.launch.py has no argument {'stat'}"):
        started(tmp_path / "drive.launch.py")


def test_slip_is_not_made_with_the_wheel_radius_of_another_rover_than_the_models() -> None:
    with pytest.raises(ValueError, match="give rover:="):
        nodes("rover.launch.py", velocity="visual_odometry", model="paper_rover")
    found = nodes(
        "rover.launch.py", velocity="visual_odometry", model="paper_rover", rover="paper_rover"
    )
    assert values(found["/slip_source"])["rover"] == "paper_rover"


def test_a_folder_of_parameter_files_that_is_none_is_refused() -> None:
    with pytest.raises(FileNotFoundError, match="config:=nowhere"):
        nodes("rover.launch.py", config="nowhere")


@pytest.mark.parametrize("node", WHEN)
def test_every_parameter_of_a_file_has_advice_and_the_file_is_strict(
    node: str, tmp_path: Path
) -> None:
    assert set(WHEN[node]) == {each.name for each in parameters(NODES[node])}
    assert str(
        configure(NODES[node], read_parameters(CONFIG / f"{node}.yaml", f"/rover1/{node}"))
    ) == str(NODES[node]())
    spoilt = tmp_path / "p.yaml"
    first = next(iter(WHEN[node]))
    spoilt.write_text(
        (CONFIG / f"{node}.yaml")
        .read_text(encoding="utf-8")
        .replace(f"    {first}:", f"    {first}x:"),
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match=f"{first}x"):
        configure(NODES[node], read_parameters(spoilt, f"/{node}"))
