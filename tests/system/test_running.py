# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A message that raises does not end a node."""

import os
import signal
import threading
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from std_msgs.msg import String

from rover_parameters.command_line import set_at_signals
from terrain_estimator.messaging.diagnostics import REQUIRED
from terrain_estimator.nodes.common import diagnostics
from terrain_estimator.nodes.common.running import guarded
from tests.system.listening import Listener


@pytest.fixture
def _signals_as_before() -> Iterator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.usefixtures("_signals_as_before")
def test_a_lost_connection_ends_a_node_in_order_unless_nohup_says_no() -> None:
    stop = threading.Event()
    for ignored in (True, False):
        signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)
        set_at_signals(stop)
        os.kill(os.getpid(), signal.SIGHUP)
        assert stop.is_set() is not ignored
    for number in (signal.SIGINT, signal.SIGTERM):
        stop.clear()
        os.kill(os.getpid(), number)
        assert stop.is_set()


def test_a_callback_that_raises_is_counted_and_said_and_the_next_message_is_taken(
    listener: Listener, capfd: pytest.CaptureFixture[str]
) -> None:
    failures: list[int] = []
    taken: list[float] = []
    callback = guarded(
        listener.node, lambda value: taken.append(1.0 / value), lambda: failures.append(1)
    )
    for value in (0.0, 2.0):
        callback(value)
    assert (len(failures), taken) == (1, [0.5])
    assert "ZeroDivisionError in a callback, the message is left out" in capfd.readouterr().err


def test_a_guarded_callback_still_gets_the_details_of_the_reception(listener: Listener) -> None:
    taken: list[int] = []

    def receive(_: String, info: dict[str, int]) -> None:
        taken.append(info["received_timestamp"])

    listener.node.create_subscription(String, "words", guarded(listener.node, receive), 10)
    listener.publisher(String, "words").publish(String())
    listener.wait_for_messages(taken, 1)
    assert taken[0] > 10**18


def test_what_is_not_judged_any_more_is_not_said_to_be_well(
    listener: Listener, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Log no "all is well again" for a check that a paused node no longer makes."""
    steady_s = [0.0]
    monkeypatch.setattr(diagnostics, "time", SimpleNamespace(monotonic=lambda: steady_s[0]))
    publisher = diagnostics.DiagnosticsPublisher(listener.node, list)
    missing, there = REQUIRED.judge(9.0, "odom", "no data"), REQUIRED.judge(0.1, "odom", "data")
    for now_s, findings in (
        (0.0, [missing]),
        (6.0, [missing]),
        (7.0, []),
        (8.0, [missing]),
        (14.0, [missing]),
        (15.0, [there]),
    ):
        steady_s[0] = now_s
        publisher._log(findings)
    said = capfd.readouterr().err
    assert (said.count("no data"), said.count("required input odom: all is well again")) == (2, 1)
