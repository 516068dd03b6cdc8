# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Write the estimator's state to a file, and restore it, without waiting for a slow disk."""

import fcntl
import itertools
import math
import os
import threading
import time
import types
from collections.abc import Callable, Generator
from concurrent.futures import Future
from contextlib import suppress
from errno import ELOOP
from pathlib import Path
from typing import BinaryIO, TypeVar

from rclpy.impl.rcutils_logger import RcutilsLogger

from terrain_estimator.estimator.saved_state import StateFileError
from terrain_estimator.files.atomic import write_file
from terrain_estimator.files.worker import Worker
from terrain_estimator.messaging.diagnostics import SAVING, CheckResult
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.offline.state_files import is_foreign, read_state

REFUSED, LOADED = ".refused", ".loaded"
"""Endings of the names of a state file that was put aside, and of a copy for replays."""
PATIENCE_S = 10.0
"""Longest wait for an answer of the disk."""
ResultT = TypeVar("ResultT")


class StateFileWriter:
    """Write states in a thread of its own; a newer state replaces one that waits.

    Holds a lock on the file until all is written. Raises StateFileError where another writer, of
    this process or another one, has the lock.
    """

    def __init__(self, path: Path, report_error: Callable[[str], None]) -> None:
        """Lock the file; ``report_error`` is called in the writing thread."""
        self.path, self._lock = path, _locked(path)
        self._report_error = report_error
        self._error = ""  # of the last write
        self._failing_since_s = math.inf  # by the steady clock
        self._worker = Worker("saved state")
        self._exchange = threading.Lock()
        self._content: bytes | None = None  # waits to be written
        self._written = self._worker.give(lambda: None)  # of the newest state

    def write(self, content: bytes) -> "Future[None]":
        """Write this state soon.

        Returns:
            A future that is done when this state, or a newer one, is on the disk, and that raises
            the error where it is not.
        """
        with self._exchange:
            if self._content is None or self._written.done():
                self._written = self._worker.give(self._write)
            self._content = content
            return self._written

    def judge(self) -> CheckResult:
        """Judge for how long [s] the newest state is not on the disk: writes fail, or take long."""
        late_s = max(0.0, self._worker.behind_s, time.monotonic() - self._failing_since_s)
        text = (
            f"the state of {late_s:.0f} s ago is not in {self.path} yet:"
            f" {self._error or 'the disk is writing'}"
        )
        return SAVING.judge(late_s, text=text if late_s else f"{self.path} is up to date")

    def close(self, patience_s: float = PATIENCE_S) -> None:
        """Write what still waits and unlock the file; a disk that hangs is waited for no longer."""
        if self._worker.end(patience_s):
            self._unlock()
        else:
            self._written.add_done_callback(lambda _: self._unlock())
            self._report_error(
                f"the disk has not written the state to {self.path} within {patience_s:g} s: it is"
                " left with the one of before"
            )

    def _write(self) -> None:
        with self._exchange:
            content, self._content = self._content, None
        assert content is not None
        try:
            write_file(self.path, content)
        except Exception as error:
            reason = str(error).removeprefix(f"{self.path}: ") or type(error).__name__
            if not self._error:
                self._report_error(f"cannot write the state to {self.path}: {reason}; trying on")
            self._error = reason
            waited_s = self._worker.behind_s
            self._failing_since_s = min(self._failing_since_s, time.monotonic() - waited_s)
            raise
        self._error, self._failing_since_s = "", math.inf

    def _unlock(self) -> None:
        if self._lock:
            with suppress(OSError):  # nothing was written to it
                self._lock.close()


