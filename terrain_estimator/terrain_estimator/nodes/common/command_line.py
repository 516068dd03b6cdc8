# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How a node begins: its signals, its command line, its help."""

import signal
import sys
import threading
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rover_parameters.files import DUMP
from rover_parameters.parameters import usage
from rover_parameters.records import ConfigError


def begin(name: str, example: str, config: type[Any]) -> threading.Event:
    """Take over the signals and initialise rclpy from the command line.

    Args:
        name: of the executable.
        example: a parameter with a value, for the messages.
        config: made of fields by ``rover_parameters.records``; ``--help`` lists them.

    Returns:
        What the signals set that end a node.

    Raises:
        ConfigError: an argument, a remapping rule or a parameter file is wrong.
        SystemExit: with code 0 after ``--help``.
    """
    stop = threading.Event()
    take_signals(stop)
    try:
        others = remove_ros_args(sys.argv)[1:]
    except (
        Exception
    ) as error:  # rclpy's errors have no common class; a damaged parameter file ends here
        raise ConfigError(str(error)) from error
    if {"-h", "--help"} & set(others):
        print(usage(name, example, config))  # noqa: T201 - the user asked for it
        sys.exit()
    if unknown := [word for word in others if word != DUMP]:
        raise ConfigError(
            f"unknown argument {unknown[0]!r}; parameters are given as --ros-args -p {example};"
            " --help lists them"
        )
    try:
        # With rclpy's own handlers the context would end at the signal, and what waits in the
        # queues would be lost.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        raise ConfigError(str(error)) from error
    return stop


def take_signals(stop: threading.Event) -> None:
    """Let Ctrl-C, a service manager and a lost connection end a node in order: SIGINT, SIGTERM, SIGHUP.

    A SIGHUP that is ignored, as nohup does, stays so; shells ignore SIGINT in the background, and
    there it has to end a node all the same.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: stop.set())
