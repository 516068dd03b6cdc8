# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Destroy a node without waiting for ever on the middleware.

Fast DDS 2.14 waits for a callback of its discovery without giving it the lock that it needs
(eProsima/Fast-DDS#6513). A node that ends while others come or go can then turn in rclpy's
``destroy_node`` for minutes, with one core and Python's global lock, so that neither a thread nor a
signal handler of Python runs. A timer of the C library ends the process instead: nothing of ours is
open by then.
"""

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from rclpy.node import Node

LONGEST_END_S = 10.0
_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _Event(ctypes.Structure):
    """C's struct sigevent, 64 bytes on Linux."""

    _fields_ = (
        ("value", ctypes.c_ssize_t),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("unused", ctypes.c_char * 32),
    )


class _Times(ctypes.Structure):
    """C's struct itimerspec: interval and first time, each in seconds and nanoseconds."""

    _fields_ = tuple((name, ctypes.c_long) for name in ("again_s", "again_ns", "s", "ns"))


def destroy(node: Node, code: int = 0) -> None:
    """Destroy the last node of this process, whose exit code is ``code`` if that does not end."""
    with exiting_after(LONGEST_END_S, code):
        node.destroy_node()


@contextmanager
def exiting_after(seconds: float, code: int) -> Iterator[None]:
    """End this process with ``code`` if the block takes longer, whoever holds Python's lock."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # one that is closed or full has nothing to lose
            if stream is not None:
                stream.flush()
    c: Any = ctypes.CDLL(None, use_errno=True)
    leave = ctypes.cast(c._exit, ctypes.c_void_p)  # noqa: SLF001 - the C library's name
    event = _Event(value=code, notify=_SIGEV_THREAD, function=leave)
    timer = ctypes.c_void_p()
    if c.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        raise OSError(ctypes.get_errno(), f"timer_create: {os.strerror(ctypes.get_errno())}")
    times = _Times(s=int(seconds), ns=int(seconds % 1.0 * 1e9))
    try:
        if c.timer_settime(timer, 0, ctypes.byref(times), None):
            raise OSError(ctypes.get_errno(), f"timer_settime: {os.strerror(ctypes.get_errno())}")
        yield
    finally:
        c.timer_delete(timer)
