# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A live estimator finds the rate of its inputs by their stamps, and reports it."""

import threading
from functools import partial

import pytest

from msg_defs.msg import EstimatorHealth
from terrain_estimator.messaging.diagnostics import Level
from terrain_estimator.nodes.common import message_types
from terrain_estimator.nodes.estimator import EstimatorNode
from terrain_estimator.topics import INPUT_TYPES
from tests.drives import Event, drive_messages
from tests.live import live_pipeline
from tests.system.listening import Listener
from tests.system.test_hosted_estimator import Rover

STEPS = 40


def at_rate(rate_hz: int) -> list[Event]:
    """Return a drive of 10 Hz with the stamps of another rate."""
    events = list(drive_messages(message_types.make, STEPS / 10))
    for stamp in {id(each.header.stamp): each.header.stamp for _, _, each in events}.values():
        passed_ns = (stamp.sec - 100) * 10**9 + stamp.nanosec
        stamp.sec, stamp.nanosec = divmod(100 * 10**9 + passed_ns * 10 // rate_hz, 10**9)
    return events


def received(node: EstimatorNode, count: int) -> bool:
    return node._configured.counters["wheel_slip"].received == count


@pytest.mark.parametrize(("rate_hz", "answers"), [(50, 9), (2, STEPS)])
def test_the_rate_is_reported_and_the_estimates_are_those_of_a_replay(
    listener: Listener, rate_hz: int, answers: int
) -> None:
    node = listener.host(partial(EstimatorNode, threading.Event()), namespace="/rover1")
    node.start()
    rover = Rover(listener, "rover1", at_rate(rate_hz))
    for step in range(STEPS):
        rover.publish(step)
        listener.spin_until(partial(received, node, step + 1), "the readings arrive")
    listener.wait_for_messages(rover.estimates, answers)
    pipeline = live_pipeline()
    replayed = [each for topic, _, message in rover.events for each in pipeline.add(topic, message)]
    assert len(INPUT_TYPES) * STEPS == len(rover.events)
    assert [each.covariance.tolist() for each in rover.estimates] == [
        each.update.estimate.covariance.ravel().tolist() for each in replayed
    ]

    def reported(health: EstimatorHealth) -> bool:
        refused = health.level == Level.ERROR and "rate: 2 Hz, but 5 to 200 Hz" in health.summary
        return refused if rate_hz == 2 else min(health.input_received) == STEPS

    listener.spin_until(lambda: any(map(reported, rover.health)), "the rate is reported")
    [found] = [each for each in node.findings() if each.name == "rate"]
    assert found.text.startswith(f"rate: {rate_hz} Hz")
    node.end()
