# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Keeps the estimator's state on the disk, beside the thread that estimates: an fsync takes as long as it likes."""

import shutil
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from rclpy.impl.rcutils_logger import RcutilsLogger

from terrain_estimator.pipeline import Pipeline
from terrain_estimator.saved_state import read_state, write_state

REFUSED, LOADED = ".refused", ".loaded"
"""Are added to the name of a state file that was put aside, and of a copy for replays."""


class StateKeeper:
    """Writes the newest state that it was given; one that comes while it writes replaces what still waits."""

    def __init__(self, path: Path, complain: Callable[[str], None]) -> None:
        """``complain`` takes why a state could not be written; it is called in the writing thread."""
        self.failures = 0  # since the last success
        self._path, self._complain = path, complain
        self._changed = threading.Condition()
        self._waiting: bytes | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="saved state", daemon=True)
        self._thread.start()

    def give(self, content: bytes) -> None:
        """Write this state soon."""
        with self._changed:
            self._waiting = content
            self._changed.notify()

    def end(self) -> None:
        """Write what still waits, and end the thread."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._ended or self._waiting is not None)
                content, self._waiting = self._waiting, None
            if content is None:
                return
            try:
                write_state(self._path, content)
            except Exception as error:  # noqa: BLE001 - whatever the disk does, the next state is tried too
                self.failures += 1
                if self.failures == 1:
                    self._complain(f"cannot write the state to {self._path}: {error}; trying on")
            else:
                self.failures = 0


def go_on(pipeline: Pipeline, path: Path, logger: RcutilsLogger) -> bool:
    """Restore a saved state, and keep a copy of it for replays, since the file itself is soon replaced.

    Returns:
        Whether it was restored: a state that is refused is put aside, and the node has to estimate all the same.
    """
    try:
        pipeline.restore(read_state(path, pipeline.meta.model_sha256))
    except Exception as error:  # noqa: BLE001 - whatever the file holds
        aside = path.with_name(path.name + REFUSED)
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
