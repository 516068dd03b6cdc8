# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run a node from its command line: help, signals, initialisation of rclpy, and the exit code."""

import signal
import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import rclpy
from rclpy.impl import rcutils_logger
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rover_parameters.files import DUMP
from rover_parameters.parameters import usage
from rover_parameters.printable import printable_line, printable_output
from rover_parameters.records import ConfigError


def run(
    program: str, example: str, config: type[Any], serve: Callable[[threading.Event], int]
) -> int:
    """Initialise rclpy, let a node ``serve``, and shut rclpy down.

    Args:
        program: name of the executable.
        example: a parameter with a value, for ``--help`` and the error messages.
        config: a configuration of :mod:`rover_parameters.records`; ``--help`` lists its parameters.
        serve: makes the node, runs it until the event is set, and returns the exit code. SIGINT,
            SIGTERM and SIGHUP set the event.

    Returns:
        The exit code of ``serve``, 0 after ``--help``, 2 after a ConfigError.
    """
    with printable_output():
        try:
            if _asks_for_help(example):
                print(usage(program, example, config))  # noqa: T201 - the user asked for it
                return 0
        except ConfigError as error:
            return print_error(program, error, 2)
    return run_with(program, sys.argv, serve)


def run_with(
    program: str, arguments: Sequence[str], serve: Callable[[threading.Event], int]
) -> int:
    """Do as :func:`run`, with ``arguments`` that hold for all nodes of the process."""
    stop = threading.Event()
    set_at_signals(stop)
    make_logs_printable()
    # With rclpy's own handlers the context would end at the signal, and what waits in the queues
    # would be lost.
    start = partial(rclpy.init, args=[*arguments], signal_handler_options=SignalHandlerOptions.NO)
    with printable_output():
        try:
            _as_config_error(start)
            return serve(stop)
        except ConfigError as error:
            return print_error(program, error, 2)
        finally:
            rclpy.try_shutdown()


def make_logs_printable() -> None:
    """Make every log line of rclpy's nodes in this process one printable line.

    Names and texts of other nodes' messages reach the log. rclpy writes it outside of sys.stderr
    and has no hook for it, so its one method for all severities is wrapped.
    """
    plain: Callable[..., Any] = RcutilsLogger.log
    if plain.__module__ == __name__:
        return
    # rclpy keeps the state of throttled and once-only logs by the line of code that called it
    rcutils_logger._internal_callers.append(str(Path(__file__).resolve()))  # noqa: SLF001

    def log(self: RcutilsLogger, message: object, severity: object, **filters: Any) -> bool:
        return bool(plain(self, printable_line(str(message)), severity, **filters))

    setattr(RcutilsLogger, "log", log)  # noqa: B010 - a method of another library


def set_at_signals(stop: threading.Event) -> None:
    """Set ``stop`` at SIGINT, SIGTERM and SIGHUP: Ctrl-C, a service manager, a lost connection.

    An ignored SIGHUP stays ignored, as nohup wants it. An ignored SIGINT does not: shells
    ignore it in the background, where it has to end a node too.
    """
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: stop.set())


def print_error(program: str, error: Exception, code: int) -> int:
    """Print why a program ends to stderr, and return its exit code."""
    print(f"{program}: {error}", file=sys.stderr)  # noqa: T201 - for the user who typed it
    return code


def _asks_for_help(example: str) -> bool:
    """Return whether ``--help`` is given. Raise ConfigError for an argument that is not ROS's."""
    others = _as_config_error(lambda: remove_ros_args(sys.argv)[1:])
    if {"-h", "--help"} & set(others):
        return True
    if unknown := [word for word in others if word != DUMP]:
        raise ConfigError(
            f"unknown argument {unknown[0]!r}; parameters are given as --ros-args -p {example};"
            " --help lists them"
        )
    return False


def _as_config_error(call: Callable[[], Any]) -> Any:  # noqa: ANN401 - any result
    """Return what ``call`` returns, and raise what it raises as a ConfigError.

    rclpy's errors have no common class; a damaged parameter file ends here.
    """
    try:
        return call()
    except Exception as error:
        raise ConfigError(str(error)) from error
