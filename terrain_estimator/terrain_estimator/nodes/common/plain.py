# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What nodes share: a guard around callbacks, and how one without a life cycle runs."""

import functools
import sys
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from rover_parameters.records import ConfigError
from terrain_estimator.nodes.common.command_line import begin

NodeT = TypeVar("NodeT", bound=Node)
POLL_S = 0.1
LOG_PERIOD_S = 5.0


def guarded(
    node: Node, callback: Callable[..., None], failed: Callable[[], None] = lambda: None
) -> Callable[..., None]:
    """A callback that never raises: whatever a message does, the node stays alive, says so, and calls ``failed``.

    It has the signature of ``callback``, by which rclpy tells whether to hand over the reception's
    details.
    """

    @functools.wraps(callback)
    def call(*arguments: Any) -> None:
        try:
            callback(*arguments)
        except Exception as error:  # noqa: BLE001 - the last line of defence of a node that has to keep running
            failed()
            node.get_logger().error(
                f"{type(error).__name__} in a callback, the message is left out: {error}",
                throttle_duration_sec=LOG_PERIOD_S,
            )

    return call


def spin(node: Node, stop: threading.Event) -> None:
    """Serve the callbacks of a node until ``stop`` is set."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    turn = guarded(
        node, executor.spin_once
    )  # rclpy's own callbacks raise too: at a /clock before zero, for instance
    while not stop.is_set():
        turn(POLL_S)


def run(
    name: str,
    example: str,
    config: type[Any],
    make: Callable[[], NodeT],
    serve: Callable[[NodeT, threading.Event], None] = spin,
) -> int:
    """Let a node ``serve`` until SIGINT or SIGTERM; ``example`` as in :func:`begin`.

    Returns:
        0 after a signal or ``--help``, 2 where the node raises ConfigError.
    """
    try:
        stop = begin(name, example, config)
        node = make()
        serve(node, stop)
        node.destroy_node()
    except ConfigError as error:
        return refuse(name, error)
    finally:
        rclpy.try_shutdown()
    return 0


def refuse(program: str, error: ConfigError) -> int:
    """Say what is wrong with the command line; returns the exit code."""
    print(f"{program}: {error}", file=sys.stderr)  # noqa: T201 - the user typed it, the user reads it
    return 2
