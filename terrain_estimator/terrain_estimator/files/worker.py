# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A thread for jobs that wait for the disk."""

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class _Job:
    action: Callable[[], Any]
    size: int
    since_s: float = field(default_factory=time.monotonic)
    done: Future[Any] = field(default_factory=Future)

    def run(self) -> Callable[[], None]:
        """Do the action; return a function that gives its outcome to the future."""
        if not self.done.set_running_or_notify_cancel():
            return lambda: None
        try:
            return partial(self.done.set_result, self.action())
        except BaseException as error:  # noqa: BLE001 - the future raises it
            return partial(self.done.set_exception, error)


class Worker:
    """Run one action after the other in a thread of its own.

    The end of the process does not wait for this thread, unlike those of a ThreadPoolExecutor, so a
    hanging disk cannot block it.
    """

    def __init__(self, name: str) -> None:
        """Set the thread's name; the thread starts with the first action."""
        # [s] steady clock: when an action last ended or reported progress
        self.moved_s = time.monotonic()
        self._name = name
        self._jobs: deque[_Job] = deque()  # the first one is being done
        self._changed = threading.Condition()
        self._size = 0
        self._thread: threading.Thread | None = None
        self._ended = False

    @property
    def behind_s(self) -> float:
        """Time [s] for which the oldest unfinished action has waited; 0 where all are done."""
        with self._changed:
            return time.monotonic() - self._jobs[0].since_s if self._jobs else 0.0

    @property
    def size(self) -> int:
        """Sum of the sizes of all unfinished actions."""
        return self._size

    @property
    def count(self) -> int:
        """Number of unfinished actions."""
        return len(self._jobs)

    def give(self, action: Callable[[], ResultT], size: int = 0) -> Future[ResultT]:
        """Queue an action; the future holds what it returns or raises.

        ``size`` is the memory that it holds until it is done.
        """
        job = _Job(action, size)
        with self._changed:
            self._jobs.append(job)
            self._size += size
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify()
        return job.done

    def move(self) -> None:
        """Report that the running action makes progress."""
        self.moved_s = time.monotonic()

    def end(self, patience_s: float = 0.0) -> bool:
        """Let the thread end when all is done; return whether it has within ``patience_s``."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread is None:
            return True
        self._thread.join(patience_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        going_on = True
        while going_on:
            with suppress(MemoryError):  # between two actions: the next ones may succeed
                going_on = self._do_next()

    def _do_next(self) -> bool:
        """Do one action; return False at the end.

        No name outlives the call, which would keep alive what the action holds. The action does not
        count as waiting any more when its future is done.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._jobs or self._ended)
            if not self._jobs:
                return False
            job = self._jobs[0]
        try:
            resolve = job.run()
            self.move()
        except MemoryError as error:  # outside the action
            resolve = partial(job.done.set_exception, error)
        with self._changed:
            self._jobs.popleft()
            self._size -= job.size
        resolve()
        return True
