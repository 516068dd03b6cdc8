# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator's node in the test's own process: transitions in which something raises, and states that are refused."""

import threading
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from terrain_estimator.model_file import LoadedModel, load_model
from terrain_estimator.nodes.estimator import EstimatorNode
from terrain_estimator.pipeline import Pipeline
from tests.system.listening import Listener


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "ground.state"


@pytest.fixture(scope="module")
def model() -> LoadedModel:
    return load_model()


@pytest.fixture
def node(listener: Listener, path: Path, model: LoadedModel, monkeypatch: pytest.MonkeyPatch) -> EstimatorNode:
    monkeypatch.setattr("terrain_estimator.nodes.estimator.load_model", lambda _: model)  # once for all transitions
    return listener.host(partial(EstimatorNode, threading.Event()), parameter_overrides=[Parameter("state.file", value=str(path))])


def held(node: EstimatorNode) -> tuple[int, int, int]:
    """Subscriptions, timers and threads that a node holds."""
    threads = [thread for thread in threading.enumerate() if thread.name == "saved state"]
    return len(list(node.subscriptions)), len(list(node.timers)), len(threads)


def trigger(node: EstimatorNode, transition: str) -> None:
    getattr(node, f"trigger_{transition}")()


def failing(*_: Any, **__: Any) -> None:
    raise RuntimeError("by the test")


def test_a_transition_that_raises_leaves_nothing_half_done(node: EstimatorNode, monkeypatch: pytest.MonkeyPatch) -> None:
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
    node.end()
    assert (node.state, held(node)) == ("unconfigured", idle)


def test_a_state_that_is_refused_is_put_aside_and_the_node_estimates(
    node: EstimatorNode, path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path.write_bytes(b"not a state")
    node.start()
    assert node.state == "active"
    assert path.with_name("ground.state.refused").read_bytes() == b"not a state"
    said = capfd.readouterr().err
    assert f"{path}: is no state file" in said
    assert "put aside" in said
    node.end()
    good = path.read_bytes()  # kept at the end
    node.start()
    assert path.with_name("ground.state.loaded").read_bytes() == good
    node.end()
