# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimating in a second process: the same answers, and no process left behind."""

import contextlib
import dataclasses
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terrain_estimator.bags import RawMessage, Types
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.model.model_file import load_model
from terrain_estimator.offline.estimation_process import Converted, answering
from terrain_estimator.outcome import Outcome
from terrain_estimator.topics import OUTPUT_TYPES
from tests.drives import drive_messages

CAUSE = RawMessage("/odom", "", 0, 0, b"")
LEAVING_S = 20.0
CHILD = """
import multiprocessing, sys
from terrain_estimator.offline.estimation_process import answering
with answering(None) as answered:
    print(multiprocessing.active_children()[0].pid, flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})


def batches(pipeline: Pipeline) -> Iterator[Converted]:
    """Return a drive in batches of different sizes, with missing and with refused observations."""
    conversions = []
    for topic, _, message in drive_messages(Types().make, 6.0):
        conversions += [pipeline.convert(complete) for complete in pipeline.pair(topic, message)]
    conversions[7] = Conversion(conversions[7].stamp_ns, None, Outcome.WRONG_FRAME, "a frame")
    spoilt = conversions[20].observation
    assert spoilt is not None
    conversions[20] = conversions[20]._replace(
        observation=dataclasses.replace(spoilt, velocity=np.nan), notes=("a note",)
    )
    yield [(CAUSE, each) for each in conversions[:25]]
    yield []
    yield [(CAUSE, conversions[25])]
    yield [(CAUSE, each) for each in conversions[26:]]


def messages(pipeline: Pipeline) -> list[bytes]:
    types = Types()
    with answering(pipeline) as answered:
        answers = [answer for batch in answered(batches(pipeline)) for _, answer in batch]
    made = [
        answer.messages(types.make, pipeline.meta)[name]
        for answer in answers
        for name in OUTPUT_TYPES
    ]
    return [types.serialize(message) for message in made]


def test_the_answers_are_those_of_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    model = load_model()
    both = messages(Pipeline(model, EstimatorConfig()))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    assert both == messages(Pipeline(model, EstimatorConfig()))
    assert len(both) == 2 * 60


def _send_messages(pipe: Any) -> None:
    pipe.send(messages(Pipeline(load_model(), EstimatorConfig())))


def test_a_worker_answers_alone_in_a_daemonic_process_and_in_a_thread() -> None:
    expected = messages(Pipeline(load_model(), EstimatorConfig()))
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("fork").Process(
        target=_send_messages, args=(there,), daemon=True
    )
    process.start()
    there.close()
    assert here.recv() == expected
    process.join()

    children: list[int] = []

    def count_children() -> None:
        with answering(Pipeline(load_model(), EstimatorConfig())):
            children.append(len(multiprocessing.active_children()))

    thread = threading.Thread(target=count_children)
    thread.start()
    thread.join()
    count_children()
    assert children == [0, 1]


class Failing:
    """A pipeline whose estimator fails."""

    def answer(self, conversion: Conversion) -> Any:
        raise ArithmeticError(f"set {conversion.stamp_ns}")


class Dying:
    """A pipeline whose process is killed."""

    def answer(self, conversion: Conversion) -> Any:
        raise SystemExit(conversion.stamp_ns)


@pytest.mark.parametrize(
    ("pipeline", "error", "words"),
    [(Failing(), ArithmeticError, "set 3"), (Dying(), ChildProcessError, "Replay the bag")],
)
def test_an_error_in_the_second_process_ends_both(
    pipeline: Any, error: type[Exception], words: str
) -> None:
    batch: Converted = [(CAUSE, Conversion(3, None))]
    with pytest.raises(error, match=words), answering(pipeline) as answered:
        list(answered([batch, batch, batch]))
    assert not multiprocessing.active_children()


def test_an_error_in_the_first_process_ends_both() -> None:
    def failing() -> Iterator[Converted]:
        yield []
        raise KeyboardInterrupt

    with (
        pytest.raises(KeyboardInterrupt),
        answering(Pipeline(load_model(), EstimatorConfig())) as answered,
    ):
        list(answered(failing()))
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_the_second_process_does_not_outlive_the_first(number: signal.Signals) -> None:
    path = os.pathsep.join(map(str, sys.path))
    command = ["env", "--default-signal=INT", sys.executable, "-c", CHILD]
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": path},
    ) as first:
        assert first.stdout is not None
        second = Path("/proc") / first.stdout.readline().strip()
        assert second.is_dir()
        assert _ended_by(first, number) == -number
        deadline_s = time.monotonic() + LEAVING_S
        while second.is_dir() and not _dead(second) and time.monotonic() < deadline_s:
            time.sleep(0.01)
        assert not second.is_dir() or _dead(second)


def _ended_by(process: "subprocess.Popen[str]", number: signal.Signals) -> int:
    """Send a signal until the process ends, and return its code.

    One that comes just before a blocking read is seen by Python after that read alone.
    """
    for _ in range(int(LEAVING_S) - 1):
        process.send_signal(number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            return process.wait(1.0)
    return process.wait(1.0)


def _dead(process: Path) -> bool:
    """Return whether a process has ended and only waits for its new parent to notice."""
    try:
        return (process / "stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):  # before and after the file was opened
        return True


def test_one_core_needs_no_second_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with answering(Pipeline(load_model(), EstimatorConfig())) as answered:
        assert not multiprocessing.active_children()
        assert list(answered([])) == []
