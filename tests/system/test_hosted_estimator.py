# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator's node inside the test: failing transitions, refused states, several rovers."""

import threading
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import MultiThreadedExecutor
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from msg_defs.msg import EstimatorHealth, TerrainEstimate
from terrain_estimator.files.atomic import write_file
from terrain_estimator.messaging.diagnostics import Level
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terrain_estimator.nodes.common import lifecycle, message_types, state_file
from terrain_estimator.nodes.estimator import EstimatorNode
from terrain_estimator.offline.state_files import read_state
from terrain_estimator.topics import INPUT_TYPES
from tests.drives import Event, drive_messages
from tests.live import live_pipeline
from tests.system.listening import Listener
from tests.system.processes import Starter

STEPS, RESET_AFTER = 20, 10
QUEUED_S = 0.3


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "ground.state"


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture
def node(listener: Listener, path: Path) -> EstimatorNode:
    return listener.host(
        partial(EstimatorNode, threading.Event()),
        parameter_overrides=[Parameter("state.file", value=str(path))],
    )


def held(node: EstimatorNode) -> tuple[int, int, int]:
    """Subscriptions, timers and threads that a node holds."""
    threads = [thread for thread in threading.enumerate() if thread.name == "saved state"]
    return len(list(node.subscriptions)), len(list(node.timers)), len(threads)


def trigger(node: EstimatorNode, transition: str) -> None:
    getattr(node, f"trigger_{transition}")()


def failing(*_: Any, **__: Any) -> None:
    raise RuntimeError("by the test")


