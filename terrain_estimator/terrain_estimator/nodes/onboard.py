# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run several nodes of one rover in one process, which saves most of their memory.

They talk by the same topics as in processes of their own, in one thread.
"""

import sys
import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

from rclpy.node import Node

from rover_parameters.command_line import print_error, run_with
from rover_parameters.ending import destroy
from rover_parameters.records import ConfigError, nearest
from terrain_estimator.nodes.common.executor import MessageExecutor
from terrain_estimator.nodes.common.lifecycle import ManagedNode
from terrain_estimator.nodes.common.running import POLL_S, guarded, serve_on
from terrain_estimator.nodes.estimator import EstimatorNode
from terrain_estimator.nodes.planner import PlannerNode
from terrain_estimator.nodes.recorder import RecorderNode
from terrain_estimator.nodes.slip_source import SlipSourceNode
from terrain_estimator.nodes.terrain_map import MapNode

NODES: dict[str, Callable[..., Node]] = {
    "recorder": RecorderNode,
    "slip_source": lambda _, **options: SlipSourceNode(**options),
    "estimator": EstimatorNode,
    "terrain_map": lambda _, **options: MapNode(**options),
    "planner": lambda _, **options: PlannerNode(**options),
}
"""Makers of the nodes, given an event that ends them, in the order in which they start.

They end in the opposite order, so that the recorder gets what the others publish at their end.
"""
ALL = "all"
"""What is said instead of a node's name for arguments that hold for all nodes."""
USAGE = f"""\
usage: onboard NODE [--ros-args ...] [NODE [--ros-args ...]] ... [{ALL} --ros-args ...]
for instance onboard estimator planner --ros-args -p period:=1.0 recorder

Each NODE is one of {", ".join(NODES)},
with the arguments that it takes alone (ros2 run terrain_estimator NODE --help).
Those behind {ALL} hold for all nodes.
"""
_HELP = {"-h", "--help"}
_SWITCHES = ("--ros-args", "--enable-", "--disable-")
"""How ROS's options without a value begin."""


class Started(NamedTuple):
    """A node that runs."""

    node: Node
    ended: threading.Event  # by the transition "shutdown"


def divided(words: Sequence[str]) -> dict[str, list[str]]:
    """Return the arguments of each node, and those behind ALL, from the words of a command line.

    Raises:
        ConfigError: a word is neither a node nor an argument of ROS, a node is named twice, or none
            is.
    """
    own: dict[str, list[str]] = {}
    current: list[str] = []
    of_ros, is_value = False, False
    for word in words:
        if (word in NODES or word == ALL) and not is_value:
            if word in own:
                raise ConfigError(f"{word} is named twice: one process has one of each")
            current, of_ros = own.setdefault(word, []), False
        elif own and (of_ros or word == "--ros-args"):
            of_ros = word != "--"
            is_value = of_ros and word.startswith("-") and not word.startswith(_SWITCHES)
            current.append(word)
        else:
            hint = nearest(word, [*NODES, ALL])
            raise ConfigError(f"unknown argument {word!r}: {hint}; --help shows the order")
    if not own.keys() - {ALL}:
        raise ConfigError(f"no node is named: give some of {', '.join(NODES)}")
    return own


class Onboard:
    """Nodes that one thread serves."""

    def __init__(self, own: dict[str, list[str]]) -> None:
        """Make the nodes with the arguments that :func:`divided` returns.

        Raises:
            ConfigError: a parameter of a node is wrong, or two nodes have one name.
        """
        self._executor = MessageExecutor()
        self._running: list[Started] = []
        for name in (each for each in NODES if each in own):
            ended = threading.Event()
            arguments = [*own.get(ALL, []), *own[name]]
            try:
                node = NODES[name](ended, cli_args=arguments, use_global_arguments=False)
            except ConfigError as error:
                raise ConfigError(f"{name}: {error}") from error
            self._running.append(Started(node, ended))
            self._executor.add_node(node)
        names = [each.node.get_fully_qualified_name() for each in self._running]
        if len(set(names)) < len(names):
            raise ConfigError(f"two nodes have one name: {', '.join(names)}: remap __node of one")

    def serve(self, stop: threading.Event) -> int:
        """Serve all nodes until ``stop`` is set or all were shut down, then end them; return 0."""
        for node, _ in self._running:
            if isinstance(node, ManagedNode) and node.config.auto_start:
                node.start()
        while self._running and not stop.is_set():
            self._turn(POLL_S)
            if any(each.ended.is_set() for each in self._running):
                serve_on(self._turn)
            for each in [each for each in self._running if each.ended.is_set()]:
                self._end(each)
        for each in reversed(self._running.copy()):
            self._end(each)
            if self._running:
                self._turn(POLL_S)  # what it published at its end
        return 0

    def _turn(self, timeout_s: float) -> None:
        guarded(self._running[0].node, self._executor.spin_once)(timeout_s)

    def _end(self, each: Started) -> None:
        if isinstance(each.node, ManagedNode):
            each.node.end()
        self._executor.remove_node(each.node)
        if len(self._running) == 1:
            destroy(each.node)
        else:
            each.node.destroy_node()
        self._running.remove(each)


def main() -> int:
    """Serve until SIGINT or SIGTERM; return 0, or 2 for wrong arguments or parameters."""
    words = sys.argv[1:]
    if _HELP & set(words):
        print(USAGE, end="")  # noqa: T201 - the user asked for it
        return 0
    try:
        own = divided(words)
    except ConfigError as error:
        return print_error("onboard", error, 2)
    return run_with("onboard", own.get(ALL, []), lambda stop: Onboard(own).serve(stop))


if __name__ == "__main__":
    sys.exit(main())
