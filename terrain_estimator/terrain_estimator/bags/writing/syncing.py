# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sync a growing file to the disk at intervals, in a thread of its own."""

import os
import threading
import time
from contextlib import suppress
from errno import ENOENT
from pathlib import Path
from typing import BinaryIO


class Syncer:
    """A thread that begins an fsync every ``interval_s``.

    An fsync can take long, so the writer does not wait for it.
    """

    def __init__(self, file: BinaryIO, folder: Path, interval_s: float) -> None:
        """Start.

        Args:
            file: must stay open until after :meth:`stop`.
            folder: holds the file's entry, which reaches the disk with the first interval.
            interval_s: [s] what a power cut may cost.
        """
        self._descriptor = file.fileno()
        self._folder = folder
        self._interval_s = interval_s
        self._began_s = time.monotonic()  # all that was written before is on the disk
        self._stopped = threading.Event()
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="fsync", daemon=True)
        self._thread.start()

    @property
    def late_s(self) -> float:
        """Time [s] by which the last sync is late: a power cut now costs this much more."""
        return max(0.0, time.monotonic() - self._began_s - self._interval_s)

    def check(self) -> None:
        """Raise the OSError that the disk reported, if any."""
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """End the thread, however long its fsync takes: the file must stay open until then."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        named, began_s = False, self._began_s
        while not self._stopped.wait(max(0.0, began_s + self._interval_s - time.monotonic())):
            began_s = time.monotonic()
            try:
                os.fsync(self._descriptor)
                if not named:
                    sync_folder(self._folder)
                    named = True
            except MemoryError:
                continue  # late_s grows until an fsync succeeds
            except OSError as error:
                self._error = error
                return
            self._began_s = began_s
            if not os.fstat(self._descriptor).st_nlink:
                self._error = FileNotFoundError(ENOENT, "the file was deleted while it was written")
                return


def sync_folder(folder: Path) -> None:
    """Make new and renamed entries of a folder durable."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        with suppress(InterruptedError):  # Linux has closed it all the same
            os.close(descriptor)
