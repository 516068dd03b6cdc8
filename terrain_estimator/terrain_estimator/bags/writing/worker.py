# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A thread for what waits for the disk, for as long as the disk takes."""

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
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
    """Does one action after the other in a thread of its own.

    The end of the process does not wait for this thread, as it does for those of a
    ThreadPoolExecutor: not where the disk hangs.
    """

    def __init__(self, name: str) -> None:
        """``name`` is that of the thread, which starts with the first action."""
        self.moved_s = (
            time.monotonic()
        )  # by the steady clock: when an action ended, or said that it goes on
        self._name = name
        self._jobs: deque[_Job] = deque()  # the first one is being done
        self._changed = threading.Condition()
        self._size = 0
        self._thread: threading.Thread | None = None
        self._ended = False

    @property
    def behind_s(self) -> float:
        """For how long [s] the oldest action that is not done has waited; 0 where all is done."""
        with self._changed:
            return time.monotonic() - self._jobs[0].since_s if self._jobs else 0.0

    @property
    def size(self) -> int:
        """Sum of the sizes of all actions that are not done."""
        return self._size

    @property
    def count(self) -> int:
        """Number of actions that are not done."""
        return len(self._jobs)

    def give(self, action: Callable[[], ResultT], size: int = 0) -> Future[ResultT]:
        """Do this after what was given before; the future has what it returns or raises. ``size`` is what it holds in memory meanwhile."""
        job = _Job(action, size)
        with self._changed:
            self._jobs.append(job)
            self._size += size
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
                self._thread.start()
            self._changed.notify()
        return job.done

    def move(self) -> None:
        """Say that the action which is being done goes on."""
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
        while self._do_next():
            pass

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
        resolve = job.run()
        self.move()
        with self._changed:
            self._jobs.popleft()
            self._size -= job.size
        resolve()
        return True
