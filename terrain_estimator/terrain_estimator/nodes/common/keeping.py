# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Keeps the estimator's state on the disk, beside the thread that estimates: an fsync takes as long as it likes."""

import fcntl
import itertools
import math
import shutil
import threading
import time
import types
from collections.abc import Callable, Generator
from concurrent.futures import Future
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar

from rclpy.impl.rcutils_logger import RcutilsLogger

from terrain_estimator.bags.writing.syncing import sync_folder
from terrain_estimator.estimator.saved_state import (
    StateFileError,
    is_foreign,
    read_state,
    write_state,
)
from terrain_estimator.messaging.diagnostics import SAVING, CheckResult
from terrain_estimator.messaging.pipeline import Pipeline

REFUSED, LOADED = ".refused", ".loaded"
"""Are added to the name of a state file that was put aside, and of a copy for replays."""
PATIENCE_S = 10.0
"""A disk that has not answered by then is not waited for."""
ResultT = TypeVar("ResultT")


class _Waiting(NamedTuple):
    content: bytes
    written: "Future[None]"
    since_s: float  # by the steady clock


class StateKeeper:
    """Writes the newest state that it was given; one that comes while it writes replaces what still waits.

    The file is its own until its thread ends. Raises StateFileError where another keeper has it, of
    this process or another one.
    """

    def __init__(self, path: Path, complain: Callable[[str], None]) -> None:
        """``complain`` takes why a state could not be written; it is called in the writing thread."""
        self.path, self._claim = path, _claimed(path)
        self._complain = complain
        self._wrong = ""  # why the last write failed
        self._since_s = (
            math.inf
        )  # by the steady clock: of the oldest state that is not on the disk, nor a newer one
        self._changed = threading.Condition()
        self._waiting: _Waiting | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="saved state", daemon=True)
        self._thread.start()

    def give(self, content: bytes) -> "Future[None]":
        """Write this state soon; the future is done when it, or a newer one, outlives a power cut, and raises why it does not."""
        now = time.monotonic()
        with self._changed:
            _, written, since_s = self._waiting or _Waiting(content, Future(), now)
            self._waiting = _Waiting(content, written, since_s)
            self._since_s = min(self._since_s, now)
            self._changed.notify()
        return written

    def judge(self) -> CheckResult:
        """For how long the disk has owed a state: its writing fails, or takes so long."""
        late_s = max(0.0, time.monotonic() - self._since_s)
        text = (
            f"the state of {late_s:.0f} s ago is not in {self.path} yet:"
            f" {self._wrong or 'the disk is writing'}"
        )
        return SAVING.judge(late_s, text=text if late_s else f"{self.path} is up to date")

    def end(self, patience_s: float = PATIENCE_S) -> None:
        """Write what still waits, and end the thread; one that hangs in the disk is left to itself, so that the process can end."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(patience_s)
        if self._thread.is_alive():
            self._complain(
                f"the disk has not written the state to {self.path} within {patience_s:g} s: it is"
                " left with the one of before"
            )

    def _run(self) -> None:
        with self._claim or nullcontext():
            self._write_all()

    def _write_all(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._ended or self._waiting is not None)
                taken, self._waiting = self._waiting, None
            if taken is None:
                return
            try:
                write_state(self.path, taken.content)
                sync_folder(self.path.parent)
            except Exception as error:  # noqa: BLE001 - whatever the disk does, the next state is tried too
                if not self._wrong:
                    self._complain(f"cannot write the state to {self.path}: {error}; trying on")
                self._wrong = str(error) or type(error).__name__
                taken.written.set_exception(error)
            else:
                self._owe_what_waits()
                taken.written.set_result(None)

    def _owe_what_waits(self) -> None:
        with self._changed:
            self._wrong, self._since_s = "", self._waiting.since_s if self._waiting else math.inf


def check_place(path: Path) -> None:
    """Raises StateFileError where a state cannot be kept at ``path``, or something else is there: it would be replaced."""
    if not path.parent.is_dir():
        raise StateFileError(
            f"{path}: there is no folder {path.parent}: make it, or name another file by the"
            " parameter state.file"
        )
    if path.exists() and not path.is_file():
        raise StateFileError(
            f"{path} is a folder or a device: name a file by the parameter state.file"
        )
    try:
        foreign = path.exists() and is_foreign(path)
    except OSError:
        return  # reading it will say what is wrong
    if foreign:
        raise StateFileError(
            f"{path} is another file, no state: it is left alone; name another one by the parameter"
            " state.file"
        )


def _claimed(path: Path) -> BinaryIO | None:
    """Lock a state file for as long as what is returned is open: the ground of another rover would be taken for this one's.

    None where the folder takes no lock; what is wrong with it, writing the state will say. Raises
    StateFileError where it is taken.
    """
    try:
        lock = path.with_name(f".{path.name}.lock").open("wb")
    except OSError:
        return None
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


def beside(action: Callable[[], ResultT]) -> "Future[ResultT]":
    """Run it in a thread of its own, which no end of the process waits for."""
    result: Future[ResultT] = Future()

    def run() -> None:
        try:
            result.set_result(action())
        except Exception as error:  # noqa: BLE001 - who waits for the result raises it
            result.set_exception(error)

    threading.Thread(target=run, name="state file", daemon=True).start()
    return result


async def done(future: "Future[ResultT]", patience_s: float = PATIENCE_S) -> ResultT:
    """What the future gives or raises, for a service: between two looks at it the executor serves the node's other callbacks.

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
    """Let the executor go on: it comes back to a callback that yields at its next turn."""
    yield


def go_on(pipeline: Pipeline, path: Path, logger: RcutilsLogger) -> bool:
    """Restore a saved state, and keep a copy of it for replays, since the file itself is soon replaced.

    Returns:
        Whether it was restored: a state that is refused is put aside, and the node has to estimate all the same.
    """
    try:
        pipeline.restore(read_state(path, pipeline.meta.model_sha256))
    except Exception as error:  # noqa: BLE001 - whatever the file holds
        aside = _free_name(path)
        with suppress(OSError):
            path.replace(aside)
        logger.error(f"{error}; it is put aside as {aside}, and the prior holds")  # noqa: G004, TRY400 - rclpy's logger
        return False
    logger.info(f"going on from the state in {path}")  # noqa: G004
    try:
        shutil.copyfile(path, path.with_name(path.name + LOADED))
    except OSError as error:
        logger.warning(f"the state that the node goes on from cannot be kept for replays: {error}")  # noqa: G004
    return True


def _free_name(path: Path) -> Path:
    """For what is put aside. Never that of an earlier one: started once with a wrong model, then with the right one, both are refused."""
    numbered = (f"{REFUSED}-{number}" for number in itertools.count(2))
    candidates = (
        path.with_name(path.name + ending) for ending in itertools.chain([REFUSED], numbered)
    )
    return next(each for each in candidates if not each.exists())
