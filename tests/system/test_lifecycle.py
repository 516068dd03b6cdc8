# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimator and recorder as managed nodes: states, diagnostics, and a saved state."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from mcap.reader import make_reader
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from msg_defs.msg import EstimatorHealth, TerrainEstimate, WheelSlip
from terrain_estimator.bags import BagReader
from terrain_estimator.model.metadata import MODELS
from terrain_estimator.model.model_file import load_model
from terrain_estimator.nodes.common import message_types
from terrain_estimator.offline.state_files import read_state
from terrain_estimator.topics import INPUT_TYPES
from tests.drives import Event, drive_messages
from tests.live import live_pipeline
from tests.system.listening import Listener
from tests.system.processes import Process, Starter
from tests.system.waiting import wait_until


def change(listener: Listener, node: str, transition: int) -> bool:
    request = ChangeState.Request(transition=Transition(id=transition))
    return bool(listener.call(ChangeState, f"{node}/change_state", request).success)


def state(listener: Listener, node: str) -> str:
    return str(listener.call(GetState, f"{node}/get_state", GetState.Request()).current_state.label)


def status(messages: list[Any], name: str) -> Any:
    """Return the newest status of that name."""
    return next(
        (
            each
            for message in reversed(messages)
            for each in message.status
            if each.name.endswith(name)
        ),
        None,
    )


