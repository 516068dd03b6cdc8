# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What every node relies on: a message that cannot be digested does not end it."""

import pytest
from std_msgs.msg import String

from terrain_estimator.nodes.plain import guarded
from tests.system.listening import Listener


def test_a_callback_that_raises_is_counted_and_said_and_the_next_message_is_taken(
    listener: Listener, capfd: pytest.CaptureFixture[str]
) -> None:
    failures: list[int] = []
    taken: list[float] = []
    callback = guarded(listener.node, lambda value: taken.append(1.0 / value), lambda: failures.append(1))
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
