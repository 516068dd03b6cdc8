# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Several nodes in one process do what they do in processes of their own."""

from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from sensor_msgs.msg import PointCloud2

from msg_defs.msg import TerrainEstimate, TractionAdvice, WheelSlip
from rover_parameters.records import ConfigError
from terrain_estimator.cli import replay
from terrain_estimator.nodes.onboard import divided
from tests.system.listening import LATCHED, Listener
from tests.system.processes import Starter
from tests.system.test_light_nodes import libraries

DRIVE_S = 8


def test_the_whole_set_drives_records_and_loads_neither_torch_nor_scipy(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    process = start(
        "terrain_estimator", "onboard",
        "slip_source", "--ros-args", "-r", "velocity:=odom", "-r", "wheel_slip:=own_slip",
        "-p", "rover:=mars_rover",
        "estimator", "terrain_map", "planner", "--ros-args", "-p", "period:=1.0", "--",
        "recorder", "--ros-args", "-p", f"output:={bag}",
        "all", "--ros-args", "-r", "__ns:=/rover1",
    )  # fmt: skip
    estimates = listener.collect(TerrainEstimate, "/rover1/terrain_estimate")
    advice = listener.collect(TractionAdvice, "/rover1/traction_advice")
    slips = listener.collect(WheelSlip, "/rover1/own_slip")
    clouds = listener.collect(PointCloud2, "/rover1/terrain_map", LATCHED)
    process.wait_for_output("estimator.*ready: .*(compiled)", timeout=60.0)
    simulator = start(
        "rover_sim_node", "simulator", "--ros-args", "-r", "__ns:=/rover1",
        "-p", f"duration:={float(DRIVE_S)}", "-p", "wait_for_subscribers:=3",
    )  # fmt: skip
    listener.wait_for_messages(estimates, 10 * DRIVE_S - 1, timeout=90.0)
    listener.spin_until(
        lambda: advice and clouds and len(slips) >= 10 * DRIVE_S - 5, "the others publish, too"
    )
    assert simulator.wait(30.0) == 0
    assert libraries(process.pid) == set()
    assert len(advice) <= DRIVE_S + 1  # its own parameter holds: one a second
    assert process.interrupt(60.0) == 0
    arguments = [str(bag), "--compare", "--namespace", "/rover1", "--out", str(tmp_path / "out")]
    assert replay.main(arguments) == 0


def test_a_node_that_is_shut_down_leaves_the_others(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    process = start(
        "terrain_estimator", "onboard", "estimator",
        "recorder", "--ros-args", "-p", f"output:={bag}",
    )  # fmt: skip
    process.wait_for_output("recorder.*waiting for", timeout=60.0)

    def shut_down(node: str) -> None:
        state = Transition.TRANSITION_ACTIVE_SHUTDOWN
        request = ChangeState.Request(transition=Transition(id=state))
        assert listener.call(ChangeState, f"/{node}/change_state", request).success

    shut_down("recorder")
    process.wait_for_output("recorded 0 messages|recorded [0-9]+ messages")
    names = listener.node.get_node_names
    listener.spin_until(lambda: "recorder" not in names(), "the recorder is gone")
    assert process.running
    assert "estimator" in names()
    assert (bag / "metadata.yaml").is_file()
    shut_down("estimator")
    assert process.wait(30.0) == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "no node is named: give some of recorder, slip_source, estimator"),
        ("all --ros-args -r __ns:=/a", "no node is named"),
        ("estimater", r"'estimater': did you mean estimator\?"),
        ("--ros-args -r __ns:=/a planner", "'--ros-args'.*--help shows the order"),
        ("planner 7", "'7'"),
        ("planner --ros-args -p period:=1.0 -- 7", "'7'"),
        ("planner estimator planner", "planner is named twice"),
    ],
)
def test_words_that_say_nothing_are_refused(words: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        divided(words.split())


def test_every_node_gets_its_own_arguments() -> None:
    words = "estimator --ros-args --params-file planner -p model:=x recorder terrain_map"
    others = "--ros-args -r map:=m -- planner all --ros-args --enable-rosout-logs --log-level info"
    assert divided([*words.split(), *others.split()]) == {
        "estimator": ["--ros-args", "--params-file", "planner", "-p", "model:=x"],
        "recorder": [],
        "terrain_map": ["--ros-args", "-r", "map:=m", "--"],
        "planner": [],
        "all": ["--ros-args", "--enable-rosout-logs", "--log-level", "info"],
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["planner", "--ros-args", "-p", "model:=nothing"], "planner: model 'nothing'"),
        (
            ["terrain_map", "estimator", "all", "--ros-args", "-p", "spacing:=0.2"],
            "estimator: unknown parameter spacing",
        ),
        (
            ["terrain_map", "planner", "all", "--ros-args", "-r", "__node:=one"],
            "two nodes have one name: /one, /one",
        ),
    ],
)
def test_wrong_parameters_end_with_the_name_of_the_node(
    start: Starter, words: list[str], message: str
) -> None:
    process = start("terrain_estimator", "onboard", *words)
    assert process.wait(60.0) == 2
    assert message in process.output
