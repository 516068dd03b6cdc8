# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Wait for a condition; no test sleeps for a fixed time in the hope that it suffices."""

import threading
import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
INTERVAL = 0.005  # [s] between two looks at a condition
PATIENCE_S = 60.0  # a process that starts on a slow and busy machine takes a quarter of it


class TimeOutError(AssertionError):
    """A condition did not come true in time; the message says which, and what was seen instead."""


def wait_until(
    condition: Callable[[], T],
    what: str,
    timeout: float = PATIENCE_S,
    seen: Callable[[], object] = lambda: "",
) -> T:
    """Return the first true value of the condition.

    Raises TimeOutError after timeout [s], with what `seen` returns.
    """
    end = time.monotonic() + timeout
    pause = threading.Event()
    while not (value := condition()):
        if time.monotonic() > end:
            raise TimeOutError(f"waited {timeout:g} s in vain until {what}. {seen()}")
        pause.wait(INTERVAL)
    return value