def test_a_transition_that_raises_leaves_nothing_half_done(
    node: EstimatorNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    trigger(node, "configure")
    idle = held(node)
    subscribe, calls = node.create_subscription, []

    def third_fails(*arguments: Any, **options: Any) -> Any:
        calls.append(arguments)
        return failing() if len(calls) == 3 else subscribe(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(node, "create_subscription", third_fails)
        trigger(node, "activate")
    assert (node.state, held(node)) == ("inactive", idle)
    assert node.wrong == "cannot activate: RuntimeError: by the test"
    trigger(node, "activate")
    assert (node.state, node.wrong) == ("active", "")
    assert held(node) == (idle[0] + 5, idle[1] + 2, 1)
    with monkeypatch.context() as patch:
        patch.setattr(Pipeline, "flush", failing)
        patch.setattr(Pipeline, "save", failing)
        trigger(node, "deactivate")
    assert (node.state, held(node), node.failures) == ("inactive", idle, 2)
    trigger(node, "activate")
    assert node.state == "active"
    node._publish_health()
    node.end()
    node.start()
    node._publish_health()
    assert "0 callbacks failed" in [finding.text for finding in node.findings()], (
        "they were told before"
    )
    node.end()
    assert (node.state, held(node)) == ("unconfigured", (*idle[:2], 0))


def test_a_clock_that_stops_is_told_from_one_that_never_came(
    listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    steady_s = [0.0]
    monkeypatch.setattr(lifecycle, "time", SimpleNamespace(monotonic=lambda: steady_s[0]))
    listener.host(
        partial(EstimatorNode, threading.Event()),
        parameter_overrides=[Parameter("use_sim_time", value=True)],
    )
    diagnostics = listener.collect(DiagnosticArray, "/diagnostics")
    clock = listener.publisher(Clock, "/clock")

    def judged(level: Level, words: str) -> bool:
        found = [
            each
            for message in diagnostics[-1:]
            for each in message.status
            if each.name.endswith(": clock")
        ]
        return any(each.level == bytes([level]) and words in each.message for each in found)

    steady_s[0] += 6.0
    listener.spin_until(
        lambda: judged(Level.ERROR, "no /clock came for 6 s"), "it waits for a clock"
    )
    clock.publish(Clock(clock=Time(sec=1)))
    listener.spin_until(lambda: judged(Level.OK, "/clock runs"), "the clock runs")
    steady_s[0] += 3.0
    listener.spin_until(
        lambda: judged(Level.WARN, "/clock stands still for 3 s"), "the clock is late"
    )
    clock.publish(Clock(clock=Time(sec=2)))
    listener.spin_until(lambda: judged(Level.OK, "/clock runs"), "the clock runs again")


def test_a_state_that_is_refused_is_put_aside_and_the_node_estimates(
    node: EstimatorNode, path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path.write_bytes(bytes(600))  # as a power cut leaves it
    node.start()
    assert node.state == "active"
    assert path.with_name("ground.state.refused").read_bytes() == bytes(600)
    said = capfd.readouterr().err
    assert f"{path}: is no state file" in said
    assert "put aside" in said
    node.end()
    good = path.read_bytes()  # kept at the end
    node.start()
    assert path.with_name("ground.state.loaded").read_bytes() == good
    node.end()
    path.write_bytes(good[:-1])
    node.start()
    assert [
        path.with_name(f"ground.state.refused{ending}").read_bytes() for ending in ("", "-2")
    ] == [bytes(600), good[:-1]]
    node.end()
    path.write_bytes(b"")
    node.start()
    assert path.with_name("ground.state.refused-3").read_bytes() == b""
    node.end()


def test_a_second_estimator_with_one_state_file_is_not_configured_until_the_first_lets_go_of_it(
    node: EstimatorNode, listener: Listener, path: Path
) -> None:
    node.start()
    parameters = [Parameter("state.file", value=str(path))]
    other = listener.host(
        partial(EstimatorNode, threading.Event()),
        namespace="/rover2",
        parameter_overrides=parameters,
    )
    other.start()
    assert (node.state, other.state) == ("active", "unconfigured")
    assert f"{path}: another estimator keeps its state there" in other.wrong
    node.end()
    other.start()
    assert other.state == "active"
    other.end()


@pytest.mark.parametrize("content", [b"# Rover terrain estimation", b"PK\x03\x04\x00\x00", b"{}"])
def test_a_file_that_never_was_a_state_is_left_alone(
    node: EstimatorNode, path: Path, content: bytes
) -> None:
    path.write_bytes(content)
    node.start()
    assert (node.state, path.read_bytes()) == ("unconfigured", content)
    assert node.wrong.endswith(
        "ground.state is another file, no state: it is left alone; name another one by the"
        " parameter state.file"
    )
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_a_state_file_in_a_folder_that_is_not_there_is_refused_before_the_drive(
    node: EstimatorNode, path: Path
) -> None:
    path.parent.rmdir()
    node.start()
    assert (node.state, f"there is no folder {path.parent}" in node.wrong) == ("unconfigured", True)
    path.parent.mkdir()
    node.start()
    assert node.state == "active"
    node.end()


def test_a_folder_that_is_named_as_state_file_is_left_where_it_is(
    node: EstimatorNode, path: Path
) -> None:
    (path / "bags").mkdir(parents=True)
    node.start()
    assert (node.state, node.wrong) == (
        "unconfigured",
        (
            f"cannot configure: {path} is a folder or a device: name a file by the parameter"
            " state.file"
        ),
    )
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    path.rename(path.with_name("data"))
    node.start()
    assert node.state == "active"
    node.end()


class Rover:
    """A namespace: what is published there, and what is heard from its estimator."""

    def __init__(self, listener: Listener, name: str, events: list[Event]) -> None:
        self._listener = listener
        self.name, self.events = name, events
        self.estimates = listener.collect(TerrainEstimate, f"/{name}/terrain_estimate")
        self.health = listener.collect(EstimatorHealth, f"/{name}/estimator_health")
        self._publishers = {
            topic: listener.publisher(message_types.message_class(kind), f"/{name}/{topic}")
            for topic, kind in INPUT_TYPES.items()
        }
        listener.spin_until(
            lambda: listener.node.count_publishers(f"/{name}/terrain_estimate"), f"{name} estimates"
        )

    def publish(self, step: int) -> None:
        for topic, _, message in self.events[
            step * len(INPUT_TYPES) : (step + 1) * len(INPUT_TYPES)
        ]:
            self._publishers[topic].publish(message)

    def reset(self) -> None:
        assert self._listener.call(
            Trigger, f"/{self.name}/estimator/reset", Trigger.Request()
        ).success

    def said(self) -> list[tuple[float, ...]]:
        return [
            (each.sequence, each.cohesion, each.tan_phi, *each.covariance)
            for each in self.estimates
        ]

    def counted(self) -> bool:
        """Return whether every topic has counted the messages meant for it."""
        return bool(self.health) and set(self.health[-1].input_received) == {STEPS}


def test_while_the_disk_hangs_it_estimates_and_serves_and_a_state_is_saved_once_it_answers(
    listener: Listener, path: Path, model: LoadedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    hangs, answers = threading.Event(), threading.Event()

    def write(path: Path, content: bytes) -> None:
        hangs.set()
        assert answers.wait(60.0)
        write_file(path, content)

    monkeypatch.setattr(state_file, "write_file", write)
    parameters = [Parameter("state.file", value=str(path))]
    node = listener.host(
        partial(EstimatorNode, threading.Event()),
        namespace="/rover1",
        parameter_overrides=parameters,
    )
    node.start()
    rover = Rover(listener, "rover1", list(drive_messages(message_types.make, 6.0)))
    client = listener.node.create_client(Trigger, "/rover1/estimator/save_state")
    listener.spin_until(client.service_is_ready, "the service is there")
    saved = client.call_async(Trigger.Request())
    listener.spin_until(hangs.is_set, "the state is being written")
    rover.publish(0)
    listener.wait_for_messages(rover.estimates, 1)
    rover.reset()
    assert not saved.done()
    rover.publish(1)
    threading.Event().wait(QUEUED_S)  # nobody serves the queue
    listener.spin_until(
        lambda: any(each.update_latency_max >= QUEUED_S for each in rover.health),
        "the wait in the queue is seen",
    )
    answers.set()
    listener.spin_until(saved.done, "the service has answered")
    assert (saved.result().success, saved.result().message) == (True, f"the state is in {path}")
    assert read_state(path, model.sha256)["counts"][1] == 0, "the state is that of the call"
    loaded = listener.call(Trigger, "/rover1/estimator/load_state", Trigger.Request())
    assert (loaded.success, loaded.message) == (True, f"going on from the state in {path}")
    for step in (2, 3, 4):
        rover.publish(step)
    trigger(node, "deactivate")  # what was published in this process is in its queues
    listener.wait_for_messages(rover.estimates, 5)
    node.end()


def alone(events: list[Event], *, reset: bool) -> list[tuple[float, ...]]:
    """Return the estimates of an estimator without others beside it."""
    pipeline = live_pipeline()
    said = []
    for index, (topic, _, message) in enumerate(events):
        if reset and index == RESET_AFTER * len(INPUT_TYPES):
            pipeline.reset()
        updates = [answer.update for answer in pipeline.add(topic, message)]
        said += [
            (
                each.sequence,
                *each.estimate.mean.tolist(),
                *each.estimate.covariance.ravel().tolist(),
            )
            for each in updates
        ]
    return said


def test_several_rovers_in_one_process_and_in_two_estimate_as_if_they_were_alone(
    start: Starter, listener: Listener
) -> None:
    other = start("terrain_estimator", "estimator", "--ros-args", "-r", "__ns:=/rover3")
    nodes = [
        listener.host(partial(EstimatorNode, threading.Event()), namespace=f"/rover{number}")
        for number in (1, 2)
    ]
    for node in nodes:
        node.start()
    other.wait_for_output("ready", timeout=60.0)
    events = list(drive_messages(message_types.make, 6.0))
    parts = [events[at : at + len(events) // 3] for at in range(0, len(events), len(events) // 3)]
    rovers = [Rover(listener, f"rover{number}", part) for number, part in enumerate(parts, start=1)]
    # the other process has matched our readers: no estimate is lost
    listener.wait_for_messages(rovers[2].health, 1)
    without_namespace = listener.collect(TerrainEstimate, "/terrain_estimate")
    for step in range(STEPS):
        if step == RESET_AFTER:
            rovers[0].reset()
        for rover in rovers:
            rover.publish(step)
        for rover in rovers:
            listener.wait_for_messages(rover.estimates, step + 1)
    assert [rover.said() for rover in rovers] == [
        alone(rover.events, reset=rover is rovers[0]) for rover in rovers
    ]
    assert len({rover.said()[-1] for rover in rovers}) == len(rovers), "the drives differ"
    assert without_namespace == []
    for rover in rovers:
        listener.spin_until(rover.counted, f"{rover.name} counts its own messages alone")
    assert [rover.health[-1].resets for rover in rovers] == [1, 0, 0]
    for node in nodes:
        node.end()


def test_in_an_executor_with_threads_a_service_waits_for_the_update(
    listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = listener.host(partial(EstimatorNode, threading.Event()), namespace="/rover1")
    node.start()
    rover = Rover(listener, "rover1", list(drive_messages(message_types.make, 0.1)))
    executor = MultiThreadedExecutor(2, context=node.context)
    executor.add_node(node)  # which takes it from the listener's
    done, resets = list[str](), threading.Event()
    add, reset = Pipeline.add, Pipeline.reset

    def slow(pipeline: Pipeline, topic: str, message: Any) -> Any:
        done.append("begun")
        resets.wait(QUEUED_S)
        answers = add(pipeline, topic, message)
        done.append("updated")
        return answers

    def said(pipeline: Pipeline) -> None:
        reset(pipeline)
        done.append("reset")
        resets.set()

    monkeypatch.setattr(Pipeline, "add", slow)
    monkeypatch.setattr(Pipeline, "reset", said)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    rover.events = rover.events[:1]
    rover.publish(0)
    listener.spin_until(lambda: done, "the update has begun")
    rover.reset()
    listener.spin_until(lambda: "updated" in done, "the update is done")
    assert done == ["begun", "updated", "reset"]
    executor.shutdown()
    spinning.join()
    node.end()