def check_state_path(path: Path) -> None:
    """Raise StateFileError where no state can be written to ``path``, or another file is there."""
    if not path.parent.is_dir():
        raise StateFileError(
            f"{path}: there is no folder {path.parent}: make it, or name another file by the"
            " parameter state.file"
        )
    if path.is_symlink():
        raise StateFileError(
            f"{path} is a symbolic link, which is not followed: name the file itself by the"
            " parameter state.file"
        )
    if path.exists() and not path.is_file():
        raise StateFileError(
            f"{path} is a folder or a device: name a file by the parameter state.file"
        )
    try:
        foreign = path.exists() and is_foreign(path)
    except OSError:
        return  # reading the file reports it
    if foreign:
        raise StateFileError(
            f"{path} is another file, no state: it is left alone; name another one by the parameter"
            " state.file"
        )


def _locked(path: Path) -> BinaryIO | None:
    """Lock a state file for as long as the result is open: two estimators would mix two grounds.

    Returns None where the folder takes no lock; writing the state then reports the error. Raises
    StateFileError where another writer has the lock.
    """
    name = path.with_name(f".{path.name}.lock")
    try:
        descriptor = os.open(name, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
    except OSError as error:
        if error.errno == ELOOP:
            raise StateFileError(
                f"{name} is a symbolic link: remove it, or name another file by the parameter"
                " state.file"
            ) from error
        return None
    lock = os.fdopen(descriptor, "rb")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        lock.close()
        text = (
            f"{path}: another estimator keeps its state there: name a file of its own by the"
            " parameter state.file"
        )
        raise StateFileError(text) from error
    except OSError:  # a file system without locks
        lock.close()
        return None
    return lock


def in_thread(action: Callable[[], ResultT]) -> "Future[ResultT]":
    """Run an action in a thread of its own; the process can end before it."""
    worker = Worker("state file")
    result = worker.give(action)
    worker.end()
    return result


async def completed(future: "Future[ResultT]", patience_s: float = PATIENCE_S) -> ResultT:
    """Wait in a service for a future while the executor serves the node's other callbacks.

    Raises TimeoutError where it is not done in time.
    """
    end_s = time.monotonic() + patience_s
    while not future.done():
        if time.monotonic() > end_s:
            raise TimeoutError(f"the disk has not answered within {patience_s:g} s")
        await _turn()
    return future.result()


@types.coroutine
def _turn() -> Generator[None, None, None]:
    """Yield to the executor, which resumes the callback at its next turn."""
    yield


def restore(pipeline: Pipeline, path: Path, logger: RcutilsLogger) -> bool:
    """Restore a saved state and keep a copy of it for replays, since autosaves replace the file.

    Returns:
        Whether it was restored. A state that is refused is renamed: the node estimates without it.
    """
    try:
        pipeline.restore(read_state(path, pipeline.meta.model_sha256), str(path))
    except MemoryError:
        raise  # which is no fault of the state: the node stays unconfigured
    except Exception as error:  # noqa: BLE001 - whatever the file holds
        text = f"{error}; {_put_aside(path)}, and the prior holds"
        logger.error(text)  # noqa: TRY400 - rclpy's logger
        return False
    logger.info(f"going on from the state in {path}")  # noqa: G004
    try:
        write_file(path.with_name(path.name + LOADED), path.read_bytes())
    except OSError as error:
        text = f"the state that the node goes on from cannot be kept for replays: {error}"
        logger.warning(text)
    return True


def _put_aside(path: Path) -> str:
    """Rename a state that is refused, and return words about it."""
    aside = _free_name(path)
    try:
        path.replace(aside)
    except OSError as error:
        return f"it cannot be put aside as {aside} ({error.strerror})"
    return f"it is put aside as {aside}"


def _free_name(path: Path) -> Path:
    """Return a name for a refused state that replaces no earlier one.

    Started first with a wrong model and then with the right one, a node refuses two states.
    """
    numbered = (f"{REFUSED}-{number}" for number in itertools.count(2))
    candidates = (
        path.with_name(path.name + ending) for ending in itertools.chain([REFUSED], numbered)
    )
    return next(each for each in candidates if not os.path.lexists(each))
