# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What runs the model of a live node: in its log, in /diagnostics and in the recording."""

import threading
from functools import partial
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.parameter import Parameter

from msg_defs.msg import TerrainEstimate
from terrain_estimator.bags import BagReader
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import AUTO, TORCHSCRIPT, EstimatorConfig
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.nodes.common import message_types
from terrain_estimator.nodes.estimator import EstimatorNode
from terrain_estimator.nodes.recorder import RecorderNode
from terrain_estimator.topics import INPUT_TYPES
from tests.drives import drive_messages
from tests.system.listening import Listener
from tests.terrain_estimator.compiled.altered_cores import model_with_core
from tests.terrain_estimator.compiled.built_cores import needs_core
from tests.terrain_estimator.compiled.test_finding import shifted

pytestmark = needs_core
SECONDS = 1.5


def hosted(listener: Listener, **parameters: str) -> EstimatorNode:
    given = [Parameter(name, value=value) for name, value in parameters.items()]
    node = listener.host(partial(EstimatorNode, threading.Event()), parameter_overrides=given)
    node.start()
    assert node.state == "active"
    return node


def told(listener: Listener) -> DiagnosticStatus:
    """Return the status of the runtime in the next message of /diagnostics that has one."""
    heard = listener.collect(DiagnosticArray, "/diagnostics")

    def runtime() -> list[DiagnosticStatus]:
        return [
            each
            for message in heard
            for each in message.status
            if each.name == "/estimator: runtime"
        ]

    return listener.spin_until(runtime, "the runtime is told")[-1]


def record(listener: Listener, folder: Path) -> RecorderNode:
    values = {"output": str(folder), "topics": "estimator_health /diagnostics"}
    given = [Parameter(name, value=value) for name, value in values.items()]
    node = listener.host(partial(RecorderNode, threading.Event()), parameter_overrides=given)
    node.start()
    return node


def identity(listener: Listener, recorder: RecorderNode, folder: Path) -> dict[str, str]:
    """Return what a recording says of the estimator, two seconds later: two messages of each."""
    wanted = recorder.received + 6
    listener.spin_until(lambda: recorder.received >= wanted, "health and diagnostics are recorded")
    recorder.end()
    with BagReader(folder) as reader:
        return reader.metadata["terrain_estimator"]


def test_a_node_with_a_core_that_differs_runs_torchscript_and_says_so_everywhere(
    listener: Listener, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = model_with_core(tmp_path, "mine", shifted(0, 1e-8))
    recorder = record(listener, tmp_path / "run")
    node = hosted(listener, model=str(path))
    why = load(str(path), AUTO).why
    assert "differs from TorchScript" in why
    said = capfd.readouterr().err
    assert "[WARN]" in said
    assert f"the model runs by TorchScript: {why}" in said
    assert "(torchscript) for rover" in said

    estimates = listener.collect(TerrainEstimate, "terrain_estimate")
    publishers = {
        topic: listener.publisher(message_types.message_class(kind), topic)
        for topic, kind in INPUT_TYPES.items()
    }
    reference = Pipeline(
        load(str(path), TORCHSCRIPT).model, EstimatorConfig(model=str(path), runtime=TORCHSCRIPT)
    )
    expected = []
    for topic, _, message in drive_messages(message_types.make, SECONDS):
        publishers[topic].publish(message)
        for answer in reference.add(topic, message):
            expected.append(answer.update.estimate.mean.tolist())
            listener.wait_for_messages(estimates, len(expected))
    assert len(expected) == 10 * SECONDS
    assert [[each.cohesion, each.tan_phi] for each in estimates] == expected

    status = told(listener)
    assert status.level == DiagnosticStatus.WARN
    assert f"the model runs by torchscript: {why}" in status.message
    found = identity(listener, recorder, tmp_path / "run")
    assert found["runtime"] == "torchscript"
    assert found["runtime_reason"] == why
    assert found["configuration_sha256"] == estimates[-1].configuration_sha256
    node.end()


@pytest.mark.parametrize(
    ("wanted", "reason"),
    [("auto", ""), ("compiled", ""), ("torchscript", "the parameter runtime asks for it")],
)
def test_a_runtime_that_was_asked_for_is_told_and_no_fault(
    listener: Listener, tmp_path: Path, wanted: str, reason: str
) -> None:
    recorder = record(listener, tmp_path / "run")
    node = hosted(listener, runtime=wanted)
    name = "torchscript" if reason else "compiled"
    status = told(listener)
    assert status.level == DiagnosticStatus.OK
    assert status.message == f"the model runs by {name}" + (f": {reason}" if reason else "")
    found = identity(listener, recorder, tmp_path / "run")
    assert (found["topic"], found["runtime"], found["runtime_reason"]) == (
        "/estimator_health", name, reason,
    )  # fmt: skip
    node.end()
