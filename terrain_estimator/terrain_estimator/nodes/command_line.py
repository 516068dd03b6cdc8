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

from terrain_estimator.parameters import ParameterError, definitions


def begin(name: str, example: str, config: type[Any]) -> threading.Event:
    """Take over the signals and initialise rclpy from the command line.

    Args:
        name: of the executable.
        example: a parameter with a value, for the messages.
        config: made of fields by ``parameters.parameter``; ``--help`` lists them.

    Returns:
        What SIGINT and SIGTERM set.

    Raises:
        ParameterError: an argument, a remapping rule or a parameter file is wrong.
        SystemExit: with code 0 after ``--help``.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        others = remove_ros_args(sys.argv)[1:]
    except Exception as error:  # rclpy's errors have no common class; a damaged parameter file ends here
        raise ParameterError(str(error)) from error
    if {"-h", "--help"} & set(others):
        print(_help(name, example, config))  # noqa: T201 - the user asked for it
        sys.exit()
    if others:
        raise ParameterError(f"unknown argument {others[0]!r}; parameters are given as --ros-args -p {example}; --help lists them")
    try:
        # With rclpy's own handlers the context would end at the signal, and what waits in the queues would be lost.
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        raise ParameterError(str(error)) from error
    return stop


def _help(name: str, example: str, config: type[Any]) -> str:
    lines = [f"usage: {name} [--ros-args [-p NAME:=VALUE] [-r FROM:=TO] [--params-file FILE] ...]"]
    lines += [f"for instance --ros-args -p {example}", ""]
    for entry in definitions(config):
        default = f"'{entry.default}'" if isinstance(entry.default, str) else str(entry.default).lower()
        limits = f", {entry.constraints}" if entry.constraints else ""
        unit = f" {entry.unit}" if entry.unit else ""
        lines += [f"  {entry.name} (default {default}{limits}{unit})", f"      {entry.description}"]
    return "\n".join(lines)
