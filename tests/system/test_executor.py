# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The executor of the nodes serves all that rclpy's does, on real DDS."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from terrain_estimator.nodes.common.executor import MessageExecutor, take_message
from tests.system.listening import Listener

Made = tuple[Node, MessageExecutor]


@pytest.fixture
def made(domain_id: int) -> Iterator[Made]:
    """Make a node beside the listener, served by nobody but the test."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node("served", context=context)
    executor = MessageExecutor(context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def into(words: list[str]) -> Callable[[Any], None]:
    """Return a callback that keeps the words of the messages."""
    return lambda message: words.append(message.data)


def served(executor: MessageExecutor, listener: Listener, condition: Callable[[], object]) -> None:
    """Serve both sides until the condition holds."""

    def turn() -> object:
        executor.spin_once(0.01)
        return condition()

    listener.spin_until(turn, "the node has served it")


def ask(listener: Listener, executor: MessageExecutor, service: str) -> Future:
    """Call a service of the node without waiting for its answer."""
    client = listener.node.create_client(Trigger, service)
    served(executor, listener, client.service_is_ready)
    return client.call_async(Trigger.Request())


def test_messages_timers_services_and_events_are_served(made: Made, listener: Listener) -> None:
    node, executor = made
    words: list[str] = []
    details: list[int] = []
    ticks: list[int] = []
    node.create_subscription(String, "words", into(words), 10)

    def detailed(_: String, info: dict[str, int]) -> None:
        details.append(info["received_timestamp"])

    node.create_subscription(String, "words", detailed, 10)  # type: ignore[arg-type]
    timer = node.create_timer(0.02, lambda: ticks.append(1))

    def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = True
        return response

    node.create_service(Trigger, "plain", answer)
    output = listener.node.create_publisher(String, "words", 10)
    served(executor, listener, lambda: output.get_subscription_count() == 2)
    for word in ("a", "b", "c"):
        output.publish(String(data=word))
    served(executor, listener, lambda: len(words) == len(details) == 3 and len(ticks) >= 3)
    assert words == ["a", "b", "c"]
    assert all(each > 10**18 for each in details)
    timer.cancel()
    future = ask(listener, executor, "plain")
    served(executor, listener, future.done)
    assert future.result().success


def test_while_a_service_awaits_something_messages_are_served(
    made: Made, listener: Listener
) -> None:
    node, executor = made
    words: list[str] = []
    awaited = Future(executor=executor)

    async def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = await awaited
        return response

    node.create_service(Trigger, "slow", answer, callback_group=ReentrantCallbackGroup())
    node.create_subscription(String, "words", into(words), 10)
    future = ask(listener, executor, "slow")
    output = listener.node.create_publisher(String, "words", 10)
    served(executor, listener, output.get_subscription_count)
    output.publish(String(data="meanwhile"))
    served(executor, listener, lambda: words)
    assert not future.done()
    awaited.set_result("done")
    served(executor, listener, future.done)
    assert future.result().message == "done"


def test_messages_that_wait_on_all_topics_are_served_without_another_wait(
    made: Made, listener: Listener
) -> None:
    node, executor = made
    words: list[str] = []
    for topic in ("one", "other"):
        node.create_subscription(String, topic, into(words), 10)
    outputs = [listener.node.create_publisher(String, topic, 10) for topic in ("one", "other")]
    served(executor, listener, lambda: all(each.get_subscription_count() for each in outputs))
    for number in range(3):
        for output in outputs:
            output.publish(String(data=f"{output.topic_name} {number}"))
    assert all(each.wait_for_all_acked() for each in outputs)  # all of them are there
    while not words:
        executor.spin_once(0.1)
    assert len(words) == 6
    assert [each for each in words if "other" in each] == [f"/other {n}" for n in range(3)]


def test_no_topic_gets_ahead_of_one_whose_message_comes_meanwhile(
    made: Made, listener: Listener
) -> None:
    node, executor = made
    words: list[str] = []
    other = listener.node.create_publisher(String, "other", 10)

    def first(message: String) -> None:
        if not words:
            other.publish(String(data="other"))
            assert other.wait_for_all_acked()  # it is there
        words.append(message.data)

    node.create_subscription(String, "one", first, 10)
    node.create_subscription(String, "other", into(words), 10)
    one = listener.node.create_publisher(String, "one", 10)
    served(
        executor,
        listener,
        lambda: one.get_subscription_count() and other.get_subscription_count(),
    )
    for word in ("a", "b", "c"):
        one.publish(String(data=word))
    assert one.wait_for_all_acked()  # all of them are there
    while not words:
        executor.spin_once(0.1)
    assert words == ["a", "b", "other", "c"]


def test_a_callback_that_raises_costs_no_other_message(made: Made, listener: Listener) -> None:
    node, executor = made
    taken: list[str] = []

    def fail(_: String) -> None:
        raise ValueError("this word is bad")

    node.create_subscription(String, "bad", fail, 10)
    for topic in ("good", "better"):
        node.create_subscription(String, topic, into(taken), 10)
    outputs = [
        listener.node.create_publisher(String, name, 10) for name in ("bad", "good", "better")
    ]
    served(executor, listener, lambda: all(each.get_subscription_count() for each in outputs))
    for output in outputs:
        output.publish(String(data=output.topic))
    assert all(each.wait_for_all_acked() for each in outputs)  # all of them are ready at once
    with pytest.raises(ValueError, match="this word is bad"):
        served(executor, listener, lambda: False)
    served(executor, listener, lambda: len(taken) == 2)
    assert sorted(taken) == [output.topic for output in (outputs[2], outputs[1])]


def test_a_wait_ends_in_time_and_a_destroyed_subscription_has_no_message(made: Made) -> None:
    node, executor = made
    executor.spin_once(0.0)  # the guard condition of the added node
    begun_s = time.monotonic()
    for _ in range(3):
        executor.spin_once(0.1)
    assert time.monotonic() - begun_s >= 0.2
    subscription: Any = node.create_subscription(String, "words", print, QoSProfile(depth=1))
    assert not take_message(subscription)
    node.destroy_subscription(subscription)
    assert not take_message(subscription)