def test_what_cannot_be_configured_stays_alive_and_can_be_once_it_is_mended(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    estimator = start(
        "terrain_estimator", "estimator", "--ros-args", "-p", f"model:={tmp_path}/model.pt"
    )
    diagnostics = listener.collect(DiagnosticArray, "/diagnostics")
    estimator.wait_for_output(
        r"cannot configure: model '.*model.pt': no such file.*the node stays unconfigured"
    )
    assert state(listener, "estimator") == "unconfigured"
    listener.spin_until(
        lambda: status(diagnostics, "lifecycle"), "a diagnosis comes in this state too"
    )
    assert status(diagnostics, "lifecycle").level == b"\x02"
    assert "no such file" in status(diagnostics, "lifecycle").message
    assert not change(
        listener, "estimator", Transition.TRANSITION_ACTIVATE
    )  # not a transition of this state
    for suffix in (".pt", ".json"):
        shutil.copy(MODELS / f"mars_rover{suffix}", tmp_path / f"model{suffix}")
    assert change(listener, "estimator", Transition.TRANSITION_CONFIGURE)
    assert state(listener, "estimator") == "inactive"
    assert "ready" not in estimator.output
    for _ in range(2):
        assert change(listener, "estimator", Transition.TRANSITION_ACTIVATE)
        listener.spin_until(
            lambda: listener.node.count_subscribers("wheel_slip") == 1, "it has subscribed"
        )
        assert change(listener, "estimator", Transition.TRANSITION_DEACTIVATE)
        listener.spin_until(
            lambda: listener.node.count_subscribers("wheel_slip") == 0, "it has unsubscribed"
        )
    assert estimator.output.count("ready: model") == 2
    assert change(listener, "estimator", Transition.TRANSITION_CLEANUP)
    assert state(listener, "estimator") == "unconfigured"
    assert change(listener, "estimator", Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert estimator.wait() == 0
    assert "Traceback" not in estimator.output


def test_a_recorder_writes_while_it_is_active_and_notes_who_estimated(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    parameters = [
        "auto_start:=false",
        f"output:={folder}",
        "topics:=[wheel_slip, estimator_health]",
    ]
    recorder = start(
        "terrain_estimator",
        "recorder",
        "--ros-args",
        *(word for each in parameters for word in ("-p", each)),
    )
    assert state(listener, "recorder") == "unconfigured"
    assert change(listener, "recorder", Transition.TRANSITION_CONFIGURE)
    for count in (1, 2):
        assert change(listener, "recorder", Transition.TRANSITION_ACTIVATE)
        slips, health = (
            listener.publisher(WheelSlip, "wheel_slip"),
            listener.publisher(EstimatorHealth, "estimator_health"),
        )
        slips.publish(WheelSlip(sequence=count))
        health.publish(
            EstimatorHealth(model_id="m", model_sha256="ab", configuration_sha256=f"c{count}")
        )
        wait_until(lambda count=count: recorded(folder) == 2 * count, "both are recorded")  # type: ignore[misc]
        assert change(listener, "recorder", Transition.TRANSITION_DEACTIVATE)
        # the next publishers must not match the subscriptions of now
        for topic in ("wheel_slip", "estimator_health"):
            listener.spin_until(
                lambda topic=topic: not listener.node.count_subscribers(topic),  # type: ignore[misc]
                "it has unsubscribed",
            )
        slips.publish(WheelSlip(sequence=100))
        for publisher in (slips, health):
            listener.node.destroy_publisher(publisher)
    assert change(listener, "recorder", Transition.TRANSITION_CLEANUP)
    assert recorder.interrupt() == 0
    with BagReader(folder) as reader:
        assert [
            reader.decode(message).sequence for message in reader.messages(["/wheel_slip"])
        ] == [1, 2]
    with (folder / "run_0.mcap").open("rb") as file:
        notes = [(record.name, record.metadata) for record in make_reader(file).iter_metadata()]
    assert [
        note["configuration_sha256"] for name, note in notes if name == "terrain_estimator"
    ] == ["c1", "c2"]
    [own] = [note for name, note in notes if name == "recorder"]
    assert own["fsync_interval"] == "1.0"
    assert len(own["configuration_sha256"]) == 64


def recorded(folder: Path) -> int:
    with BagReader(folder) as reader:
        return reader.span.count


def drive(listener: Listener, estimator: Process, events: list[Event], expected: int) -> list[Any]:
    """Publish the events to an estimator; its estimates.

    One that was killed still counts as a reader and as a publisher: this one must say that it
    hears, and be heard.
    """
    estimates, health = (
        listener.collect(TerrainEstimate, "terrain_estimate"),
        listener.collect(EstimatorHealth, "estimator_health"),
    )
    publishers = {
        topic: listener.publisher(message_types.message_class(kind), topic)
        for topic, kind in INPUT_TYPES.items()
    }
    estimator.wait_for_output("matched all inputs")
    listener.wait_for_messages(health, 1)
    for index in range(0, len(events), 50):
        for topic, _, message in events[index : index + 50]:
            publishers[topic].publish(message)
        listener.wait_for_messages(estimates, min(expected, (index + 50) // 5))
    for publisher in publishers.values():
        listener.node.destroy_publisher(publisher)
    return estimates


def with_state(start: Starter, path: Path) -> Process:
    process = start(
        "terrain_estimator",
        "estimator",
        "--ros-args",
        "-p",
        f"state.file:={path}",
        "-p",
        "state.autosave_period:=0.2",
    )
    process.wait_for_output("ready", timeout=60.0)
    return process


def test_a_killed_node_goes_on_where_it_was_and_refuses_a_damaged_state(
    start: Starter, listener: Listener, tmp_path: Path
) -> None:
    path = tmp_path / "ground.state"
    events = list(drive_messages(message_types.make, 6.0))
    first = with_state(start, path)
    drive(listener, first, events[:200], 40)
    model = load_model()
    wait_until(
        lambda: path.exists() and read_state(path, model.sha256)["counts"][1] == 40,
        "the state is kept by itself",
    )
    saved = path.read_bytes()
    first.kill()
    # DDS takes a killed process for alive for 20 s: its subscriptions would be taken for those of
    # the next
    listener.spin_until(
        lambda: not listener.node.count_subscribers("wheel_slip"),
        "the killed node is forgotten",
        timeout=60.0,
    )
    second = with_state(start, path)
    assert f"going on from the state in {path}" in second.output
    last = drive(listener, second, events[200:], 20)[-1]
    assert listener.call(Trigger, "estimator/save_state", Trigger.Request()).success
    assert read_state(path, model.sha256)["counts"][1] == 60
    assert listener.call(Trigger, "estimator/load_state", Trigger.Request()).success
    pipeline = live_pipeline()
    whole = [answer for topic, _, message in events for answer in pipeline.add(topic, message)][
        -1
    ].update.estimate
    assert (last.observations_used, last.cohesion, last.tan_phi) == (60, *whole.mean.tolist())
    np.testing.assert_array_equal(last.covariance, whole.covariance.ravel())
    assert second.interrupt() == 0
    path.write_bytes(saved[:-1])
    third = with_state(start, path)
    assert f"{path}: is damaged" in third.output
    assert f"put aside as {path}.refused" in third.output


def test_it_says_from_the_start_what_it_will_never_hear(start: Starter, listener: Listener) -> None:
    sensor = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    listener.node.create_publisher(WheelSlip, "wheel_slip", sensor)
    listener.node.create_publisher(WheelSlip, "odom", 5)
    diagnostics = listener.collect(DiagnosticArray, "/diagnostics")
    estimator = start("terrain_estimator", "estimator", "--ros-args", "-p", "use_sim_time:=true")
    name = listener.node.get_fully_qualified_name()
    expected = {
        "publishers wheel_slip": f"incompatible quality of service with {name}",
        "publishers odom": f"{name} publishes msg_defs/msg/WheelSlip, not nav_msgs/msg/Odometry",
        "required input odom": "no data on odom since the start",
    }
    for check, words in expected.items():
        listener.spin_until(
            lambda check=check, words=words: (
                words in getattr(status(diagnostics, check), "message", "")
            ),  # type: ignore[misc]
            f"{check} is judged",
            seen=lambda check=check: status(diagnostics, check),  # type: ignore[misc]
        )
        assert status(diagnostics, check).level in {b"\x02", b"\x03"}
    estimator.wait_for_output("no data on odom since the start")
    assert {each.key for each in status(diagnostics, "required input odom").values} == {
        "value",
        "unit",
    }
    estimator.wait_for_output("use_sim_time is set, but no /clock came for [0-9]+ s")
    assert estimator.output.count("no data on odom") == 1


def test_a_service_that_cannot_do_it_says_why(start: Starter, listener: Listener) -> None:
    start("terrain_estimator", "estimator", "--ros-args", "-p", "auto_start:=false")
    for name, words in {
        "reset": "not configured",
        "save_state": "state.file",
        "load_state": "state.file",
    }.items():
        answer = listener.call(Trigger, f"estimator/{name}", Trigger.Request())
        assert (answer.success, words in answer.message) == (False, True), answer
