# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run the callbacks of a node so that no message ends it."""

import functools
import threading
import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from rover_parameters.ending import destroy
from terrain_estimator.nodes.common.executor import MessageExecutor

POLL_S = 0.1
LOG_PERIOD_S = 5.0
ANSWER_S = 1.0
"""[s] For which a node that was shut down serves on: what asked for it gets its answer."""


def guarded(
    node: Node, callback: Callable[..., None], failed: Callable[[], None] = lambda: None
) -> Callable[..., None]:
    """Wrap a callback so that an exception is logged, and ``failed`` called, instead of raised.

    The wrapper has the signature of ``callback``, by which rclpy decides whether to pass the
    reception's details.
    """

    @functools.wraps(callback)
    def call(*arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # noqa: BLE001 - the node has to keep running
            failed()
            node.get_logger().error(
                f"{type(error).__name__} in a callback, the message is left out: {error}",
                throttle_duration_sec=LOG_PERIOD_S,
            )

    return call


def guarded_turn(node: Node, failed: Callable[[], None] = lambda: None) -> Callable[[float], None]:
    """Return a function that serves what is ready of a node, waiting for it at most the given [s].

    It never raises. rclpy's own callbacks do, at a /clock before zero for instance.
    """
    executor = MessageExecutor()
    executor.add_node(node)
    return guarded(node, executor.spin_once, failed)


def serve_on(turn: Callable[[float], None]) -> None:
    """Take turns for ``ANSWER_S``, so that the answer to the transition "shutdown" arrives.

    It is sent when the callback returns, but Fast DDS drops what a destroyed service has not
    delivered yet, and nothing tells when it was.
    """
    end = time.monotonic() + ANSWER_S
    while time.monotonic() < end:
        turn(POLL_S)


def serve(node: Node, stop: threading.Event) -> int:
    """Spin a node until ``stop`` is set and destroy it; return the exit code 0."""
    turn = guarded_turn(node)
    while not stop.is_set():
        turn(POLL_S)
    destroy(node)
    return 0
